"""Time histories of a driver per DUT and cycle, on one regular grid: what lag, frost and latent heat integrate over.

Rows come in no order and many rows share a time; the grid is built once for a table, filters run along its axis.
Where a table has no `time_s`, the step index is the time, and time constants are in steps.

The plate, the coolant and the chamber are one thing for all DUTs of a cycle: what was logged beside one is known of
the others, as far as their readings agree (runs at other times under one cycle's number do not).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.effects_common import is_of_bench, per_table, per_view
from arl_fixtures.reconcile.effects_history_turns import with_turns
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_CELLS = 400_000
_LONGEST = 2048
_AGREE = 0.02
"""Share of a temperature's range by which the readings of two DUTs may differ and still be of one thing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """A quantity over time for every (`dut`, `cycle`).

    Attributes:
        values: one row per group, one column per grid time; the ends are held beyond a group's record.
        interval: grid interval, in `unit`.
        unit: `s`, or `steps` where the table has no time.
        start: time of each group's first grid cell, in `unit`.
    """

    values: FloatArray
    interval: float
    unit: str
    start: FloatArray


@dataclass(frozen=True, slots=True)
class _Clock:
    group: IntArray
    place: FloatArray
    groups: int
    length: int
    interval: float
    unit: str
    start: FloatArray


def time_column(view: View) -> str:
    """Column that orders a history: `time_s`, else `step`, else empty."""
    return next((name for name in ("time_s", "step") if view.varies(name)), "")


def _clock(view: View) -> _Clock | None:
    def make() -> _Clock | None:
        name = time_column(view)
        if not name:
            return None
        table = view.columns
        group = table.group("dut", "cycle")
        groups = int(group.max()) + 1
        time = table.numbers[name]
        start = np.full(groups, np.inf)
        np.fmin.at(start, group, time)
        start = _common_start(table.group("cycle"), group, time, start)
        since = np.nan_to_num(time - np.where(np.isfinite(start), start, 0.0)[group])
        longest = float(since.max())
        if longest <= 0.0:
            return None  # each cycle was looked at once: there is no history within it
        times = np.unique(np.round(since / longest, 6)).size
        length = int(np.clip(4 * times, 64, min(_LONGEST, max(64, _CELLS // groups))))
        interval = longest / (length - 1)
        return _Clock(group, since / interval, groups, length, interval, "s" if name == "time_s" else "steps", start)

    return per_table(view, "history clock", make)


def _common_start(cycle: IntArray, group: IntArray, time: FloatArray, start: FloatArray) -> FloatArray:
    """First time of each group; of DUTs that were measured side by side in a cycle the first of them all."""
    end = np.full(start.size, -np.inf)
    np.fmax.at(end, group, time)
    cycle_of = np.zeros(start.size, dtype=np.int64)
    cycle_of[group] = cycle
    common = start.copy()
    order = np.lexsort((start, cycle_of))
    for before, this in itertools.pairwise(order):
        if cycle_of[before] == cycle_of[this] and start[this] <= end[before]:
            common[this] = common[before]
            end[this] = max(end[this], end[before])
    return common


def history(view: View, column: str, jump: float | None = None) -> History | None:
    """History of a numeric column of the whole table; None without time, or where nothing was logged.

    Between two readings it is a straight line, or changes at once where `jump` says, as a share of the way.
    """

    def make() -> History | None:
        clock = _clock(view)
        if clock is None:
            return None
        values = view.columns.numbers[column]
        good = np.isfinite(values)
        if not good.any():
            return None
        readings = _readings(clock, values, good)
        if is_of_bench(column):
            readings = _pooled(clock, view.columns.group("cycle"), readings, float(np.ptp(values[good])))
        grid = np.full((clock.groups, clock.length), float(values[good].mean()))
        ticks, steps = np.arange(clock.length, dtype=float), _steps(view, clock)
        for index, (place, reading) in enumerate(readings):
            if place.size:
                number = np.interp(place, *steps[index]) if steps and steps[index][0].size else None
                place, reading = with_turns(place, reading, number)
                knots = (place, reading) if jump is None else _with_jumps(place, reading, jump)
                grid[index] = np.interp(ticks, *knots)
        return History(values=grid, interval=clock.interval, unit=clock.unit, start=clock.start)

    return per_table(view, ("history", column, jump), make)


def _steps(view: View, clock: _Clock) -> _Readings:
    """Number of the step along each group's record; none where the table has no steps."""

    def find() -> _Readings:
        step = view.columns.numbers.get("step")
        return [] if step is None else _readings(clock, step, np.isfinite(step))

    return per_table(view, "steps of history", find)


SOAK_FROM = 0.2
"""Share of the way from a step's rows to the next step's at which a bench that soaks is at its new temperature."""
_STEADY = 0.25
"""Range of a temperature within a step, in its change from step to step, up to which the bench had soaked."""


def settles_at(view: View, column: str) -> float | None:
    """Where between two steps a temperature changes, as a share of the way, for `history`; None where rows tell.

    A bench that goes from setpoint to setpoint, waits and measures shows steady readings within each step. It leaves
    the old temperature when its rows are done, and soaks for most of the time at the new one.
    """

    def find() -> float | None:
        values, table = view.columns.numbers[column], view.columns
        good = np.isfinite(values)
        if not {"step", "time_s"} <= set(table.numbers) or not good.any():
            return None
        code = np.unique(table.group("dut", "cycle", "step")[good], return_inverse=True)[1]
        count = np.bincount(code)
        middle = np.bincount(code, values[good]) / count
        inside = np.sqrt(np.bincount(code, (values[good] - middle[code]) ** 2) / count)
        order = np.lexsort((np.bincount(code, table.numbers["time_s"][good]) / count, _first(code, table, good)))
        change = np.abs(np.diff(middle[order]))
        moved = change[change > 0.0]
        if moved.size < 2 or float(np.median(inside)) > _STEADY * float(np.median(moved)):
            return None
        return SOAK_FROM

    return per_table(view, ("settles at", column), find)


def _first(code: IntArray, table: Columns, good: NDArray[np.bool_]) -> IntArray:
    """Cycle of a DUT to which each step belongs."""
    group = np.zeros(int(code.max()) + 1, dtype=np.int64)
    group[code] = table.group("dut", "cycle")[good]
    return group


_QUICK = 0.1
"""Half of what a change takes that happens at one place between two readings, as a share of the way between them."""


def _with_jumps(place: FloatArray, reading: FloatArray, jump: float) -> tuple[FloatArray, FloatArray]:
    """Readings with a quick change at a share of the way from each to the next, and none before and after it."""
    gap = np.diff(place)
    before, after = place[:-1] + (jump - _QUICK) * gap, place[:-1] + (jump + _QUICK) * gap
    where = np.concatenate([place, before, after])
    order = np.argsort(where, kind="stable")
    return where[order], np.concatenate([reading, reading[:-1], reading[1:]])[order]


_Readings = list[tuple[FloatArray, FloatArray]]
"""Place on the grid and value of what was logged, for every group, in order of time."""


def _readings(clock: _Clock, values: FloatArray, good: NDArray[np.bool_]) -> _Readings:
    """Means over the grid's cells."""
    cell = clock.group * clock.length + np.rint(clock.place).astype(np.int64)
    total = np.bincount(cell[good], values[good], clock.groups * clock.length)
    place = np.bincount(cell[good], clock.place[good], clock.groups * clock.length)
    count = np.bincount(cell[good], minlength=clock.groups * clock.length)
    found: _Readings = []
    for index in range(clock.groups):
        part = slice(index * clock.length, (index + 1) * clock.length)
        known = np.flatnonzero(count[part])
        weight = count[part][known]
        found.append((place[part][known] / weight, total[part][known] / weight))
    return found


def _pooled(clock: _Clock, cycle: IntArray, readings: _Readings, wide: float) -> _Readings:
    """Each group's readings with those of the others of its cycle that are on the same clock and agree with it."""
    cycle_of = np.zeros(clock.groups, dtype=np.int64)
    cycle_of[clock.group] = cycle
    found = list(readings)
    for index, (place, reading) in enumerate(readings):
        others = [k for k in np.flatnonzero(cycle_of == cycle_of[index]) if k != index and readings[k][0].size]
        beside = [
            (readings[k][0], readings[k][1] + apart)
            for k in others
            if clock.start[k] == clock.start[index]
            and np.isfinite(apart := _apart((place, reading), readings[k], _AGREE * wide))
        ]
        if beside:
            where = np.concatenate([place, *(p for p, _ in beside)])
            order = np.argsort(where, kind="stable")
            found[index] = where[order], np.concatenate([reading, *(r for _, r in beside)])[order]
    return found


def _apart(own: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray], most: float) -> float:
    """What to add to another's readings to have one's own level; NaN where the two are not of one thing.

    Told at the times of whoever logged less: the denser record says what was in between. Zero without own readings.
    """
    if own[0].size == 0:
        return 0.0
    dense, sparse, sign = (other, own, 1.0) if other[0].size >= own[0].size else (own, other, -1.0)
    inside = (sparse[0] >= dense[0][0]) & (sparse[0] <= dense[0][-1])
    if not inside.any():
        return np.nan
    differ = sign * (sparse[1][inside] - np.interp(sparse[0][inside], dense[0], dense[1]))
    level = float(np.median(differ))
    agree = max(abs(level), float(np.quantile(np.abs(differ - level), 0.9))) <= most
    return level if agree else np.nan


def on_rows(view: View, grid: FloatArray) -> FloatArray:
    """A result on the history's grid, linear in between, on the rows under work."""
    clock = _clock(view)
    if clock is None:
        return np.zeros(view.n)

    def make() -> tuple[IntArray, FloatArray]:
        place = np.clip(clock.place[view.rows], 0.0, clock.length - 1.000001)
        low: IntArray = place.astype(np.int64)
        return clock.group[view.rows] * clock.length + low, place - low

    flat, part = per_view(view, "history place", make)
    values = grid.ravel()
    left = values[flat]
    return left + part * (values[flat + 1] - left)


def lagged(record: History, time_constant: float) -> FloatArray:
    """First-order low-pass of a history, exact for straight lines between grid points; starts settled."""
    return low_pass(record.values, record.interval / max(time_constant, 1e-9))


def low_pass(grid: FloatArray, ratio: float) -> FloatArray:
    """First-order low-pass along the last axis; `ratio` is grid interval over time constant."""
    if ratio > 50.0:
        return grid
    decay = float(np.exp(-ratio))
    share = -float(np.expm1(-ratio)) / ratio
    new, old = 1.0 - share, share - decay
    first = grid[:, :1]
    result: FloatArray = lfilter([new, old], [1.0, -decay], grid - first, axis=1)
    return result + first


def rate(record: History) -> FloatArray:
    """Time derivative of a history, per `unit`."""
    slope: FloatArray = np.gradient(record.values, record.interval, axis=1)
    return slope


def reservoir(increments: FloatArray) -> FloatArray:
    """Content of a store that cannot go below empty, from its increments along the last axis; starts empty.

    The reflected sum (Lindley's recursion) in closed form: S_k − min(0, min_{j ≤ k} S_j).
    """
    total = np.cumsum(increments, axis=1)
    floor = np.minimum(np.minimum.accumulate(total, axis=1), 0.0)
    content: FloatArray = total - floor
    return content
