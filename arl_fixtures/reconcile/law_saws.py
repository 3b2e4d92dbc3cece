"""Ramps that fall back once a period: a laser that jumps to its next mode, a phase that wraps, a counter's end.

A wave says three fifths of one and a table over the period blurs its fall. Where the fall lies and how long the
period is are looked for ever finer, from a wave's period on.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import FEWEST_TURNS
from arl_fixtures.reconcile.law_work import Work

FALLS = (1.0, 0.1, 0.02)
"""Parts of a period within which a ramp over it may fall back, and halves of turns over the column's span by which
that is made shorter or longer: looked at ever finer."""
PRICE_FALL = 4.0
"""Price beyond a wave's: of where a ramp falls, and of how long it is, there are many to try."""
_FEWEST_LEVELS, _LENGTHS = 8, 25
"""Values of a column over which a ramp is sought, and lengths that are tried in each round."""
_RANK = 1e-9
"""Share of all weight below which a ramp differs from a constant by rounding."""


def saw_axis(column: str, period: float, fall: float) -> Axis:
    """A ramp over each period of a column, from -1/2 to 1/2, that falls back at one place."""
    return Axis(column=column, kind="saw", at=period, middle=fall)


def saws_about(column: str, span: float, turns: float, fall: float, reach: float) -> Iterator[Axis]:
    """Ramps about one of some turns over a span, to within a reach of `FALLS`; of all falls more of them."""
    fine = 3 if reach == FALLS[0] else 1  # a ramp that falls a level too early or too late is hardly one
    for more in turns + np.linspace(-1.0, 1.0, 8 * fine + 1) * 0.5 * reach:
        for at in fall + np.linspace(-0.5, 0.5, 16 * fine + 1) * reach * span / turns:
            yield saw_axis(column, span / more, at)


def best_saw(work: Work, name: str, turns_per_unit: float) -> Axis | None:
    """The ramp over a column that lowers the sum of squares most, beside a constant; None for columns of few values.

    Args:
        work: the rows; name: of the column.
        turns_per_unit: of the strongest wave over it.
    """
    x = work.features[name]
    good = np.isfinite(x)
    levels, code = np.unique(x[good], return_inverse=True)
    if len(levels) < _FEWEST_LEVELS:
        return None
    span = float(levels[-1] - levels[0])
    turns, fall = turns_per_unit * span, 0.0
    if turns < FEWEST_TURNS:
        return None
    score = np.bincount(code, (work.direction * work.residual)[good]).astype(np.float64)
    weight = np.bincount(code, work.direction[good] ** 2).astype(np.float64)
    score = score - weight * (score.sum() / max(float(weight.sum()), 1e-300))
    for reach in FALLS:
        tried = turns + np.linspace(-1.0, 1.0, _LENGTHS) * 0.5 * reach
        found = [_best_fall(levels * (more / span), score, weight) for more in tried]
        _, fall, turns = max((drop, fall, float(more)) for (drop, fall), more in zip(found, tried, strict=True))
    period, middle = span / turns, float(levels.mean())
    at = fall * period
    return saw_axis(name, period, at + period * round((middle - at) / period))


def _best_fall(place: FloatArray, score: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """What a ramp lowers the sum of squares by, beside a constant, and the phase at which it falls then.

    Up to the fall a level lies one turn further than its phase says: all falls are sums over the phases in order.

    Args:
        place: of the levels, turns; score: sums over their rows, beside a constant; weight: likewise.
    """
    phase = np.mod(place, 1.0)
    order = np.argsort(phase, kind="stable")
    phase, score, weight = phase[order], score[order], weight[order]
    pull = float(score @ phase) + np.cumsum(score)
    total = max(float(weight.sum()), 1e-300)
    mean = (float(weight @ phase) + np.cumsum(weight)) / total
    power = float(weight @ phase**2) + np.cumsum(weight * (2.0 * phase + 1.0)) - total * mean**2
    drop = np.divide(pull**2, power, out=np.zeros_like(pull), where=power > _RANK * total)
    k = int(np.argmax(drop))
    further = phase[k + 1] if k + 1 < phase.size else phase[0] + 1.0
    return float(drop[k]), 0.5 * float(phase[k] + further)
