"""Terms of a law that hold in a band of a column, or in a box of two: a block of pixels, a range of temperature.

The edges of the best band are found by looking at all of them: with the sums of the residual and of the squared
direction over a column's levels, the gain of every band comes from differences of running sums; so does that of every
box, from the sums over the cells of both its columns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.features import OF_NEIGHBOURS
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import PRICE_PRODUCT, Basis, price_of
from arl_fixtures.reconcile.law_work import Work

PRICE_BAND = 10.0
"""Log-likelihood that a band must earn: its two edges are chosen among a thousand."""
MOST_LEVELS, LEAST_LEVELS = 48, 6
CLEAR_GAP = 5.0
"""Standard deviations of a column's readings within steps by which the levels of two steps must differ for a cut."""
WIDEST = 0.7
"""Share of the rows beyond which a band is rather a step."""
PRICE_STEP, LEAST_BEYOND = 7.5, 0.03
"""What a step must earn whose place is the best of dozens, and the share of rows on either side of it."""
PRICE_BOX, PER_BOXES = 1.0, 0.8
"""What a box must earn, and for each unit in the logarithm of how many there are: noise on 6×6 to 48×32 levels makes
the best box gain 8.3 to 12.8 in one table of a hundred (ln 361 to ln 619 000), as if fewer were independent."""
SIDES = (("pixel_u", "pixel_v"), ("azimuth_deg", "elevation_deg"))
MOST_LINES = 3


@dataclass(frozen=True, slots=True)
class Parted:
    """A column parted into levels: edges between them, and the level of each row (−1 where it is not known)."""

    name: str
    cuts: FloatArray
    code: IntArray


def bands_of(work: Work, names: Sequence[str], lines: Sequence[Axis]) -> Iterator[Basis]:
    """The best band of each column, and the best box of the image, alone and times a line of another column.

    Args:
        work: the rows.
        names: columns that may have a band.
        lines: lines that may multiply it.
    """
    # between two ratios of neighbours lies a handful of places, and others where other angles are looked at
    names = [name for name in names if not name.startswith(OF_NEIGHBOURS)]
    levels = {name: part for name in {*names, *(n for pair in SIDES for n in pair)} if (part := _parted(work, name))}
    factors: list[Axis | None] = [None, *lines[:MOST_LINES]]
    sides = next((pair for pair in SIDES if all(n in levels for n in pair)), ())
    boxes = _Boxes(levels[sides[0]], levels[sides[1]]) if sides else None
    for line in factors:
        direction = work.direction * (1.0 if line is None else line(work.features))
        more, price = ((line,), PRICE_PRODUCT) if line is not None else ((), 0.0)
        for name in names:
            if name not in levels or (line is not None and line.column == name):
                continue
            band = best_band(levels[name], direction, work.residual)
            if band is not None:
                extra = price_of((name, *(a.column for a in more)))
                yield Basis(axes=(band_axis(levels[name], band), *more), price=PRICE_BAND + price + extra)
        if boxes is not None and (line is None or line.column not in sides):
            box = boxes.best(direction, work.residual)
            if box is not None:
                extra = price_of((*sides, *(a.column for a in more)))
                chosen = PRICE_BOX + PER_BOXES * float(np.log(boxes.count))
                yield Basis(axes=(*box, *more), price=chosen + price + extra)


def _parted(work: Work, name: str) -> Parted | None:
    return parted(work, name, work.features[name]) if name in work.features else None


def parted(work: Work, name: str, x: FloatArray) -> Parted | None:
    """A column in levels; None where it has too few.

    Its own, or those of steps where its readings only scatter about them: a band that ends amid a step's readings
    tells rows apart that differ by nothing. Else of about as many rows each.
    """
    good = np.isfinite(x)
    levels = np.unique(x[good])
    if len(levels) < LEAST_LEVELS:
        return None
    if len(levels) > MOST_LEVELS:
        cuts = _between_steps(work, x) if good.all() else np.zeros(0)
        if len(cuts) < LEAST_LEVELS - 1:
            cuts = np.unique(np.quantile(x[good], np.linspace(0.0, 1.0, MOST_LEVELS + 1)[1:-1]))
    else:
        cuts = 0.5 * (levels[1:] + levels[:-1])
    if len(cuts) < LEAST_LEVELS - 1:
        return None
    code = np.where(good, np.searchsorted(cuts, x, side="right"), -1)
    return Parted(name, np.asarray(cuts, dtype=np.float64), code.astype(np.int64))


def _between_steps(work: Work, x: FloatArray) -> FloatArray:
    """Cuts amid the gaps between the levels of steps within which readings hardly scatter; of many some."""
    rows = np.bincount(work.step)
    means = np.bincount(work.step, x)[rows > 0] / rows[rows > 0]
    within = x - (np.bincount(work.step, x) / np.maximum(rows, 1))[work.step]
    levels = np.sort(means)
    apart = np.diff(levels) > CLEAR_GAP * float(np.std(within))
    cuts = (0.5 * (levels[1:] + levels[:-1]))[apart]
    if len(cuts) > MOST_LEVELS:
        cuts = cuts[np.linspace(0, len(cuts) - 1, MOST_LEVELS).astype(np.int64)]
    return np.asarray(cuts)


def best_band(part: Parted, direction: FloatArray, residual: FloatArray) -> tuple[int, int] | None:
    """Levels from and up to which a constant explains most; it ends before the column does, as else it is a step.

    Args:
        part: the column. direction, residual: of the rows.
    """
    there = part.code >= 0
    count = len(part.cuts) + 1
    push = _running(part.code[there], (direction * residual)[there], count)
    power = _running(part.code[there], (direction**2)[there], count)
    rows = _running(part.code[there], np.ones(int(there.sum())), count)
    first, last = np.triu_indices(count + 1, 1)
    weight = power[last] - power[first]
    share = (rows[last] - rows[first]) / len(direction)
    gain = np.where(weight > 0, (push[last] - push[first]) ** 2 / np.maximum(weight, 1e-300), 0.0)
    gain[share > WIDEST] = 0.0
    gain[(first == 0) | (last == count)] = 0.0
    best = int(np.argmax(gain))
    return (int(first[best]), int(last[best])) if gain[best] > 0 else None


def best_step(work: Work, name: str) -> Axis | None:
    """The step over a column that parts what is left best; None where it has too few levels."""
    part = _parted(work, name)
    if part is None:
        return None
    there, count = part.code >= 0, len(part.cuts) + 1
    push = _running(part.code[there], (work.direction * work.residual)[there], count)[1:-1]
    power = _running(part.code[there], (work.direction**2)[there], count)
    rows = _running(part.code[there], np.ones(int(there.sum())), count)
    share = 1.0 - rows[1:-1] / rows[-1]
    beyond = np.where((share > LEAST_BEYOND) & (share < 1.0 - LEAST_BEYOND), power[-1] - power[1:-1], 0.0)
    whole = float((work.direction * work.residual)[there].sum())
    least = max(1e-9 * float(power[-1]), 1e-300)
    gain = np.where(beyond > least, (whole - push) ** 2 / np.maximum(beyond, least), 0.0)
    best = int(np.argmax(gain))
    low, high = float(part.cuts[0]), float(part.cuts[-1])
    if not gain[best] > 0.0 or high <= low:
        return None
    return Axis(column=name, kind="step", middle=0.5 * (low + high), width=high - low, at=float(part.cuts[best]))


def _running(code: IntArray, values: FloatArray, count: int) -> FloatArray:
    sums = np.bincount(code, values, minlength=count)
    return np.concatenate([[0.0], np.cumsum(sums)])


class _Boxes:
    """All boxes of two columns that are proper bands of both: their sums, and which one holds together best."""

    def __init__(self, one: Parted, other: Parted) -> None:
        self._parted = one, other
        self._there = (one.code >= 0) & (other.code >= 0)
        self._shape = len(one.cuts) + 1, len(other.cuts) + 1
        self._cell = one.code[self._there] * self._shape[1] + other.code[self._there]
        self._bands = _pairs(self._shape[0]), _pairs(self._shape[1])
        self._allowed = self._sums(np.ones(len(one.code))) < WIDEST * len(one.code)

    @property
    def count(self) -> int:
        """How many there are."""
        return self._allowed.size

    def best(self, direction: FloatArray, residual: FloatArray) -> tuple[Axis, Axis] | None:
        """The bands that hold together best."""
        push, power = self._sums(direction * residual), self._sums(direction**2)
        gain = np.where(self._allowed & (power > 0.0), push**2 / np.maximum(power, 1e-300), 0.0)
        best = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if not gain[best] > 0.0:
            return None
        a, b = ((int(first[k]), int(last[k])) for (first, last), k in zip(self._bands, best, strict=True))
        return band_axis(self._parted[0], a), band_axis(self._parted[1], b)

    def _sums(self, values: FloatArray) -> FloatArray:
        """Of values of rows, over every box: (bands of the one, bands of the other)."""
        rows, columns = self._shape
        sums = np.zeros((rows + 1, columns + 1))
        cells = np.bincount(self._cell, values[self._there], minlength=rows * columns)
        sums[1:, 1:] = cells.reshape(rows, columns).cumsum(0).cumsum(1)
        (first, last), (start, stop) = self._bands
        within = sums[last] - sums[first]
        return np.asarray(within[:, stop] - within[:, start])


def _pairs(count: int) -> tuple[IntArray, IntArray]:
    """First level and that after the last one of every band that is not the whole column."""
    first, last = np.triu_indices(count + 1, 1)
    proper = (first > 0) | (last < count)
    return first[proper], last[proper]


def band_axis(part: Parted, band: tuple[int, int]) -> Axis:
    """The function that is 1 in levels of a column, from the one up to before the other, and 0 elsewhere."""
    edges = np.concatenate([[-np.inf], part.cuts, [np.inf]])
    return Axis(column=part.name, kind="band", edges=(float(edges[band[0]]), float(edges[band[1]])))
