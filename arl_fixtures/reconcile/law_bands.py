"""Terms of a law that hold in a band of a column, or in a box of two: a block of pixels, a range of temperature.

The edges of the best band are found by looking at all of them: with the sums of the residual and of the squared
direction over a column's levels, the gain of every band comes from differences of running sums. A box is found from
its two bands in turn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import PRICE_PRODUCT, Basis, price_of
from arl_fixtures.reconcile.law_work import Work

PRICE_BAND = 10.0
"""Log-likelihood that a band must earn: its two edges are chosen among a thousand."""
MOST_LEVELS, LEAST_LEVELS = 48, 6
WIDEST = 0.7
"""Share of the rows beyond which a band is rather a step."""
TURNS = 4
"""Times that the two bands of a box are looked for beside each other."""
SIDES = (("pixel_u", "pixel_v"), ("azimuth_deg", "elevation_deg"))
MOST_LINES = 3


@dataclass(frozen=True, slots=True)
class _Parted:
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
    parted = {name: part for name in {*names, *(n for pair in SIDES for n in pair)} if (part := _parted(work, name))}
    factors: list[Axis | None] = [None, *lines[:MOST_LINES]]
    boxes = next((pair for pair in SIDES if all(n in parted for n in pair)), ())
    for line in factors:
        direction = work.direction * (1.0 if line is None else line(work.features))
        more, price = ((line,), PRICE_PRODUCT) if line is not None else ((), 0.0)
        for name in names:
            if name not in parted or (line is not None and line.column == name):
                continue
            band = _best(parted[name], direction, work.residual, np.ones(len(direction), dtype=bool), within=True)
            if band is not None:
                extra = price_of((name, *(a.column for a in more)))
                yield Basis(axes=(_axis(parted[name], band), *more), price=PRICE_BAND + price + extra)
        if boxes and (line is None or line.column not in boxes):
            box = _box(parted[boxes[0]], parted[boxes[1]], direction, work.residual)
            if box is not None:
                extra = price_of((*boxes, *(a.column for a in more)))
                yield Basis(axes=(*box, *more), price=2.0 * PRICE_BAND + price + extra)


def _parted(work: Work, name: str) -> _Parted | None:
    x = work.features.get(name)
    if x is None:
        return None
    good = np.isfinite(x)
    levels = np.unique(x[good])
    if len(levels) < LEAST_LEVELS:
        return None
    if len(levels) > MOST_LEVELS:
        cuts = np.unique(np.quantile(x[good], np.linspace(0.0, 1.0, MOST_LEVELS + 1)[1:-1]))
    else:
        cuts = 0.5 * (levels[1:] + levels[:-1])
    if len(cuts) < LEAST_LEVELS - 1:
        return None
    code = np.where(good, np.searchsorted(cuts, x, side="right"), -1)
    return _Parted(name, np.asarray(cuts, dtype=np.float64), code.astype(np.int64))


def _best(
    part: _Parted, direction: FloatArray, residual: FloatArray, inside: np.ndarray, *, within: bool = False
) -> tuple[int, int] | None:
    """Levels from and up to which a constant explains most.

    Args:
        part: the column.
        direction, residual: of the rows.
        inside: rows that may belong to the band.
        within: whether it must end before the column does, as else it is a step.
    """
    there = inside & (part.code >= 0)
    count = len(part.cuts) + 1
    push = _running(part.code[there], (direction * residual)[there], count)
    power = _running(part.code[there], (direction**2)[there], count)
    rows = _running(part.code[there], np.ones(int(there.sum())), count)
    first, last = np.triu_indices(count + 1, 1)
    weight = power[last] - power[first]
    share = (rows[last] - rows[first]) / len(direction)
    gain = np.where(weight > 0, (push[last] - push[first]) ** 2 / np.maximum(weight, 1e-300), 0.0)
    gain[share > WIDEST] = 0.0
    if within:
        gain[(first == 0) | (last == count)] = 0.0
    best = int(np.argmax(gain))
    return (int(first[best]), int(last[best])) if gain[best] > 0 else None


def _running(code: IntArray, values: FloatArray, count: int) -> FloatArray:
    sums = np.bincount(code, values, minlength=count)
    return np.concatenate([[0.0], np.cumsum(sums)])


def _box(one: _Parted, other: _Parted, direction: FloatArray, residual: FloatArray) -> tuple[Axis, Axis] | None:
    """Bands of two columns that hold together best, from the better start of the two."""
    inside = np.ones(len(direction), dtype=bool)
    best: tuple[float, tuple[Axis, Axis]] | None = None
    for start, second in ((one, other), (other, one)):
        bands = {start.name: _best(start, direction, residual, inside), second.name: None}
        here, there = start, second
        for _ in range(TURNS):
            if bands[here.name] is None:
                break
            bands[there.name] = _best(there, direction, residual, _in(here, bands[here.name]))
            here, there = there, here
        a, b = bands[one.name], bands[other.name]
        if a is None or b is None or _is_whole(one, a) or _is_whole(other, b):
            continue
        rows = _in(one, a) & _in(other, b)
        gain = float(np.sum((direction * residual)[rows]) ** 2 / max(float(np.sum(direction[rows] ** 2)), 1e-300))
        if best is None or gain > best[0]:
            best = gain, (_axis(one, a), _axis(other, b))
    return None if best is None else best[1]


def _in(part: _Parted, band: tuple[int, int] | None) -> np.ndarray:
    assert band is not None
    return (part.code >= band[0]) & (part.code < band[1])


def _is_whole(part: _Parted, band: tuple[int, int]) -> bool:
    return band == (0, len(part.cuts) + 1)


def _axis(part: _Parted, band: tuple[int, int]) -> Axis:
    edges = np.concatenate([[-np.inf], part.cuts, [np.inf]])
    return Axis(column=part.name, kind="band", edges=(float(edges[band[0]]), float(edges[band[1]])))
