"""The part of a large table that ranks candidates, and how it looks where steps or pixels are taken to share less."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.noise import ordered_like
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.sampling import draw_rows

SMALL_ROWS = 14_000
STEP_SHARE, LARGE_STEPS = 0.3, 1.5
"""Share of the steps' scatter with which candidates are screened anew, where it is that much larger than stated."""
START_SHARES = (STEP_SHARE, 0.0)
"""Shares from which they are fitted: a law may be all of what steps seem to scatter where nobody says how much they
do, and rows whose temperature was read a little off hold it back while steps count for next to nothing."""


def small_part(full: Problem) -> Problem:
    """A problem of fewer rows with the same noise; the full one where it is small itself."""
    if full.view.n <= 1.4 * SMALL_ROWS:
        return full
    rows = draw_rows(full.columns, full.groups, SMALL_ROWS)
    inside = np.intersect1d(rows, full.view.rows)
    if len(inside) < 0.5 * SMALL_ROWS:
        inside = full.view.rows[(np.arange(SMALL_ROWS) * (full.view.n / SMALL_ROWS)).astype(int)]
    small = Problem(full.columns, inside, full.groups)
    for part in small.data:
        whole = next(d for d in full.data if d.channel.name == part.channel.name)
        place = np.searchsorted(full.view.rows[whole.use], small.view.rows[part.use])
        part.trust, part.spread = whole.trust[place], whole.spread
        part.levels = ordered_like(whole.levels, part.levels)
        part.dark = whole.dark[place] if len(whole.dark) else whole.dark
        if not part.stated_known:
            part.stated = whole.stated[place]
        part.rebuild(whole.tau)
    return small


@contextmanager
def steps_alike(problem: Problem, state: State, share: float = STEP_SHARE) -> Iterator[float]:
    """A problem with a share of the steps' scatter where it is large, at least what is stated or as little as their
    rows leave uncertain; yields what that costs a state."""
    handicap = 0.0
    with problem.keeping_scatters():
        for d in problem.data:
            tau, level = d.tau, d.level("step")
            least = max(level.floor, d.alone(level)) if level is not None else np.inf
            if tau.get("step", 0.0) < LARGE_STEPS * least or (level is not None and level.declared and share == 0.0):
                continue
            before = d.likelihood(d.residual(state))
            d.rebuild({**tau, "step": max(share * tau["step"], least)})
            handicap += before - d.likelihood(d.residual(state))
        yield handicap


@contextmanager
def pixels_alike(problem: Problem) -> Iterator[None]:
    """A problem whose pixels share no scatter of their own."""
    with problem.keeping_scatters():
        for d in problem.data:
            if d.tau.get("pixel", 0.0) > 0.0:
                d.rebuild({**d.tau, "pixel": 0.0})
        yield
