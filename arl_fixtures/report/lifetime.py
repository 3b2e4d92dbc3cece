"""What the cycles done are worth in use: Coffin-Manson for temperature swings, Arrhenius for time at temperature.

Both parameters of the models and conditions of use are known as ranges at best, so the answer is a range, never one
number: the smallest and the largest over the ranges. The sums over a test are monotonic in the condition of use, so
that its ends suffice, and convex in the model's parameter, so that the largest lies at an end and the smallest is
searched for.

* Coffin-Manson: a swing ΔT_test is worth (ΔT_test/ΔT_use)^q swings of use (L. F. Coffin, Trans. ASME 76 (1954)
  931-950; S. S. Manson, NACA TN 2933 (1953)).
* Arrhenius: a time at T_test is worth exp(E_a/k (1/T_use - 1/T_test)) times as long at T_use.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, Field
from scipy.optimize import minimize_scalar

from arl_fixtures.yaml_model import FileModel, load_model

BOLTZMANN_EV_PER_K: Final = 8.617333262e-5
ZERO_CELSIUS_K: Final = 273.15


def _in_order(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError(f"range from {ends[0]:g} to {ends[1]:g} is empty; expected [lowest, highest]")
    return ends


Range = Annotated[tuple[float, float], AfterValidator(_in_order)]


def _positive(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] <= 0.0:
        raise ValueError(f"expected a range above 0, got one from {ends[0]:g}")
    return _in_order(ends)


PositiveRange = Annotated[tuple[float, float], AfterValidator(_positive)]


class Use(FileModel):
    """How the device is used, as ranges.

    Attributes:
        swing_k: temperature swing of one use cycle.
        swings_per_year: how often.
        temperature_c: housing temperature in operation.
        hours_per_year: hours of operation.
        source: where the figures come from.
    """

    swing_k: PositiveRange
    swings_per_year: PositiveRange
    temperature_c: Range
    hours_per_year: PositiveRange
    source: str = Field(min_length=1)


class FatigueModel(FileModel):
    """Coffin-Manson of one failure mechanism: exponent q."""

    name: str = Field(min_length=1)
    exponent: PositiveRange
    source: str = Field(min_length=1)


class RateModel(FileModel):
    """Arrhenius of one failure mechanism: activation energy, eV."""

    name: str = Field(min_length=1)
    activation_energy_ev: PositiveRange
    source: str = Field(min_length=1)


class LifetimeModel(FileModel):
    """A lifetime file."""

    name: str = Field(min_length=1)
    version: int = Field(ge=1)
    use: Use
    coffin_manson: tuple[FatigueModel, ...] = ()
    arrhenius: tuple[RateModel, ...] = ()


def load_lifetime(path: Path) -> LifetimeModel:
    """Read a lifetime file.

    Raises:
        ConfigError: every fault of the file, one a line, each with file, line and column.
    """
    return load_model(path, LifetimeModel)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stress:
    """What a device went through.

    Attributes:
        swings_k: temperature swing of each cycle.
        dwell: hours and mean temperature in degrees Celsius of each step.
    """

    swings_k: tuple[float, ...]
    dwell: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Equivalent:
    """What a stress is worth in use.

    Attributes:
        mechanism: by which model.
        amount: swings or hours of use, lowest and highest.
        years: years of use, lowest and highest.
    """

    mechanism: str
    amount: tuple[float, float]
    years: tuple[float, float]


def fatigue(stress: Stress, model: FatigueModel, use: Use) -> Equivalent:
    """Swings of use that the swings of the test are worth (Coffin-Manson)."""

    def amount(use_swing_k: float, exponent: float) -> float:
        return sum(math.pow(swing / use_swing_k, exponent) for swing in stress.swings_k if swing > 0.0)

    return _equivalent(model.name, _extremes(amount, use.swing_k, model.exponent), use.swings_per_year)


def rate(stress: Stress, model: RateModel, use: Use) -> Equivalent:
    """Hours of use that the hours of the test are worth (Arrhenius)."""

    def amount(use_c: float, energy_ev: float) -> float:
        return sum(hours * acceleration(temperature, use_c, energy_ev) for hours, temperature in stress.dwell)

    return _equivalent(
        model.name, _extremes(amount, use.temperature_c, model.activation_energy_ev), use.hours_per_year
    )


def acceleration(test_c: float, use_c: float, energy_ev: float) -> float:
    """Arrhenius factor between two temperatures in degrees Celsius."""
    inverse = 1.0 / (use_c + ZERO_CELSIUS_K) - 1.0 / (test_c + ZERO_CELSIUS_K)
    return math.exp(energy_ev / BOLTZMANN_EV_PER_K * inverse)


def _extremes(
    amount: Callable[[float, float], float], use: tuple[float, float], parameter: tuple[float, float]
) -> tuple[float, float]:
    """Smallest and largest amount; monotonic in its first argument, convex in its second."""
    ends = [amount(condition, value) for condition in use for value in parameter]
    inner = []
    if parameter[0] < parameter[1]:
        for condition in use:
            found = minimize_scalar(functools.partial(amount, condition), bounds=parameter, method="bounded")
            inner.append(float(found.fun))
    return min(ends + inner), max(ends)


def _equivalent(name: str, amount: tuple[float, float], per_year: tuple[float, float]) -> Equivalent:
    return Equivalent(mechanism=name, amount=amount, years=(amount[0] / per_year[1], amount[1] / per_year[0]))
