"""Which rows the pictures show: those of the search, or of a larger table others that it never looked at.

A table that was searched whole is shown whole, each block with parameters from the other blocks. Of a larger one the
search drew some pixels or angles; a picture of the same rows would be a picture of the draw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.carried_gains import carry_gains
from arl_fixtures.reconcile.decide import Decision
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.pilot import TAIL_Z
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.terms import forward
from arl_fixtures.reconcile.turned import features_for

SHOWN_ROWS = 60_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Rows of the pictures, and their simulated values.

    Attributes:
        problem: the rows with weights and groups.
        before, after: simulated values without and with the findings.
        fresh: whether the search never looked at these rows.
    """

    problem: Problem
    before: State
    after: State
    fresh: bool


def shown_rows(decision: Decision) -> Shown:
    """Rows to show of a decision's table; the same table gives the same rows."""
    searched = decision.problem
    if searched.columns.n < 2 * searched.view.n:
        return Shown(
            problem=searched, before=searched.view.fresh_state(), after=decision.cross_fitted(), fresh=False
        )  # fmt: skip
    others = np.ones(searched.columns.n, dtype=bool)
    others[searched.view.rows] = False
    rows = np.flatnonzero(others)
    if len(rows) > SHOWN_ROWS:
        rows = np.sort(np.random.default_rng(11).choice(rows, SHOWN_ROWS, replace=False))
    problem = Problem(searched.columns, rows, searched.groups)
    after = forward(decision.terms, problem.view)
    if decision.laws:
        features = features_for(problem.view, decision.laws)
        for law in decision.laws:
            after[law.channel] = after[law.channel] + law.correction(features, after[law.channel])
    _weigh_alike(problem, searched, after)
    carry_gains(problem, after)
    return Shown(problem=problem, before=problem.view.fresh_state(), after=after, fresh=True)


def _weigh_alike(problem: Problem, searched: Problem, after: State) -> None:
    """Give rows the spread that the search found, and hold outliers back where it did."""
    for d in problem.data:
        like = next((s for s in searched.data if s.channel.name == d.channel.name), None)
        if like is None:
            continue
        d.spread = like.spread
        if like.trust.min() < 1.0:
            residual = d.residual(after)
            beyond = np.abs(residual - np.median(residual)) / (d.stated * d.spread)
            d.trust = np.minimum(1.0, TAIL_Z / np.maximum(beyond, 1e-9))
        d.rebuild({})
