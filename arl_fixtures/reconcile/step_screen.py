"""Candidates screened with less scatter of the steps than these seem to have: what a law explains may pass for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effect import Effect, State, Variant
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.scores import Candidate
from arl_fixtures.reconcile.screen import LEAST_GAIN, Screening, screen
from arl_fixtures.reconcile.small_problem import steps_alike
from arl_fixtures.reconcile.terms import Term, forward

SMALL_SHARE = 0.03
"""Share of the steps' scatter at which a law's own remainder is measured."""
FEW_STEPS = 15
"""Steps of a channel up to which that is asked: of more a law gains enough with a share of their scatter."""
LEAST_LEFT = 1e-4
"""Of that share's square, the least that a remainder counts."""


def where_steps_scatter_less(
    problem: Problem, variants: Sequence[tuple[Effect, Variant]], terms: Sequence[Term], found: Screening
) -> Screening:
    """What a screening found, with what candidates gain where steps scatter less.

    With a share of the scatter; and, of what moves no edges, with the scatter that a candidate itself leaves: of few
    steps a law that is nearly all of what they differ by gains little before.

    Args:
        problem: with the scatters of `found`.
        variants, terms: that were screened.
        found: with the steps' whole scatter.
    """
    state = forward(terms, problem.view)
    best = {c.term.label: c for c in found.candidates}
    whole = dict(best)
    with steps_alike(problem, state) as handicap:
        again = screen(problem, variants, terms).candidates if handicap > 0.0 else ()
    for c in again:
        _raise(best, replace(c, gain=c.gain - handicap))
    still = [(e, v) for e, v in variants if not (v.rough or e.displaces or e.mixes)]
    taus, squares = [d.tau.get("step", 0.0) for d in problem.data], _squares(problem, state)
    with steps_alike(problem, state, SMALL_SHARE) as handicap:
        less = [d for d, tau in zip(problem.data, taus, strict=True) if d.tau.get("step", 0.0) < tau]
        steps = sum(level.count for level in (d.level("step") for d in less) if level is not None)
        if not 0 < steps <= FEW_STEPS * len(less):
            return _in_order(found, best)
        grown = _squares(problem, state) - squares
        again = screen(problem, still, terms).candidates
    for c in again:
        within = whole[c.term.label].gain if c.term.label in whole else 0.0
        left = max(grown - 2.0 * (c.gain - within), LEAST_LEFT * steps)
        gain = c.gain - handicap + 0.5 * (left - steps - steps * float(np.log(left / steps)))
        # a start that is good in its own right is no worse for what steps hide
        _raise(best, replace(whole[c.term.label] if within > LEAST_GAIN else c, gain=gain))
    return _in_order(found, best)


def _in_order(found: Screening, best: dict[str, Candidate]) -> Screening:
    return replace(found, candidates=tuple(sorted(best.values(), key=lambda c: (-c.gain, c.term.label))))


def _raise(best: dict[str, Candidate], candidate: Candidate) -> None:
    seen = best.get(candidate.term.label)
    if candidate.gain > (seen.gain if seen is not None else 0.0):
        best[candidate.term.label] = candidate


def _squares(problem: Problem, state: State) -> float:
    """Sum of squares of a state's whitened residuals."""
    z = problem.whiten_state(state)
    return float(z @ z)
