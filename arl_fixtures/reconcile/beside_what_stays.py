"""A round asked again for what comes and goes, where nothing that may be named explains what stays.

A scene that is not quite the simulation's, or through few rays, changes some rows by more than all else, by the same
in every step. No effect of the library need say it, and what explains a part of it gains most. It must not hide what
differs from step to step: beside a free value of all that each place sees, only that can gain.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.acceptance import PRICE
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.fit import Fit, finish, fit
from arl_fixtures.reconcile.noise import level_of
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.rivals import is_structure
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.screen import Screening
from arl_fixtures.reconcile.step_means import places_of
from arl_fixtures.reconcile.terms import forward

if TYPE_CHECKING:
    from arl_fixtures.reconcile.search import Search, Stage

_PLACE = "place"
_FEWEST_SEEN = 3.0
"""Rows of a place, in steps of their own, from which what stays there is told from what comes and goes."""


def beside_what_stays(search: Search, stage: Stage, chance: Screening) -> Stage:
    """The round beside free values of what each place sees, where it has chosen nothing; else the same.

    In further rounds in channels on which a name acts: what is hidden in others is looked for by itself.
    """
    terms, untouched = stage.base.terms, search.full.view.sim
    names = {
        d.channel.name for d in search.full.data
        if _has_places(search, d) and (not terms or stage.base.state[d.channel.name] is not untouched[d.channel.name])
    }  # fmt: skip
    if stage.chosen is not None or not names:
        return stage
    problems = [search.full] if search.small is search.full else [search.full, search.small]
    with ExitStack() as stack:
        for problem in problems:
            stack.enter_context(_places_free(problem, names))
        bare = finish(search.full, fit(search.full, terms))
        search.full.refit_scatter(bare.state)
        if search.small is not search.full:
            search.small.refit_scatter(forward(terms, search.small.view))
        again = search.ask(bare, search.candidates(terms, with_chance=False), chance)
    if again.chosen is None or not _means(again.chosen.candidate.term.variant.channels) <= names:
        return stage
    found = finish(search.full, fit(search.full, again.chosen.fit.terms, rounds=4))
    return replace(again, base=stage.base, ranked=[again.chosen], chosen=replace(again.chosen, fit=found))


def worth_beside_what_stays(search: Search, best: Fit, without: Fit) -> float:
    """What a fit gains over one that lacks some of its terms, beside free values of what each place sees."""
    names = {d.channel.name for d in search.full.data if _has_places(search, d)}
    if not names:
        return -np.inf
    with _places_free(search.full, names):
        gained = search.full.log_likelihood(best.state) - search.full.log_likelihood(without.state)
    return gained - PRICE * (len(best.keys) - len(without.keys))


def _means(channels: Collection[str]) -> set[str]:
    return {name for name in channels if not name.endswith("_std")}


def _has_places(search: Search, d: ChannelData) -> bool:
    """Whether a channel of means has a mismatch, and sees each place in several steps."""
    if d.channel.role is Role.SCATTER or not is_structure(search.before[d.channel.name]):
        return False
    level = d.level("step")
    if level is None or level.count < _FEWEST_SEEN:
        return False
    place = places_of(search.full)[d.use]
    seen = len(np.unique(np.column_stack([place, level.code]), axis=0)) / len(np.unique(place))
    return bool(seen >= _FEWEST_SEEN)


@contextmanager
def _places_free(problem: Problem, names: set[str]) -> Iterator[None]:
    """A problem in which all that the same place shows may be off by an amount of its own."""
    kept = [(d, d.levels, d.tau) for d in problem.data]
    place = places_of(problem)
    for d, levels, tau in kept:
        level = level_of(_PLACE, place[d.use], d.scale)
        if level is not None and d.channel.name in names:
            d.levels = (*levels, level)
            d.rebuild({**tau, _PLACE: 0.0})
    try:
        yield
    finally:
        for d, levels, tau in kept:
            d.levels = levels
            d.rebuild(tau)
