"""Where a temperature turned between two readings: a record whose highest step was left out knows both its flanks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PAUSE = 0.2
"""Share of the longest time without a reading from which readings are of two looks, not of one."""
_LEFT_OUT = 1.5
"""How many steps, or how many times the least time, lie between two looks where one is left out."""
_ALIKE = 2.0
"""Most that the rates before and after a turn may differ by, as a factor, and a rate from the one before it."""
_CLEAR = 0.02
"""Least change from look to look, of the whole range, that is a rate."""


def with_turns(
    place: FloatArray, reading: FloatArray, step: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Readings, and where two flanks of different sign meet in a gap, the reading that they meet at.

    A bench that goes up by the same amount step after step, and down so, had been as high as both say when the step
    in between is not in the table: a straight line through the gap would cut the summit off.

    Args:
        place: times of the readings, ascending.
        reading: what was read.
        step: number of the step at each reading, where that is known; else the time tells whether a look is left out.
    """
    if place.size < 4:
        return place, reading
    pause = np.diff(place) > _PAUSE * float(np.diff(place).max())
    look = np.concatenate([[0], np.cumsum(pause)])
    count = np.bincount(look)
    when, mean = np.bincount(look, place) / count, np.bincount(look, reading) / count
    if when.size < 4:
        return place, reading
    number = place if step is None else step
    apart = np.abs(np.diff(number)[pause])  # from the end of a look, which may hold several steps, to the next one
    least = 1.0 if step is not None else float(np.min(apart))
    change = np.diff(mean)
    rate = change / np.diff(when)
    clear = np.abs(change) > _CLEAR * float(np.ptp(mean))
    found = []
    for k in range(1, when.size - 2):
        before, after = rate[k - 1], rate[k + 1]
        left_out = apart[k] > _LEFT_OUT * least
        turns = before * after < 0.0 and clear[k - 1] and clear[k + 1] and _alike(before, -after)
        if not (left_out and turns and _goes_on(rate, k)):
            continue
        at = (mean[k + 1] - mean[k] + before * when[k] - after * when[k + 1]) / (before - after)
        if when[k] < at < when[k + 1]:
            found.append((at, mean[k] + before * (at - when[k])))
    if not found:
        return place, reading
    where = np.concatenate([place, [at for at, _ in found]])
    order = np.argsort(where, kind="stable")
    return where[order], np.concatenate([reading, [value for _, value in found]])[order]


def _alike(one: float, other: float) -> bool:
    return 1.0 / _ALIKE <= one / other <= _ALIKE


def _goes_on(rate: FloatArray, k: int) -> bool:
    """Whether each flank has the rate of the look beyond it, where there is one."""
    early = k < 2 or _alike(rate[k - 2], rate[k - 1])
    late = k + 2 >= rate.size or _alike(rate[k + 2], rate[k + 1])
    return early and late
