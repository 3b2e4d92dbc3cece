"""After a further effect: is each earlier one still needed, and would another one do better in its place?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations
from typing import TYPE_CHECKING

from arl_fixtures.reconcile.acceptance import PATTERN_ODDS, TWIN_GAIN, evidence, is_repeat, worth
from arl_fixtures.reconcile.answered import in_place_of_others
from arl_fixtures.reconcile.fit import Fit, finish, fit
from arl_fixtures.reconcile.misfit import is_misfit
from arl_fixtures.reconcile.noise import scale_of
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.scores import Candidate
from arl_fixtures.reconcile.screen import screen
from arl_fixtures.reconcile.terms import Term, forward

if TYPE_CHECKING:
    from arl_fixtures.reconcile.search import Search, Stage

SHORTLIST, PER_EFFECT = 16, 2
OPTIONS, MOST_WIDE = 6, 12
"""Candidates that are tried in the place of an effect, and variants that may depend on all that drives two."""


def settle(search: Search, chosen: Fit, stage: Stage) -> Fit:
    """Swap pass: would another effect in an earlier place do better now? Backward pass: is each still needed?"""
    best, problem = chosen, search.full
    if len(best.terms) < 2:
        return best
    for index in range(len(best.terms) - 1):
        rest = tuple(t for k, t in enumerate(best.terms) if k != index)
        without = finish(problem, fit(problem, rest, rounds=4))
        if worth(best, without) < PATTERN_ODDS * stage.threshold:
            return settle(search, without, stage) if len(rest) > 1 else without
        best = _swapped(search, best, rest, best.terms[index].label, stage)
    return in_place_of_others(problem, _as_one(search, best, stage))


def in_each_place(search: Search, best: Fit, stage: Stage) -> Fit:
    """Swap pass over all effects, the last one included: of some other variants may do better now."""
    for index, term in enumerate(best.terms):
        rest = tuple(t for k, t in enumerate(best.terms) if k != index)
        best = _swapped(search, best, rest, term.label, stage)
    return best


def _as_one(search: Search, best: Fit, stage: Stage) -> Fit:
    """The fit with one effect in the place of two, where one that depends on all that drives them says as much."""
    problem = search.full
    for one, other in combinations(best.terms, 2):
        if one.unit != other.unit or not set(one.variant.channels) & set(other.variant.channels):
            continue
        driven = {*one.variant.drivers, *other.variant.drivers}
        wide = [(e, v) for e, v in search.variants if driven <= set(v.drivers)]
        if not 0 < len(wide) <= MOST_WIDE:  # drivers that many share tell nothing of one cause
            continue
        rest = tuple(t for t in best.terms if t is not one and t is not other)
        with following((problem, search.small), rest):
            without, needed = _beside(problem, best, rest)
            alone = [c for c in screen(search.small, wide, rest).candidates if not c.term.unit]
            ranked = search.rank(without, alone[:OPTIONS])
        sure = [r for r in ranked if evidence(r, search.surcharge) > stage.threshold and r.gain > needed - TWIN_GAIN]
        if sure:
            return finish(problem, fit(problem, sure[0].fit.terms, rounds=2))
    return best


def _beside(problem: Problem, best: Fit, rest: tuple[Term, ...]) -> tuple[Fit, float]:
    """The fit of the `rest` alone, and what the others of a fit's terms gain beside it, less their price."""
    without = finish(problem, fit(problem, rest, rounds=4))
    return without, worth(finish(problem, fit(problem, best.terms, rounds=2)), without)


def _swapped(search: Search, best: Fit, rest: tuple[Term, ...], label: str, stage: Stage) -> Fit:
    """The fit with another effect in the place of `label`, if one that may be named does better; else as it was.

    All are judged as in a round: gains of pixels and units belong to what the `rest` corrects. Gains that followed
    the effect to be replaced would bring it back under any name that switches the rest of a signal off.
    """
    problem = search.full
    with following((problem, search.small), rest):
        without, needed = _beside(problem, best, rest)
        again = screen(search.small, search.variants, rest)
        others = [c for c in again.candidates if not is_repeat(without, c)]
        ranked = search.rank(without, shortlist(others)[:OPTIONS])
        # the effect itself is fitted like the others: from its start, and with less scatter of the steps, too
        needed = max([needed, *(r.gain for r in ranked if r.candidate.term.label == label)])
        better = [r for r in ranked if r.candidate.term.label != label and r.gain > needed + 1.0]
        gains = gains_of(problem, without) if better else {}
        named = [
            r for r in better
            if evidence(r, search.surcharge) > stage.threshold and not is_misfit(problem, without, r, gains)
        ]  # fmt: skip
    return finish(problem, fit(problem, named[0].fit.terms, rounds=2)) if named else best


@contextmanager
def following(problems: Sequence[Problem], terms: Sequence[Term]) -> Iterator[None]:
    """Problems whose gains and shared errors are parts of what `terms` correct, for as long as that is asked for."""
    kept = [(d, d.scale, d.levels, d.tau) for problem in problems for d in problem.data]
    for problem in problems:
        state = forward(terms, problem.view)
        for d in problem.data:
            if d.channel.role is Role.INTENSITY:
                d.relate_to(scale_of(state[d.channel.name][d.use]))
                d.rebuild(d.tau)
    try:
        yield
    finally:
        for d, scale, levels, tau in kept:
            d.scale, d.levels = scale, levels
            d.rebuild(tau)


def gains_of(problem: Problem, best: Fit) -> dict[int, float]:
    """How much each effect gains beside the others."""
    gains = {}
    for index in range(len(best.terms)):
        rest = tuple(t for k, t in enumerate(best.terms) if k != index)
        gains[index] = 0.5 * (fit(problem, rest, rounds=2).chi2 - best.chi2)
    return gains


def shortlist(
    candidates: Sequence[Candidate], size: int = SHORTLIST, per_effect: int = PER_EFFECT
) -> list[Candidate]:
    """The best candidates, at most so many of one effect and one of each variant's twins."""
    counts: dict[str, int] = {}
    chosen: list[Candidate] = []
    for candidate in candidates:
        name = candidate.term.effect.id
        if counts.get(name, 0) < per_effect:
            counts[name] = counts.get(name, 0) + 1
            chosen.append(candidate)
        if len(chosen) == size:
            break
    return chosen
