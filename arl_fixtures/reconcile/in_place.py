"""Other effects in the place of a name: what each of them loses, and whether the table tells the two apart."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from arl_fixtures.reconcile.acceptance import PRICE, Ranked
from arl_fixtures.reconcile.effects_render import rendered
from arl_fixtures.reconcile.fit import Fit, finish, fit
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.scores import Candidate
from arl_fixtures.reconcile.screen import screen
from arl_fixtures.reconcile.settling import shortlist
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.told_apart import LIKE_SHARE, TWIN_GAIN, alike, idle_price, is_undecided

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

MOST_TRIED = 10
LEAST_SHARED = 0.25
"""Squared cosine between two changes up to which what says far more than a name says something else."""


class InPlace(NamedTuple):
    """An effect that was fitted in a name's place.

    Attributes:
        ranked: beside the remaining names.
        deficit: log-likelihood that it gains less, both charged for their parameters.
        alike: whether that does not tell it from the name.
    """

    ranked: Ranked
    deficit: float
    alike: bool


def without_name(decision: Decision, index: int) -> tuple[Fit, float]:
    """What stands without one of the names, refitted, and the log-likelihood that the name gains beside it."""
    rest = tuple(t for k, t in enumerate(decision.best.terms) if k != index)
    without = finish(decision.problem, fit(decision.problem, rest, rounds=3))
    return without, finish(decision.problem, decision.best).log_likelihood - without.log_likelihood


def charged(term: Term, gain: float) -> float:
    """What a name gains, less the price of its parameters."""
    return gain - PRICE * len(term.free())


def others_in_place(decision: Decision, index: int, without: Fit, gain: float) -> Iterator[InPlace]:
    """Each other effect once, by its best variant, the likeliest first.

    Args:
        decision: with its names; index: of the one in whose place they are tried.
        without, gain: see `without_name`.
    """
    term = decision.best.terms[index]
    # what it gains in other channels alone speaks for no name in this one's place
    acted = set(decision.energy(term)) or set(term.variant.channels)
    variants = [v for v in decision.search.variants if acted & set(v[1].channels)]
    again = screen(decision.search.small, variants, without.terms)
    own = charged(term, gain)
    sampled = rendered(decision.problem.view) is None
    tried = {term.effect.id}
    for r in decision.search.rank(without, _worth_trying(term, again.candidates)):
        other = r.fit.terms[-1]
        if other.effect.id in tried:
            continue
        tried.add(other.effect.id)
        there = _gain_there(decision.problem, acted, without, r) if set(other.variant.channels) - acted else r.gain
        deficit = own - min(r.gain, there) - idle_price(term, r.fit)
        undecided = is_undecided(term, other, deficit, own, sampled=sampled)
        if undecided and -deficit > max(TWIN_GAIN, LIKE_SHARE * own):
            undecided = _share(decision.problem, without, term, r.fit) > LEAST_SHARED
        yield InPlace(r, deficit, undecided)


def _share(problem: Problem, without: Fit, term: Term, other: Fit) -> float:
    """Squared cosine between a name's change and that of what is in its place: of two causes next to nothing."""
    own, rival = (
        problem.whiten_change(state, without.state)
        for state in (forward([*without.terms, term], problem.view), other.state)
    )
    return float(own @ rival) ** 2 / max(float(own @ own) * float(rival @ rival), 1e-300)


def _gain_there(problem: Problem, names: Collection[str], without: Fit, ranked: Ranked) -> float:
    """What an effect gains in the channels in which a name acts, its parameters paid."""
    told = sum(
        d.fit_scatter(d.residual(ranked.fit.state))[0] - d.fit_scatter(d.residual(without.state))[0]
        for d in problem.data
        if d.channel.name in names
    )
    return charged(ranked.fit.terms[-1], told)


def _worth_trying(term: Term, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The likeliest candidates, and the best one of each effect that is known to be like the name.

    To first order a shape that has not been fitted may promise little.
    """
    likely = shortlist(candidates)[:MOST_TRIED]
    known = {c.term.effect.id for c in likely}
    for candidate in candidates:
        if candidate.term.effect.id not in known and alike(term.effect, candidate.term.effect):
            known.add(candidate.term.effect.id)
            likely.append(candidate)
    return likely
