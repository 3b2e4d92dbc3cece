"""Where a law's kinks and steps lie, and how long its waves are: the search takes them from a coarse grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import Axis, thresholds
from arl_fixtures.reconcile.law_basis import FEWEST_TURNS, Basis, folded
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_fit import Chosen, joint
from arl_fixtures.reconcile.law_lean import refined_lean
from arl_fixtures.reconcile.law_peaks import refined_peak
from arl_fixtures.reconcile.law_saws import FALLS, PRICE_FALL, saws_about
from arl_fixtures.reconcile.law_work import Work

PLACES = tuple(np.linspace(0.04, 0.96, 24))
"""Shares of a column's rows at which a kink is tried."""
KINKED = frozenset({"above", "below", "step"})
LEAST_BETTER = 1.0
"""Log-likelihood on unseen blocks by which another place must do better than the one of the grid."""
TURNS = (tuple(np.linspace(-0.125, 0.125, 11)), tuple(np.linspace(-0.02, 0.02, 9)))
"""Turns over a column's span by which a wave is made shorter or longer: the grid's spacing, then a part of it."""
LONGER = 0.5
"""Log-likelihood by which another length must fit better: what lies within an error keeps the grid's."""


def sharpened(work: Work, chosen: Chosen) -> Chosen:
    """A law whose kinks and steps lie where unseen blocks like them best, and whose waves are as long as fits."""
    for place, term in enumerate(chosen.terms):
        for column, period in _periods(term.basis):
            chosen = _tuned(work, chosen, place, column, period)
        chosen = _sawn(work, chosen, place)
        if term.basis.waves:
            continue
        for number, axis in enumerate(term.basis.axes):
            if axis.kind not in KINKED and axis.kind != "peak" and not axis.beside:
                continue
            left = joint(work, [t for k, t in enumerate(chosen.terms) if k != place]).left
            best, basis = chosen, chosen.terms[place].basis
            for item in Candidates(work, left).add(_others(work, left, basis, number)):
                trial = joint(work, [*chosen.terms[:place], item, *chosen.terms[place + 1 :]])
                if trial.held > max(best.held, chosen.held + LEAST_BETTER):
                    best = trial
            chosen = best
    return chosen


def _sawn(work: Work, chosen: Chosen, place: int) -> Chosen:
    """A law with a ramp that falls back once a period, for a table, a wave or a ramp, where that says as much."""
    term = chosen.terms[place]
    swinging = _swinging(term.basis)
    if swinging is None:
        return chosen
    axis, basis, number = swinging
    values = work.features[axis.column]
    span = float(np.nanmax(values) - np.nanmin(values))
    if span < FEWEST_TURNS * axis.at:
        return chosen
    left = joint(work, [t for k, t in enumerate(chosen.terms) if k != place]).left
    is_saw = axis.kind == "saw"
    # from the middle a fall hardly moves as the period does
    turns, fall, best = span / axis.at, axis.middle if is_saw else float(np.nanmean(values)), term
    for reach in FALLS[1:] if is_saw else FALLS:
        saws = [basis.with_axis(number, saw) for saw in saws_about(axis.column, span, turns, fall, reach)]
        best = max(Candidates(work, left).add(saws), key=lambda item: item.gain)
        found = best.basis.axes[number]
        turns, fall = span / found.at, found.middle
    trial = joint(work, [*chosen.terms[:place], best, *chosen.terms[place + 1 :]])
    return trial if best.gain > term.gain and trial.held > chosen.held - LEAST_BETTER else chosen


def _swinging(basis: Basis) -> tuple[Axis, Basis, int] | None:
    """What swings in a basis: its axis, the basis with one function over that, and where it stands there."""
    if not basis.waves:
        found = (k for k, a in enumerate(basis.axes) if a.kind == "saw" or (a.is_open and _swings(a)))
        number = next(found, None)
        return None if number is None else (basis.axes[number], replace(basis, prior=None), number)
    first = basis.waves[0]
    places = [k for k, axis in enumerate(first) if axis.kind in {"sin", "cos"}]
    if len(places) != 1 or len(basis.waves) != 2 or not _swings(first[places[0]]):
        return None  # rings that move, or harmonics
    axis = first[places[0]]
    rest = tuple(a for a in first if a is not axis)
    if any(tuple(a for a in product if a.kind not in {"sin", "cos"}) != rest for product in basis.waves):
        return None
    return axis, replace(basis, axes=(axis, *rest), waves=(), price=basis.price + PRICE_FALL), 0


def _others(work: Work, left: FloatArray, basis: Basis, number: int) -> Iterator[Basis]:
    """Bases with one axis elsewhere: at other places, or the likeliest one of all leans, or of all peaks."""
    axis = basis.axes[number]
    if axis.beside:
        yield refined_lean(work, left, basis, number)
    elif axis.kind == "peak":
        yield refined_peak(work, left, basis, number)
    else:
        yield from (basis.with_axis(number, replace(axis, at=at)) for at in _places(work, axis.column))


def _tuned(work: Work, chosen: Chosen, place: int, column: str, period: float) -> Chosen:
    """A law with the length of one wave at its likeliest, unless unseen blocks like that less."""
    values = work.features[column]
    span = float(np.nanmax(values) - np.nanmin(values))
    left = joint(work, [t for k, t in enumerate(chosen.terms) if k != place]).left
    for turns in TURNS:
        now = chosen.terms[place].basis
        lengths = [span / max(span / period + more, 1.0 / 3.0) for more in turns]
        items = Candidates(work, left).add([now, *(_of_length(now, column, period, other) for other in lengths)])
        own = items[0]
        best, length = max(zip(items, [period, *lengths], strict=True), key=lambda pair: pair[0].gain)
        trial = joint(work, [*chosen.terms[:place], best, *chosen.terms[place + 1 :]])
        if best.gain > own.gain + LONGER and trial.held > chosen.held - LEAST_BETTER:
            chosen, period = trial, length
    return chosen


def _periods(basis: Basis) -> list[tuple[str, float]]:
    """Columns over which a basis swings, and with what period; no parts of a full turn, nor of an image."""
    found = {(a.column, a.at) for product in (basis.axes, *basis.waves) for a in product if _swings(a)}
    return sorted(found) if len({column for column, _ in found}) == len(found) else []


def _swings(axis: Axis) -> bool:
    if axis.kind == "table":
        return axis.at > 0.0 and axis == folded(axis.column, 1.0 / axis.at)
    parts = 360.0 / axis.at if axis.at else 0.0
    return axis.kind in {"sin", "cos"} and not (axis.column.endswith("_deg") and abs(parts - round(parts)) < 1e-9)


def _of_length(basis: Basis, column: str, period: float, other: float) -> Basis:
    """The same basis with waves of another period over a column."""

    def changed(product: tuple[Axis, ...]) -> tuple[Axis, ...]:
        return tuple(
            (folded(column, 1.0 / other) if a.kind == "table" else replace(a, at=other))
            if a.column == column and a.at == period and _swings(a) else a
            for a in product
        )  # fmt: skip

    return replace(basis, axes=changed(basis.axes), waves=tuple(changed(product) for product in basis.waves))


def _places(work: Work, column: str) -> list[float]:
    values = work.features[column]
    return thresholds(values[np.isfinite(values)], PLACES)
