"""The standard error of each row's mean where the simulation states none: its size, and what it grows with.

A signal's noise has a floor and grows with the signal; a range's grows where the signal fades. So the scatter of what
rows of one group leave is looked at over each simulated quantity, in bins of as many rows; a quantity over which it
is not one and the same shapes the errors, and what is left is looked at over the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

MOST_BINS, LEAST_ROWS, LEAST_GROUP = 12, 25, 4
LEAST_GAIN, GAIN_BIN = 6.0, 2.0
"""Log-likelihood that a shape must gain, and for each of its bins: the scatter of few rows is uncertain itself."""
WIDE = float(np.log(2.0))
"""Logarithm of the widest range of a quantity for one bin, where there are rows enough to cut it."""
LEAST_SHARE = 1e-9
NORMAL = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""


def estimated_error(
    deviations: FloatArray, frames: FloatArray, quantities: Sequence[FloatArray], group: IntArray, scale: FloatArray
) -> FloatArray:
    """Standard error of each row's mean, at least a billionth of its scale.

    Args:
        deviations: measured less expected, in the channel's unit, shape (n,).
        frames: averaged in each row.
        quantities: simulated values on which a noise may hang, each (n,).
        group: code of rows that share an error; their median is not noise.
        scale: what a relative error of 1 would change, or the unit itself.
    """
    single = np.sqrt(np.maximum(frames, 1.0))
    code = np.unique(group, return_inverse=True)[1].astype(np.int64)
    count = np.bincount(code)
    own = group_median(code, deviations, len(count))[code]
    left = (deviations - np.where(count[code] >= LEAST_GROUP, own, np.median(deviations))) * single
    shape = np.ones(len(left))
    waiting = list(quantities)
    while waiting:
        found = [_shape_over(values, left / shape) for values in waiting]
        best = int(np.argmax([gain for gain, _ in found]))
        if found[best][0] <= 0.0:
            break
        shape = shape * found[best][1]
        del waiting[best]
    return np.asarray(np.maximum(shape * _spread(left / shape) / single, LEAST_SHARE * scale))


def noise_quantities(view: View, use: IntArray) -> list[FloatArray]:
    """Simulated values of rows on which their noise may hang."""
    means = [c.name for c in view.columns.channels if c.role is not Role.SCATTER]
    quantities = [view.sim[name][use] for name in means]
    if view.has("true_range_m"):
        quantities.append(view.number("true_range_m")[use])
    if view.is_category("mixed"):  # what sees two surfaces ranges them by chance
        quantities.append(view.selects("mixed", "true")[use].astype(float))
    return quantities


def group_median(code: IntArray, x: FloatArray, count: int) -> FloatArray:
    """Median of each group of 0…count−1, (count,)."""
    return group_quantiles(code, x, count, (0.5,))[0]


def group_quantiles(code: IntArray, x: FloatArray, count: int, shares: Sequence[float]) -> list[FloatArray]:
    """Value that a share of each group's rows lie below, (count,) for each share."""
    order = np.lexsort((x, code))
    sizes = np.bincount(code, minlength=count)
    start = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    ranked, last = x[order], np.maximum(sizes - 1, 0)
    return [
        np.asarray(ranked[np.minimum(start + np.minimum((sizes * share).astype(np.int64), last), len(x) - 1)])
        for share in shares
    ]


def _shape_over(values: FloatArray, left: FloatArray) -> tuple[float, FloatArray]:
    """What it gains to let the scatter be a function of a quantity, and that function on the rows.

    The gain is that of the double exponential distribution, which few wild rows do not rule.
    """
    flat = np.ones(len(left))
    known = np.isfinite(values)
    bins = min(MOST_BINS, int(known.sum()) // LEAST_ROWS)
    if bins < 2:
        return 0.0, flat
    place = _places(values, known)
    cuts = _cuts(values[known], place[known], bins, WIDE if np.all(values[known] >= 0.0) else np.inf)
    code = np.searchsorted(cuts, np.where(known, values, np.median(values[known])), side="right")
    present, count = np.unique(code, return_counts=True)
    if len(present) < 2:
        return 0.0, flat
    sizes = np.array([_spread(left[code == k]) for k in present])
    if not np.all(sizes > 0.0):
        return 0.0, flat
    size, means = np.abs(left), np.array([np.mean(np.abs(left[code == k])) for k in present])
    gain = float(count @ np.log(np.mean(size) / means)) - LEAST_GAIN - GAIN_BIN * len(present)
    middle = np.array([np.median(place[known & (code == k)]) for k in present])
    shape = np.exp(np.interp(np.where(known, place, middle[0]), middle, np.log(sizes / _spread(left))))
    return gain, np.where(known, shape, 1.0)


def _cuts(values: FloatArray, place: FloatArray, bins: int, widest: float) -> FloatArray:
    """Where bins of as many rows end; one that spans too much is cut as long as its parts have rows enough.

    The few brightest rows of a scene span a wide range of signals, and a noise grows all over it.
    """
    order = np.argsort(values, kind="stable")
    edges = [int(x) for x in np.linspace(0, len(values), bins + 1)]
    k = 0
    while k + 1 < len(edges):
        low, high = edges[k], edges[k + 1]
        wide = place[order[high - 1]] - place[order[low]] > widest
        if wide and high - low >= 2 * LEAST_ROWS:
            edges.insert(k + 1, (low + high) // 2)
        else:
            k += 1
    return np.unique(values[order[edges[1:-1]]])


def _places(values: FloatArray, known: NDArray[np.bool_]) -> FloatArray:
    """A quantity's logarithm, as noise grows by powers of it; itself where it has both signs."""
    if np.any(values[known] < 0.0):
        return values
    least = 1e-3 * float(np.median(values[known]))
    return np.log(np.maximum(np.nan_to_num(values), max(least, 1e-300)))


def _spread(left: FloatArray) -> float:
    return NORMAL * float(np.median(np.abs(left)))
