"""Where the kinks and steps of a law's terms lie: the search takes them from a coarse grid, the data place them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.law import thresholds
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_fit import Chosen, joint
from arl_fixtures.reconcile.law_work import Work

PLACES = tuple(np.linspace(0.04, 0.96, 24))
"""Shares of a column's rows at which a kink is tried."""
KINKED = frozenset({"above", "below", "step"})
LEAST_BETTER = 1.0
"""Log-likelihood on unseen blocks by which another place must do better than the one of the grid."""


def sharpened(work: Work, chosen: Chosen) -> Chosen:
    """A law whose kinks and steps lie where unseen blocks like them best, one after the other."""
    for place, term in enumerate(chosen.terms):
        if term.basis.waves:
            continue
        for number, axis in enumerate(term.basis.axes):
            if axis.kind not in KINKED:
                continue
            left = joint(work, [t for k, t in enumerate(chosen.terms) if k != place]).left
            best, basis = chosen, chosen.terms[place].basis
            placed = [replace(axis, at=at) for at in _places(work, axis.column)]
            moved = [(*basis.axes[:number], other, *basis.axes[number + 1 :]) for other in placed]
            for item in Candidates(work, left).add(replace(basis, axes=axes) for axes in moved):
                trial = joint(work, [*chosen.terms[:place], item, *chosen.terms[place + 1 :]])
                if trial.held > max(best.held, chosen.held + LEAST_BETTER):
                    best = trial
            chosen = best
    return chosen


def _places(work: Work, column: str) -> list[float]:
    values = work.features[column]
    return thresholds(values[np.isfinite(values)], PLACES)
