"""Which effects could explain what is left, best first, and how large the best would be by chance.

The distribution of the largest gain without any mismatch is simulated with the very same looks: the price of looking
at so many things at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.derived_rays import as_the_table_says
from arl_fixtures.reconcile.effect import Effect, Kind, Variant
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.scores import DRAWS, Candidate, Scorer, is_search
from arl_fixtures.reconcile.shared_work import each
from arl_fixtures.reconcile.terms import Term, default_values, forward

LEAST_GAIN = 4.0
"""Log-likelihood that any name must gain."""
CERTAIN = 50.0
"""Scales by which a gain lies below what is usual, from which chance gives more for sure."""
FIRST_SHARE = 0.8
"""Share of what chance gives to free looks that the first name must gain. Chance is simulated with white noise, and a
candidate pays for its shapes and for errors that groups share besides: of 102 tables without a mismatch (benchmarks/
concealed and others' suites) 98 came to 0.5 of it at most, one to 0.58, three to more than all of it."""


@dataclass(frozen=True, slots=True)
class Surcharge:
    """What must be gained beyond the threshold for looking more often: along a shape, or at each unit alone."""

    search: float = 0.0
    alone: float = 0.0

    def of(self, term: Term) -> float:
        """What a term must pay."""
        return (self.search if is_search(term.variant) else 0.0) + (self.alone if term.unit else 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Screening:
    """Candidates, best first, and what chance alone would give.

    Attributes:
        candidates: one per variant, restriction and effect.
        chance: sorted draws of the largest gain on data without mismatch.
        wide: the same of variants that search along a shape (a period): their many looks are theirs to pay.
        alone: the same of what acts in one unit alone, which as many looks are as there are units.
    """

    candidates: tuple[Candidate, ...]
    chance: FloatArray
    wide: FloatArray
    alone: FloatArray

    def surcharge(self, level: float) -> Surcharge:
        """What a search along a shape and what acts in one unit must gain beyond the other effects' threshold."""
        beyond = [
            max(gumbel_quantile(draws, level) - self.threshold(level), 0.0) if np.any(draws > 0) else 0.0
            for draws in (self.wide, self.alone)
        ]
        return Surcharge(*beyond)

    def threshold(self, level: float) -> float:
        """Gain that the best candidate exceeds by chance with probability 1 − level (Gumbel tail of the draws).

        It is never less than `LEAST_GAIN`: where few effects can act chance would soon do, but for what errors have
        in common that nobody stated.
        """
        return max(gumbel_quantile(self.chance, level), LEAST_GAIN)

    def first(self, level: float) -> float:
        """What the first name must gain, see `FIRST_SHARE`."""
        return max(FIRST_SHARE * self.threshold(level), LEAST_GAIN)

    def p_value(self, gain: float) -> float:
        """Probability that chance gives a best gain this large, in tables as the one of `FIRST_SHARE`."""
        location, scale = _gumbel(self.chance)
        below = (location - gain / FIRST_SHARE) / scale
        return float(-np.expm1(-np.exp(min(below, CERTAIN))))


def _gumbel(draws: FloatArray) -> tuple[float, float]:
    if len(draws) < 2:
        return 8.0, 1.0
    scale = max(float(np.std(draws)) * np.sqrt(6.0) / np.pi, 0.3)
    return float(np.mean(draws)) - 0.5772 * scale, scale


def gumbel_quantile(draws: FloatArray, level: float) -> float:
    """Quantile of a Gumbel law with the draws' mean and spread."""
    location, scale = _gumbel(draws)
    return location - scale * float(np.log(-np.log(level)))


def all_variants(
    problem: Problem, effects: Sequence[Effect], failed: dict[str, str] | None = None
) -> list[tuple[Effect, Variant]]:
    """Every way in which every effect could act in this table and change a compared channel.

    An effect that raises (a plug-in, an odd table) must not take the others with it: it is noted in `failed`.
    """
    names = set(problem.names)
    found: list[tuple[Effect, Variant]] = []
    for effect in effects:
        if effect.kind is not Kind.MEAN:
            continue
        try:
            variants = [
                as_the_table_says(v, problem.view) for v in effect.variants(problem.view) if names & set(v.channels)
            ]
            variants = [v for v in variants if not any(p.per for p in v.parameters) and "group" not in v.options]
            for variant in [*variants, *(a for v in variants for a in effect.aside(v, problem.view))]:
                term = Term(effect=effect, variant=variant, values=default_values(variant, amplitude=0.1))
                forward([term], problem.view)
        except Exception as error:
            if failed is not None:
                failed[effect.id] = f"was not tried: {type(error).__name__} {error}"
            continue
        found += [(effect, variant) for variant in variants]
    return found


def screen(
    problem: Problem,
    variants: Sequence[tuple[Effect, Variant]],
    others: Sequence[Term] = (),
    *,
    with_chance: bool = False,
    seed: int = 1,
) -> Screening:
    """Score every variant on what the other terms leave.

    Args:
        problem: rows with weights and scatters.
        variants: what is tried.
        others: terms that are switched on already.
        with_chance: simulate the largest gain without a mismatch (costs about as much again).
        seed: of that simulation.
    """
    scorer = Scorer(problem, others, seed if with_chance else None)
    wanted = [one for one in variants if scorer.asks(*one)]
    wanted.sort(key=lambda one: not one[1].rough)  # these take longest
    found = each(scorer, wanted, known=itertools.chain.from_iterable(wanted))
    candidates = [c for one in found for c in one.candidates]
    candidates.sort(key=lambda c: (-c.gain, c.term.label))
    chance, wide, alone = np.zeros(DRAWS), np.zeros(DRAWS), np.zeros(DRAWS)
    for one in found:
        chance, wide = np.maximum(chance, one.chance), np.maximum(wide, one.wide)
        alone = np.maximum(alone, one.alone)
    return Screening(candidates=tuple(candidates), chance=np.sort(chance), wide=np.sort(wide), alone=np.sort(alone))
