"""Candidates fitted beside what stands, best first: roughly on a part of the rows, the best of them on all.

An effect takes the scatter of frames along as its law says: light its photon noise, an amplifier its slope. Where the
table's scatters contradict that, the noise of this sensor comes in elsewhere, and the effect is tried with scatters
that stay, or that follow the signal otherwise: what frames scatter must not decide of what they are on average.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from arl_fixtures.reconcile.acceptance import PRICE, Ranked, acts_alone, worth
from arl_fixtures.reconcile.answered import answered
from arl_fixtures.reconcile.fit import Fit, finish, fit, within_reach
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.robust import robust_gain
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.scores import Candidate, starts_of
from arl_fixtures.reconcile.shared_work import each
from arl_fixtures.reconcile.side_scatter import Side
from arl_fixtures.reconcile.small_problem import START_SHARES, steps_alike
from arl_fixtures.reconcile.terms import Term, default_values, forward
from arl_fixtures.reconcile.view import View

POLISHED = 6
"""Candidates that are fitted on all rows."""
CONFLICT = 4.0
"""Log-likelihood that an effect must gain before scatters are taken to move otherwise than its law says."""
FAR_FETCHED = 6.0
"""Log-likelihood that it costs an effect to be of a size that hardly a part has, one in four hundred at most."""
ANSWERED = 2.0
"""Log-likelihood, its parameters paid, that what an effect does on the side must gain."""
FREED = 8
"""Rounds of a fit in which scatters no longer hold an effect where they fit."""


_Rough = tuple[float, Candidate, Fit]


def rank(full: Problem, small: Problem, base: Fit, candidates: Sequence[Candidate]) -> list[Ranked]:
    """Fit each candidate beside the base's terms, best first.

    Args:
        full: all rows at work; small: those on which candidates are compared first.
        base: what stands.
        candidates: with their starts.
    """
    price = PRICE * len(base.keys)
    rough: list[_Rough] = []
    before = small.log_likelihood(forward(base.terms, small.view), lost=float(len(base.keys)))
    known = _held(full, small, base, candidates)
    trials = each(lambda c: _best_start(small, base, c), candidates, known)
    for candidate, trial in zip(candidates, trials, strict=True):
        gain = trial.log_likelihood - before - PRICE * len(trial.keys) + price
        rough.append((gain, candidate, trial))
    rough.sort(key=lambda item: -item[0])
    rounds = 2 if small is full else 4
    best = _best_of_each_kind(small, base, rough)
    result = each(lambda one: _as_channels_say(full, base, one[1], one[2].terms, rounds), best, known)
    result.sort(key=lambda r: -r.gain)
    return result


def _best_of_each_kind(small: Problem, base: Fit, rough: list[_Rough]) -> list[_Rough]:
    """The first few, and the first that tells steps apart where all of these and what stands act within them.

    Or the reverse: what the operators of a strong name miss in single rows is no match for a law of few steps.
    """
    best, left = rough[:POLISHED], [r for r in rough[POLISHED:] if r[0] > 0.0]
    if not base.terms or not left or any(acts_alone(small, trial.terms) for _, _, trial in best):
        return best
    return [*best, *[r for r in left if acts_alone(small, r[2].terms)][:1]]


def _held(full: Problem, small: Problem, base: Fit, candidates: Sequence[Candidate]) -> list[object]:
    """What fits share with what stands, and are asked whether they do: effects, untouched channels, starts."""
    terms = [*base.terms, *(c.term for c in candidates)]
    arrays = [*base.state.values(), *full.view.sim.values(), *small.view.sim.values()]
    return [*candidates, *terms, *(t.effect for t in terms), *(t.variant for t in terms), *arrays]


def polished(full: Problem, base: Fit, candidate: Candidate, terms: tuple[Term, ...], *, rounds: int) -> Ranked:
    """Fit on the full problem with the group scatters that this candidate leaves, not those that hid it."""
    with full.keeping_scatters():
        full.refit_scatter(forward(terms, full.view), lost=float(len(base.keys)))
        found = finish(full, fit(full, terms, rounds=rounds))
        last = found.terms[-1]
        gain = worth(found, base) - FAR_FETCHED * last.effect.is_far_fetched(last.variant, last.values)
        strict = gain + _strict(full, found) - found.log_likelihood + base.log_likelihood - _strict(full, base)
        robust = robust_gain(full, found, len(base.terms), max(gain, strict))
    apart = acts_alone(full, found.terms)
    return Ranked(candidate=candidate, fit=found, gain=gain, robust=robust, alone=apart)


def _as_channels_say(full: Problem, base: Fit, candidate: Candidate, terms: tuple[Term, ...], rounds: int) -> Ranked:
    """A candidate with what it does on the side: to scatters, to ranges that answer to its light, or as it says."""
    best = _as_scatters_say(full, base, candidate, terms, rounds)
    for ways in (_aside, answered):
        for term in ways(best.fit.terms[-1], full.view):
            trial = polished(full, base, candidate, (*best.fit.terms[:-1], term), rounds=rounds)
            if trial.gain > best.gain + ANSWERED:
                best = trial
    return best


def _aside(term: Term, view: View) -> Iterator[Term]:
    """The term in the ways that its effect knows besides (`Effect.aside`), from each of their starts."""
    for variant in term.effect.aside(term.variant, view):
        for shapes in starts_of(variant):
            yield replace(term, variant=variant, values={**default_values(variant), **shapes, **term.values})


def _as_scatters_say(full: Problem, base: Fit, candidate: Candidate, terms: tuple[Term, ...], rounds: int) -> Ranked:
    """A candidate with the scatters that it takes along, or with others where the table is clearly likelier so."""
    best = polished(full, base, candidate, terms, rounds=rounds)
    if not _moves_both(full, base, best):
        return best
    least = best.gain + CONFLICT
    for side in (Side.STILL, Side.LIGHT, Side.GAIN):
        # from where the means alone would be: the wrong scatters may hold it back
        again = fit(full, (*terms[:-1], replace(terms[-1], side=side)), rounds=FREED)
        trial = polished(full, base, candidate, again.terms, rounds=rounds)
        if trial.gain > max(best.gain, least):
            best = trial
        elif side is Side.STILL:
            break  # what its law says of scatters holds
    return best


def _moves_both(full: Problem, base: Fit, ranked: Ranked) -> bool:
    """Whether an effect moves means, and scatters on the side."""
    moved = {
        d.channel.role is Role.SCATTER
        for d in full.data
        if ranked.fit.state[d.channel.name] is not base.state[d.channel.name]
    }
    return moved == {True, False}


def _strict(full: Problem, found: Fit) -> float:
    """Likelihood of a fit if pixels and stage angles had no pattern of their own."""
    return full.log_likelihood(found.state, lost=float(len(found.keys)), without=("pixel", "angle"))


def _best_start(small: Problem, base: Fit, candidate: Candidate) -> Fit:
    """Fit with the scatter that steps seem to have, and with less: what is to be explained may pass for it."""
    terms = (*base.terms, within_reach(small, base.terms, candidate.term))
    best = finish(small, fit(small, terms, rounds=8))
    state = forward(base.terms, small.view)
    for share in START_SHARES:
        with steps_alike(small, state, share) as handicap:
            other = fit(small, terms, rounds=8) if handicap > 0.0 else None
        if other is not None:
            again = finish(small, fit(small, other.terms, rounds=0))
            best = again if again.log_likelihood > best.log_likelihood else best
    return best
