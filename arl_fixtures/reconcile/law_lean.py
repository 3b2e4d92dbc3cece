"""Steps and hinges whose place moves with a second column: of a sum of two columns rather than of one.

A laser hops between modes at a temperature of its junction, which lies above its mount's by what the current heats;
dew falls where a window is colder than moist air allows. Over each column alone such a step is blurred.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_bands import PRICE_BAND, band_axis, best_band, parted
from arl_fixtures.reconcile.law_basis import PRICE_ONE, PRICE_PRODUCT, Basis, price_of
from arl_fixtures.reconcile.law_candidates import likeliest, shared_price
from arl_fixtures.reconcile.law_peaks import best_peak
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.roles import unit_of

PRICE_LEAN = 10.0
"""Further price of a step or hinge for one of many leans."""
MOST_SIZES = 4
"""Leading columns whose pairs are tried."""
LEANS = (0.08, 0.2, 0.5, 1.0, 2.0, 5.0)
"""How far a step moves along the whole of the second column, in spans of its own."""
LEAST_SIDE = 0.02
"""Share of the rows that must lie on either side of a step."""
FEWEST_STEPS = 16
"""Steps from which columns that are steady within steps may be added: few are parted any way by a sum of two."""
HINGES = (0.3, 0.5, 0.7)
"""Shares of the rows at which a hinge along the likeliest lean is tried."""
PLACES = tuple(np.linspace(-0.12, 0.12, 9))
"""Shares of the rows by which more or fewer may lie beyond a step that leans."""
FINER = ((0.5, 1.0), (0.2, 0.4), (0.08, 0.12))
"""Relative change of a lean, and part of `PLACES`, within which it is refined."""


def leant_of(work: Work, names: Sequence[str], lines: Sequence[Axis]) -> Iterator[Basis]:
    """For each pair of columns and each lean the step, the band and the peak that part what is left best.

    And hinges along the lean whose step parts it best of all; and of two columns of one unit, whose sum or difference
    is one, peaks times a line.

    Args:
        work: the rows; names: sizes, those that tell most first.
        lines: of other columns.
    """
    freed = _freed(work)
    for first, second in combinations(names[:MOST_SIZES], 2):
        columns = (first, second)
        steady = work.is_shared(columns)
        if steady and np.unique(work.step).size < FEWEST_STEPS:
            continue
        price = PRICE_ONE + PRICE_PRODUCT + PRICE_LEAN + price_of(columns) + shared_price(work, columns)
        narrow = price + PRICE_BAND - PRICE_ONE
        steps = list(_best_steps(work, first, second))
        for step, _ in steps:
            yield Basis(axes=(step,), price=price)
            levels = parted(work, first, _argument(work, step))
            band = best_band(levels, work.direction, freed) if levels else None
            if levels and band:
                yield Basis(axes=(replace(step, kind="band", edges=band_axis(levels, band).edges),), price=narrow)
            if steady:  # few steps lie on a peak, and are put on it any way
                continue
            for line in (None, *lines) if abs(step.lean) == 1.0 else (None,):
                peak = best_peak(work, first, _argument(work, step), line)
                if peak is not None and (line is None or line.column not in columns):
                    axes = (replace(peak, beside=second, lean=step.lean),)
                    more = 0.0 if line is None else PRICE_PRODUCT + price_of((line.column,))
                    yield Basis(axes=axes if line is None else (*axes, line), price=narrow + more)
        for best in max(steps, key=lambda step: step[1], default=())[:1]:
            for kind, at in product(("above", "below"), _between(np.sort(_argument(work, best)), HINGES)):
                yield Basis(axes=(replace(best, kind=kind, at=at),), price=price)


def refined_lean(work: Work, left: FloatArray, basis: Basis, number: int) -> Basis:
    """A basis with the likeliest lean and places of one of its axes, sought ever finer.

    Args:
        work: the rows; left: what the other terms leave.
        basis: with an axis that leans; number: of the axis.
    """
    for change, part in FINER:
        now = basis.axes[number]
        axes = [now]
        for more in np.linspace(-change, change, 9):
            leant = replace(now, lean=now.lean * (1.0 + more))
            axes += _moved(leant, np.sort(_argument(work, leant)), _argument(work, now), now, part)
        basis = likeliest(work, left, [basis.with_axis(number, a) for a in axes])
    return basis


def _moved(leant: Axis, values: FloatArray, before: FloatArray, now: Axis, part: float) -> Iterator[Axis]:
    """An axis with its edge, or both edges of a band, at about as many rows as they had before it leant otherwise."""
    ranks = [
        np.clip([float(np.mean(before <= edge)) + part * more for more in PLACES], LEAST_SIDE, 1.0 - LEAST_SIDE)
        for edge in (now.edges or (now.at,))
    ]  # fmt: skip
    if now.kind == "peak":  # about as far up the rows
        middle = float(np.quantile(values, float(np.mean(before <= now.at))))
        for wider, moved in product(np.linspace(-part, part, 5), np.linspace(-part, part, 5)):
            yield replace(leant, at=middle + moved * now.width, width=now.width * (1.0 + 0.6 * wider))
        return
    if not now.edges:
        yield from (replace(leant, at=at) for at in _between(values, ranks[0]))
        return
    for low, high in product(*(tuple(_between(values, r[::2])) for r in ranks)):
        if low < high:
            yield replace(leant, edges=(low, high))


def _freed(work: Work) -> FloatArray:
    """What is left, weighted as if no rows shared errors, beside the constant where one is free."""
    if not work.data.calibrated:
        return work.bare
    power = max(float(work.direction @ work.direction), 1e-300)
    return np.asarray(work.bare - work.direction * float(work.direction @ work.bare) / power)


def _best_steps(work: Work, first: str, second: str) -> Iterator[tuple[Axis, float]]:
    """For each lean the step over two columns with the largest drop in the sum of squares, if no rows shared errors.

    And this drop.

    Whitened, what steps differ by counts for little: it says where a step may lie, and its evidence whether it does.
    """
    x, y = work.features[first], work.features[second]
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 2 or not (np.ptp(x[good]) > 0.0 and np.ptp(y[good]) > 0.0):
        return
    power, score = work.direction[good] ** 2, (work.direction * work.bare)[good]
    spans = float(np.ptp(x[good]) / np.ptp(y[good]))
    middle, width = float(0.5 * (x[good].min() + x[good].max())), float(np.ptp(x[good]))
    side = int(LEAST_SIDE * int(good.sum())) + 1
    alike = (1.0, -1.0) if unit_of(first) == unit_of(second) else ()  # a bearing, a difference of temperatures
    for lean in (*alike, *(sign * part * spans for part in LEANS for sign in (1.0, -1.0))):
        value = (x + lean * y)[good]
        order = np.argsort(value, kind="stable")
        parted = np.diff(value[order]) > 0.0
        parted[:side], parted[len(parted) - side :] = False, False
        if parted.any():
            drop = _drop(power[order], score[order], calibrated=work.data.calibrated)
            k = int(np.argmax(np.where(parted, drop, -1.0)))
            at = float(0.5 * (value[order[k]] + value[order[k + 1]]))
            step = Axis(column=first, beside=second, lean=lean, kind="step", middle=middle, width=width, at=at)
            yield step, float(drop[k])


def _drop(power: FloatArray, score: FloatArray, *, calibrated: bool) -> FloatArray:
    """Drop of the sum of squares by a step behind each of the ordered rows but the last, beside a free constant."""
    below, pull = np.cumsum(power)[:-1], np.cumsum(score)[:-1]
    above, push = power.sum() - below, score.sum() - pull
    whole = np.maximum(above, 1e-300)
    if not calibrated:
        return np.asarray(push**2 / whole)
    return np.asarray((push * below - pull * above) ** 2 / np.maximum(below * whole * power.sum(), 1e-300))


def _between(values: FloatArray, ranks: Sequence[float] | FloatArray) -> Iterator[float]:
    """Places halfway between neighbouring values at these shares of sorted rows."""
    for rank in ranks:
        k = min(int(rank * len(values)), len(values) - 2)
        yield float(0.5 * (values[k] + values[k + 1]))


def _argument(work: Work, axis: Axis) -> FloatArray:
    return np.nan_to_num(work.features[axis.column] + axis.lean * work.features[axis.beside])
