"""Time histories of a driver per DUT and cycle, on one regular grid: what lag, frost and latent heat integrate over.

Rows come in no order and many rows share a time; the grid is built once for a table, filters run along its axis.
Where a table has no `time_s`, the step index is the time, and time constants are in steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from arl_fixtures.reconcile.effects_common import per_table, per_view
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_CELLS = 400_000
_LONGEST = 2048


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """A quantity over time for every (`dut`, `cycle`).

    Attributes:
        values: one row per group, one column per grid time; the ends are held beyond a group's record.
        interval: grid interval, in `unit`.
        unit: `s`, or `steps` where the table has no time.
    """

    values: FloatArray
    interval: float
    unit: str


@dataclass(frozen=True, slots=True)
class _Clock:
    group: IntArray
    place: FloatArray
    groups: int
    length: int
    interval: float
    unit: str


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
        since = np.nan_to_num(time - np.where(np.isfinite(start), start, 0.0)[group])
        longest = float(since.max())
        times = np.unique(np.round(since / max(longest, 1e-300), 6)).size
        length = int(np.clip(4 * times, 64, min(_LONGEST, max(64, _CELLS // groups))))
        interval = longest / (length - 1)
        return _Clock(group, since / interval, groups, length, interval, "s" if name == "time_s" else "steps")

    return per_table(view, "history clock", make)


def history(view: View, column: str) -> History | None:
    """History of a numeric column of the whole table; None without time, or where nothing was logged."""

    def make() -> History | None:
        clock = _clock(view)
        if clock is None:
            return None
        values = view.columns.numbers[column]
        good = np.isfinite(values)
        if not good.any():
            return None
        cell = clock.group * clock.length + np.rint(clock.place).astype(np.int64)
        total = np.bincount(cell[good], values[good], clock.groups * clock.length)
        place = np.bincount(cell[good], clock.place[good], clock.groups * clock.length)
        count = np.bincount(cell[good], minlength=clock.groups * clock.length)
        grid = np.empty((clock.groups, clock.length))
        ticks = np.arange(clock.length, dtype=float)
        overall = float(values[good].mean())
        for index in range(clock.groups):
            part = slice(index * clock.length, (index + 1) * clock.length)
            known = np.flatnonzero(count[part])
            if known.size == 0:
                grid[index] = overall
                continue
            weight = count[part][known]
            grid[index] = np.interp(ticks, place[part][known] / weight, total[part][known] / weight)
        return History(values=grid, interval=clock.interval, unit=clock.unit)

    return per_table(view, ("history", column), make)


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
