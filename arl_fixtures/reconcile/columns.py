"""The observation table in memory: numeric columns, categories, channels and the groups that share errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.roles import Role, is_aside, may_be_light, role_of, unit_of

IMAGE_COLUMNS = ("dut", "cycle", "step", "stage_angle_deg")
"""What tells images apart on a bench with a rotary stage."""
OF_ROWS = ("surface", "mixed")
"""Labels that say what a single row sees."""
MOST_SETTINGS = 64
"""Levels of a number up to which it may be a setting that tells pictures apart together with another."""
FEWEST_PIXELS, REPEATED = 4, 0.01
"""Rows that an image has at least, and share of rows whose pixel may stand in its image twice."""
RECORDED = frozenset({"cycle", "step"})
"""What stands for something within one record only."""
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A measured quantity with its simulation.

    Attributes:
        name: column of the measured value; the simulated one is `sim_` + name.
        role: kind of quantity.
        unit: plain text.
        parent: for a scatter channel the channel whose scatter it is, else empty.
    """

    name: str
    role: Role
    unit: str
    parent: str = ""


@dataclass(frozen=True, slots=True)
class Given:
    """A column as the table has it, read under a name of the format: that = times · column + plus."""

    name: str
    times: float = 1.0
    plus: float = 0.0

    def formula(self) -> str:
        """What stands for the known name in a law."""
        text = self.name if self.times == 1.0 else f"{self.times:.6g} * {self.name}"
        if self.plus:
            text += f" {'-' if self.plus < 0 else '+'} {abs(self.plus):g}"
        return text if text == self.name else f"({text})"

    def back(self, x: float) -> float:
        """A value of the known column in the table's unit."""
        return (x - self.plus) / self.times


@dataclass(slots=True)
class Columns:
    """All usable columns of an observation table.

    Attributes:
        n: number of rows.
        numbers: numeric columns (measured, `sim_`, covariates, booleans excluded) as float64, NaN where not observed.
        categories: text, boolean and identifier columns as codes (−1 = null) and sorted labels.
        channels: what can be compared.
        derived: columns that the table lacks and its simulation shows, for effects only.
        lens: numbers of the camera whose rays these are, where only a sweep told it.
        smoothed: logged temperatures without their loggers' noise, for effects only.
        given: column to the one that was read under its name.
        ignored: column to the reason why it is not used.
        ceilings: channel to the end of its scale, where rows stand at it.
        sweep_gap_deg, frame_gap_s: farther apart, rows are no neighbours in the sweep or in time.
        record: code of the record that each row is from, where one cycle's or step's rows come from several.
        found_on: rows that a model was found on, where others stand beside them; None where all are alike.
        memo: room for what effects compute once per table, under keys of their own.
    """

    n: int
    numbers: dict[str, FloatArray]
    categories: dict[str, tuple[IntArray, tuple[str, ...]]]
    channels: tuple[Channel, ...]
    ignored: dict[str, str] = field(default_factory=dict)
    ceilings: dict[str, float] = field(default_factory=dict)
    sweep_gap_deg: float = np.inf
    frame_gap_s: float = np.inf
    record: IntArray | None = None
    found_on: BoolArray | None = None
    derived: dict[str, FloatArray] = field(default_factory=dict)
    lens: dict[str, float] = field(default_factory=dict)
    smoothed: dict[str, FloatArray] = field(default_factory=dict)
    given: dict[str, Given] = field(default_factory=dict)
    memo: dict[object, Any] = field(default_factory=dict)
    _groups: dict[tuple[str, ...], IntArray] = field(default_factory=dict)
    _relations: dict[tuple[object, ...], IntArray] = field(default_factory=dict)

    def codes_of(self, name: str) -> IntArray:
        """Integer code of a column's values, numeric or category; NaN and null get a code of their own."""
        if name in self.categories:
            return self.categories[name][0]
        return np.unique(self.numbers[name], return_inverse=True, equal_nan=True)[1].astype(np.int64)

    def group(self, *names: str) -> IntArray:
        """Code 0…k−1 of the combination of those of `names` that the table has; all 0 where it has none."""
        present = tuple(name for name in names if name in self.numbers or name in self.categories)
        record = None if RECORDED.isdisjoint(names) else self.record
        key = present if record is None else (*present, "~record")
        if key not in self._groups:
            code = np.zeros(self.n, dtype=np.int64) if record is None else record
            for name in present:
                part = self.codes_of(name)
                part = part - part.min()
                code = np.unique(code * (int(part.max()) + 1) + part, return_inverse=True)[1].astype(np.int64)
            self._groups[key] = code
        return self._groups[key]

    @property
    def image_columns(self) -> tuple[str, ...]:
        """Columns that tell images apart: where a pixel stands in one twice, one more (time, a lamp's level) does."""
        if "image columns" not in self.memo:
            self.memo["image columns"] = self._find_image_columns()
        found: tuple[str, ...] = self.memo["image columns"]
        return found

    @property
    def sweep_columns(self) -> tuple[str, ...]:
        """Columns that tell sweeps of the stage apart: not `step` where each numbers a single stop of one sweep.

        Where rays stand at a stage angle more often than once a step, but once for each surface, targets are swept
        one after another (a goniometer's samples), and their sweeps are told apart.
        """
        if "sweep columns" not in self.memo:
            one = (
                "step" in self.numbers
                and "stage_angle_deg" in self.numbers
                and (int(self.group("dut", "cycle", "step").max()) == int(self.group(*IMAGE_COLUMNS).max()) > 0)
            )
            sweeps = ("dut", "cycle", "ramp") if one else ("dut", "cycle", "step")
            self.memo["sweep columns"] = (*sweeps, "surface") if self._swept_by_target(sweeps) else sweeps
        found: tuple[str, ...] = self.memo["sweep columns"]
        return found

    def _swept_by_target(self, sweeps: tuple[str, ...]) -> bool:
        if "stage_angle_deg" not in self.numbers or not {"surface"} & {*self.numbers, *self.categories}:
            return False
        places = (*sweeps, *self.ray_columns, "stage_angle_deg")
        least = (1.0 - REPEATED) * self.n
        once = 1 + int(self.group(*places).max())
        return once < least <= 1 + int(self.group(*places, "surface").max())

    @property
    def ray_columns(self) -> tuple[str, ...]:
        """Columns that tell a sensor's rays apart: its pixels, or the directions of a scanner that numbers none."""
        pixels = {"pixel_u", "pixel_v"} & set(self.numbers)
        return ("pixel_u", "pixel_v") if pixels else ("azimuth_deg", "elevation_deg")

    @property
    def sweep_order(self) -> FloatArray:
        """What grows while the stage sweeps: time; without times its angle, or its angle the other way round.

        Where single stops make up sweeps of both ramps, the stage went up in one and came back in the other.
        """
        times = self.numbers.get("time_s")
        if times is not None and len(np.unique(times[np.isfinite(times)])) > 1:
            return times
        angle, ramp = self.numbers["stage_angle_deg"], self.numbers.get("ramp", np.zeros(self.n))
        if "ramp" in self.sweep_columns and np.any(ramp < 0.0) and np.any(ramp > 0.0):
            return np.where(ramp < 0.0, -angle, angle)
        return angle

    def _find_image_columns(self) -> tuple[str, ...]:
        """With what tells pictures apart where steps and angles do not: a time, a setting, a label, or two."""
        if not {"pixel_u", "pixel_v"} & set(self.numbers) or not self._repeat_pixels(IMAGE_COLUMNS):
            return IMAGE_COLUMNS
        for names in self._telling_pictures():
            columns = (*IMAGE_COLUMNS, *names)
            images = int(self.group(*columns).max()) + 1
            if images * FEWEST_PIXELS <= self.n and not self._repeat_pixels(columns):
                return columns
        return IMAGE_COLUMNS

    def _telling_pictures(self) -> Iterator[tuple[str, ...]]:
        """What may tell pictures apart, in the order in which it is tried: levels are counted only for pairs."""
        taken = {c.name for c in self.channels} | {c.parent for c in self.channels}
        numbers = [n for n in sorted(self.numbers) if not n.startswith(("sim_", "pixel_")) and n not in taken]
        labels = [n for n in sorted(self.categories) if n not in {*IMAGE_COLUMNS, *OF_ROWS}]
        for name in (*sorted(numbers, key=lambda n: n != "time_s"), *labels):
            yield (name,)
        settings = [n for n in numbers if n not in {*IMAGE_COLUMNS, "n_frames"}]
        few = [n for n in settings if len(np.unique(self.numbers[n])) <= MOST_SETTINGS]
        yield from combinations((*labels, *few), 2)

    def _repeat_pixels(self, columns: tuple[str, ...]) -> bool:
        """Whether pixels stand more than once in what the columns tell apart."""
        return int(self.group(*columns, "pixel_u", "pixel_v").max()) + 1 < (1.0 - REPEATED) * self.n

    def match(self, key: tuple[object, ...], own: IntArray, wanted: IntArray) -> IntArray:
        """Row whose `own` code equals each row's `wanted` code, −1 where there is none; cached under `key`."""
        if key not in self._relations:
            order = np.argsort(own, kind="stable")
            ranked = own[order]
            place = np.searchsorted(ranked, wanted)
            place[place == self.n] = 0
            found = order[place]
            self._relations[key] = np.where((ranked[place] == wanted) & (wanted >= 0), found, -1)
        return self._relations[key]

    def following(self, key: tuple[object, ...], group: IntArray, order_by: FloatArray, lag: int) -> IntArray:
        """Row that stands `lag` places after each row in its group, sorted by `order_by`; −1 beyond the ends."""
        if key not in self._relations:
            order = np.lexsort((order_by, group))
            target = np.arange(self.n) + lag
            inside = (target >= 0) & (target < self.n)
            target[~inside] = 0
            other = order[target]
            same = inside & (group[other] == group[order])
            result = np.full(self.n, -1, dtype=np.int64)
            result[order] = np.where(same, other, -1)
            self._relations[key] = result
        return self._relations[key]


def find_channels(names: set[str]) -> tuple[Channel, ...]:
    """Every X with a `sim_X` beside it, means before their scatters, in a stable order.

    The first signal is that of the return: light of the background and monitors of the source come after it.
    """
    measured = {
        name for name in names
        if not name.startswith("sim_") and f"sim_{name}" in names
    }  # fmt: skip
    scatters = {name for name in measured if name.endswith("_std") and f"sim_{name.removesuffix('_std')}" in names}
    roles = {name: role_of(name, measured) for name in sorted(measured - scatters, key=lambda n: (is_aside(n), n))}
    loaded = any("load" in name for name in names)  # a source of power has one, a reading of light none
    if not loaded and all(role is Role.OTHER for role in roles.values()):
        roles = {name: Role.INTENSITY if may_be_light(name) else role for name, role in roles.items()}
    made = [Channel(name=name, role=role, unit=unit_of(name)) for name, role in roles.items()]
    made += [
        Channel(name=name, role=Role.SCATTER, unit=unit_of(name), parent=name.removesuffix("_std"))
        for name in sorted(scatters)
    ]
    return tuple(made)
