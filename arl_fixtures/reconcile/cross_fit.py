"""What effects predict of rows that took no part in fitting them: each fold with the parameters of the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.fit import Fit, with_vector
from arl_fixtures.reconcile.problem import FOLDS, Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.terms import Term, forward


def cross_fitted(problem: Problem, best: Fit, patterns: Sequence[Term], final: State) -> State:
    """Corrected simulation in which each fold's rows use parameters of the other folds (one Newton step).

    Args:
        problem: its rows and folds.
        best: the accepted effects.
        patterns: free patterns beside them, kept as they are.
        final: corrected simulation with effects, patterns and laws.
    """
    if not best.keys:
        return final
    base = forward((*best.terms, *patterns), problem.view)
    fold = np.concatenate([d.fold for d in problem.data])
    result = {name: values.copy() for name, values in final.items()}
    for k in range(FOLDS):
        state = _without(problem, best, patterns, fold == k, base)
        rows = problem.fold == k
        for d in problem.data:
            if d.calibrated:
                _recalibrate(d, state, base, d.fold != k)
        for name in result:
            result[name][rows] = (state[name] + (final[name] - base[name]))[rows]
    return result


def _recalibrate(d: ChannelData, state: State, base: State, seen: NDArray[np.bool_]) -> None:
    """Let each unit's gain or offset, too, be the one that the seen rows have beside their parameters.

    A displacement towards a target and an offset of the range are nearly the same: each fold has another of either.
    """
    name = d.channel.name
    along = base[name][d.use] if d.channel.role is Role.INTENSITY else np.ones(len(d.use))
    change, weight = (state[name] - base[name])[d.use], d.root_weight**2 * along * seen
    power = np.bincount(d.unit, weight * along, minlength=d.units)
    constant = np.bincount(d.unit, weight * change, minlength=d.units) / np.where(power > 0.0, power, np.inf)
    state[name] = state[name].copy()
    state[name][d.use] -= along * constant[d.unit]


def _without(problem: Problem, best: Fit, patterns: Sequence[Term], unseen: NDArray[np.bool_], base: State) -> State:
    """Corrected simulation with the effects as the other rows have them.

    The step is halved until it serves these rows: along what they hardly tell, a Newton step leads anywhere.
    """
    vector, train = best.values(), ~unseen
    scale = np.sqrt(np.maximum(np.diag(best.jacobian.T @ best.jacobian), 1e-300))
    jacobian = best.jacobian[train] / scale
    low, high = (np.array([getattr(p, end) for _, p in best.keys]) for end in ("low", "high"))
    gram = jacobian.T @ jacobian + 1e-6 * np.eye(len(vector))
    shift = np.linalg.lstsq(gram, jacobian.T @ best.residual[train], rcond=1e-10)[0] / scale
    left = float(np.sum(problem.whiten_state(base)[train] ** 2))
    for share in (1.0, 0.5, 0.25, 0.1):
        terms = with_vector(best.terms, best.keys, np.clip(vector + share * shift, low, high))
        state = forward((*terms, *patterns), problem.view)
        if float(np.sum(problem.whiten_state(state)[train] ** 2)) <= left:
            return state
    return base
