"""The profile: which temperatures, which angles, how many frames, in which order."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from arl_fixtures.yaml_model import FileModel, load_model, named_file

MAX_ANGLES: Final = 100_000


class LoadCycle(FileModel):
    """Temperatures of one cycle: up from `minimum_c` to `maximum_c` and down again, in steps of `step_k`.

    With `minimum_c` equal to `maximum_c`, or with `repeats`, the list is given by `temperatures_c` instead.
    """

    minimum_c: float | None = Field(default=None, ge=-60, le=200)
    maximum_c: float | None = Field(default=None, ge=-60, le=200)
    step_k: float | None = Field(default=None, gt=0)
    temperatures_c: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        sweep = (self.minimum_c, self.maximum_c, self.step_k)
        if (self.temperatures_c is None) == any(value is None for value in sweep):
            raise ValueError("give either temperatures_c or all of minimum_c, maximum_c, step_k")
        if self.temperatures_c is not None:
            if not self.temperatures_c:
                raise ValueError("temperatures_c is empty")
            if any(value is not None for value in sweep):
                raise ValueError("give either temperatures_c or minimum_c, maximum_c, step_k, not both")
            return self
        assert self.minimum_c is not None
        assert self.maximum_c is not None
        assert self.step_k is not None
        if self.minimum_c >= self.maximum_c:
            raise ValueError(f"minimum_c {self.minimum_c:g} is not below maximum_c {self.maximum_c:g}")
        steps = (self.maximum_c - self.minimum_c) / self.step_k
        if abs(steps - round(steps)) > 1e-6:
            raise ValueError(f"step_k {self.step_k:g} does not divide {self.minimum_c:g}…{self.maximum_c:g}")
        return self

    def set_temperatures_c(self) -> tuple[float, ...]:
        """Set temperatures in the order they are driven, °C."""
        if self.temperatures_c is not None:
            return self.temperatures_c
        assert self.minimum_c is not None
        assert self.maximum_c is not None
        assert self.step_k is not None
        count = round((self.maximum_c - self.minimum_c) / self.step_k)
        up = [self.minimum_c + index * self.step_k for index in range(count + 1)]
        return tuple(up + up[-2::-1])


class AngleSweep(FileModel):
    """Stage angles of one sweep, degrees clockwise.

    The angles are centred on the middle of `from_deg` and `to_deg`; -60…60 in 0.9° gives 134 angles.
    A shuffled order keeps effects of time apart from effects of angle; each step is shuffled anew from the seed.
    """

    from_deg: float = Field(default=-60.0, ge=-180, le=180)
    to_deg: float = Field(default=60.0, ge=-180, le=180)
    step_deg: float = Field(default=0.9, gt=0)
    order: Literal["ascending", "shuffled"] = "ascending"
    seed: int = Field(default=0, ge=0)

    @model_validator(mode="after")
    def _forward(self) -> Self:
        if self.from_deg > self.to_deg:
            raise ValueError(f"from_deg {self.from_deg:g} is above to_deg {self.to_deg:g}")
        if (self.to_deg - self.from_deg) / self.step_deg > MAX_ANGLES:
            raise ValueError(f"more than {MAX_ANGLES} angles")
        return self

    def angles_deg(self, step_index: int) -> tuple[float, ...]:
        """Angles of the step with this index, in driving order."""
        count = int(np.floor((self.to_deg - self.from_deg) / self.step_deg + 1e-9)) + 1
        start = 0.5 * (self.from_deg + self.to_deg - (count - 1) * self.step_deg)
        angles = np.round(start + self.step_deg * np.arange(count), 6)
        if self.order == "shuffled":
            np.random.default_rng([self.seed, step_index]).shuffle(angles)
        return tuple(float(angle) for angle in angles)


@dataclass(frozen=True, slots=True)
class CycleStep:
    """One temperature step of a cycle.

    `index` counts from 0 within the cycle, -1 is the reference sweep before it; `ramp` is +1 while heating, -1 while
    cooling, by how the step is reached.
    """

    cycle: int
    index: int
    set_temperature_c: float
    ramp: int

    @property
    def id(self) -> str:
        """Test id, as `c0003-07-up+25C`; the sweep that references are made of is `c0000-reference+25C`."""
        if self.index < 0:
            return f"c{self.cycle:04d}-reference{self.set_temperature_c:+g}C"
        direction = "up" if self.ramp > 0 else "down"
        return f"c{self.cycle:04d}-{self.index:02d}-{direction}{self.set_temperature_c:+g}C"


class Profile(FileModel):
    """What one cycle does."""

    name: str = Field(min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$")
    load_cycle: LoadCycle
    angles: AngleSweep = AngleSweep()
    frames: int = Field(default=10, ge=1, le=10_000)
    soak_s: float = Field(default=0.0, ge=0, description="rest at temperature after settling, before the sweep")
    reference_c: float = Field(default=25.0, description="set temperature of the reference step of cycle 0")

    def steps(self, cycle: int) -> tuple[CycleStep, ...]:
        """The steps of one cycle in order; the first counts as heating or cooling by where the next one lies."""
        temperatures = self.load_cycle.set_temperatures_c()
        steps, ramp = [], 1
        for index, temperature in enumerate(temperatures):
            if index:
                change = temperature - temperatures[index - 1]
                ramp = (change > 0) - (change < 0) or ramp
            steps.append(CycleStep(cycle, index, temperature, ramp))
        return tuple(steps)


BUILT_IN: Final = Path(__file__).parent.parent / "data" / "profiles"


def load_profile(name_or_path: str) -> Profile:
    """A profile by file name, or by the name of one of those that come with the package.

    Raises:
        ConfigError: no such profile, or it is wrong.
    """
    return load_model(profile_path(name_or_path), Profile)


def profile_path(name_or_path: str) -> Path:
    """The file that a profile name stands for.

    Raises:
        ConfigError: no such profile.
    """
    return named_file(name_or_path, BUILT_IN, "profile")
