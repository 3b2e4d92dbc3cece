"""Pixels that died are left out while names are sought: their rows are off by everything and tell of nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import Effect
from arl_fixtures.reconcile.patterns import Pattern, find_patterns
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.terms import Term, forward

LOST = 0.3
"""Share of its value from which what a pattern changes in a row leaves nothing to compare."""
MOST_LOST = 0.2
"""Share of a channel's rows above which these are no few dead pixels."""


def leave_out_dead(problem: Problem, effects: Sequence[Effect]) -> bool:
    """Leave out the rows of which a pattern of few pixels takes most; False where there are none."""
    sparse = [e for e in effects if e.sparse]
    found = find_patterns(problem, sparse, ()) if sparse else []
    if not found:
        return False
    base = problem.view.fresh_state()
    dead = forward([found[0].term], problem.view)
    for d in problem.data:
        name = d.channel.name
        if dead[name] is base[name]:
            continue
        lost = _lost(base[name], dead[name])[d.use]
        if 0.0 < float(np.mean(lost)) < MOST_LOST:
            d.dark = lost
            d.rebuild(d.tau)
    return any(len(d.dark) for d in problem.data)


def leave_out_their_scatter(problem: Problem, patterns: Sequence[Pattern]) -> None:
    """Leave out what dead pixels scatter, be it nothing or a dark reading's noise: it has no cause of its own."""
    base = problem.view.fresh_state()
    for term in (p.term for p in patterns if p.term.effect.sparse):
        dead = forward([term], problem.view)
        for d in problem.data:
            parent = d.channel.parent
            if d.channel.role is Role.SCATTER and parent in dead and dead[parent] is not base[parent]:
                d.dark = _lost(base[parent], dead[parent])[d.use]
                d.rebuild(d.tau)


def _lost(alive: FloatArray, dead: FloatArray) -> NDArray[np.bool_]:
    return np.abs(dead - alive) > LOST * np.abs(alive)


def bring_back(problem: Problem) -> None:
    """All rows count again."""
    for d in problem.data:
        if len(d.dark):
            d.dark = np.zeros(0, dtype=bool)
            d.rebuild(d.tau)


def dead_first(
    problem: Problem, effects: Sequence[Effect], terms: Sequence[Term], found: Sequence[Pattern]
) -> list[Pattern]:
    """Patterns, dead pixels before a pattern of gains that finds nothing in the pixels that live.

    A gain of −1 says of a dead pixel what its death says, and a little of its noise.
    """
    ranked = list(found)
    if not ranked or ranked[0].term.effect.sparse or not any(p.term.effect.sparse for p in ranked):
        return ranked
    if not leave_out_dead(problem, effects):
        return ranked
    alive = find_patterns(problem, [e for e in effects if not e.sparse], terms)
    bring_back(problem)
    return ranked if alive else sorted(ranked, key=lambda p: not p.term.effect.sparse)
