"""Candidates that a round would miss: a tangent tells little of a strong effect, and strong ones crowd others out."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from arl_fixtures.reconcile.acceptance import Ranked, is_repeat
from arl_fixtures.reconcile.fit import Fit
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.scores import Candidate
from arl_fixtures.reconcile.screen import Screening

STRONG_GAIN = 500.0
"""Likelihood gained from which an effect may be so strong that its tangent tells little of it."""


def other_variants(base: Fit, screening: Screening, chosen: Ranked, ranked: Sequence[Ranked]) -> list[Candidate]:
    """Variants of the chosen effect that were not ranked: to first order a strong one promises little."""
    term = chosen.candidate.term
    return [
        c for c in _not_ranked(base, screening, chosen, ranked)
        if c.term.effect is term.effect and set(c.term.variant.channels) & set(term.variant.channels)
    ]  # fmt: skip


def simpler_lookalikes(base: Fit, screening: Screening, chosen: Ranked, ranked: Sequence[Ranked]) -> list[Candidate]:
    """Look-alikes of a strong effect with fewer parameters that were not ranked; none of a weak one."""
    if chosen.gain < STRONG_GAIN:
        return []
    return [
        c for c in _not_ranked(base, screening, chosen, ranked)
        if c.term.effect.id in chosen.candidate.term.effect.confusable and c.free < chosen.candidate.free
    ]  # fmt: skip


def _not_ranked(base: Fit, screening: Screening, chosen: Ranked, ranked: Sequence[Ranked]) -> list[Candidate]:
    tried = {r.candidate.term.label for r in ranked}
    return [
        c for c in screening.candidates
        if c.term.unit == chosen.candidate.term.unit and c.term.label not in tried and not is_repeat(base, c)
    ]  # fmt: skip


def where_nothing_acts(screening: Screening, free: Collection[str]) -> Screening:
    """The candidates all of whose channels are `free` of effects."""
    inside = tuple(c for c in screening.candidates if all(name in free for name in c.term.variant.channels))
    return replace(screening, candidates=inside)


@contextmanager
def only(problem: Problem, names: Collection[str]) -> Iterator[None]:
    """A problem of these channels alone, for as long as that is asked for."""
    kept = problem.data
    problem.data = [d for d in kept if d.channel.name in names]
    try:
        yield
    finally:
        problem.data = kept
