"""Which effects could explain what is left: score tests with tangents, and how large the best would be by chance.

A tangent is the whitened change of the corrected simulation when an amplitude is switched on by a small step. The
gain of log-likelihood of a variant is that of its amplitudes on the residual; a variant with shapes is tried at the
product of its starts. Each is tried on all units together and on each unit alone. The distribution of the largest
gain without any mismatch is simulated with the very same tangents: the price of looking at so many things at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.derived_rays import as_the_table_says
from arl_fixtures.reconcile.direct import loss, outwards, undiminished
from arl_fixtures.reconcile.effect import Effect, Kind, State, Variant
from arl_fixtures.reconcile.effects_pointing import by_whole_pixels
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.screen_sums import UnitSums, by_chance, choices_of, solve_amplitudes
from arl_fixtures.reconcile.terms import Term, beside, default_values, forward

MAX_STARTS, MAX_PRODUCTS = 12, 16
DRAWS = 100
BY_CHANCE = 120.0
"""Squared change beyond which no chance lets a finite trial gain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A variant with its best start and what it promises.

    Attributes:
        term: with amplitudes at the linear estimate.
        gain: log-likelihood gained, linear.
        free: number of free parameters.
    """

    term: Term
    gain: float
    free: int


LEAST_GAIN = 4.0
"""Log-likelihood that any name must gain."""
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
        return float(-np.expm1(-np.exp(-(gain / FIRST_SHARE - location) / scale)))


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
            for variant in variants:
                term = Term(effect=effect, variant=variant, values=default_values(variant, amplitude=0.1))
                forward([term], problem.view)
        except Exception as error:
            if failed is not None:
                failed[effect.id] = f"was not tried: {type(error).__name__} {error}"
            continue
        found += [(effect, variant) for variant in variants]
    return found


def starts_of(variant: Variant) -> Iterator[dict[str, float]]:
    """The starts of a single shape, which its effect chose; of several their products, at most `MAX_PRODUCTS`."""
    shapes = variant.shapes()
    products = list(itertools.product(*(p.starts for p in shapes)))
    if len(shapes) > 1 and len(products) > MAX_PRODUCTS:
        chosen = np.unique(np.linspace(0, len(products) - 1, MAX_PRODUCTS).astype(int))
        products = [products[i] for i in chosen]
    for product in products:
        yield dict(zip((p.name for p in shapes), product, strict=True))


FEW_AMPLITUDES, MANY_PRICE = 3, 1.4
"""Amplitudes beyond which each costs this: the thousandth of chi2/2 grows by 1.0 a degree of freedom, and what is
common stays the measure of chance."""


def is_search(variant: Variant) -> bool:
    """Whether a variant is tried along a shape from more starts than products of shapes are."""
    shapes = variant.shapes()
    return len(shapes) == 1 and len(shapes[0].starts) > MAX_STARTS


def tangents_of(problem: Problem, others: Sequence[Term], base: State, term: Term) -> FloatArray:
    """Whitened change per typical size of each amplitude at the term's shapes, shape (amplitudes, stacked rows)."""
    rows = []
    tried = beside(others, term, problem.view)
    for p in term.variant.amplitudes():
        if p.per:
            continue
        step = 0.1 * p.typical
        null = p.null if p.null is not None else 0.0
        if not p.low <= null + step <= p.high:
            step = -step
        values = {q.name: (q.null if q.null is not None else 0.0) for q in term.variant.amplitudes()}
        trial = term.with_values({**term.values, **values, p.name: null + step})
        rows.append(problem.whiten_change(base, tried(trial)) / (step / p.typical))
    return np.stack(rows)


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
    base = forward(others, problem.view)
    residual = problem.whiten_state(base)
    column, labels = unit_labels(problem)
    restricted = len(labels) > 1
    unit = problem.codes(problem.groups.unit)
    if not restricted:
        unit = np.zeros_like(unit)
    taken = {term.variant.label for term in others}
    noise = (
        np.random.default_rng(seed).standard_normal((DRAWS, len(residual))).astype(np.float32)
        if with_chance
        else None
    )
    by_unit = UnitSums(residual, unit, len(labels), noise)
    at_once = UnitSums(residual, np.zeros_like(unit), 1, noise)
    best_by_chance, best_by_search, best_alone = np.zeros(DRAWS), np.zeros(DRAWS), np.zeros(DRAWS)
    found: list[Candidate] = []
    for effect, variant in variants:
        if variant.label in taken and not effect.several:
            continue
        if variant.rough and any(term.variant.rough for term in others):
            continue  # what one displacement leaves at edges is its own error, not a second one
        if _looks_elsewhere(effect, variant) and any(_looks_elsewhere(t.effect, t.variant) for t in others):
            continue
        alone = restricted and not effect.shared and column not in variant.where  # else one unit's at another unit
        best: dict[str, Candidate] = {}
        for shapes in starts_of(variant):
            term = Term(effect=effect, variant=variant, values={**default_values(variant), **shapes})
            tangents = tangents_of(problem, others, base, term)
            sums = by_unit if alone else at_once
            grams, scores = sums(tangents)
            whole = np.sum(grams, axis=0)
            if not np.any(np.diag(whole) > 1e-6):
                continue
            for label, gram, score in choices_of(grams, scores, labels if alone else ("",)):
                amplitude, gain = solve_amplitudes(gram, score, variant)
                gain = max(gain - handicap_of(variant), 0.0)
                if gain > (best[label].gain if label in best else 0.0):
                    values = dict(term.values)
                    for p, x in zip(variant.amplitudes(), amplitude, strict=True):
                        values[p.name] = float(np.clip((p.null or 0.0) + x * p.typical, p.low, p.high))
                    placed = Term(
                        effect=effect, variant=variant, values=values, unit=label, unit_column=column if label else ""
                    )
                    best[label] = Candidate(term=placed, gain=gain, free=len(term.free()))
            if noise is not None:
                drawn = sums.by_chance(tangents)
                largest = best_by_search if is_search(variant) else best_by_chance
                np.maximum(largest, by_chance(np.sum(drawn, axis=0), whole) - handicap_of(variant), out=largest)
                if alone and not is_search(variant):
                    for gram, score in zip(grams, drawn, strict=True):
                        np.maximum(best_alone, by_chance(score, gram) - handicap_of(variant), out=best_alone)
        if variant.rough:
            places = (unit, labels, column) if alone else (np.zeros_like(unit), ("",), "")
            with undiminished(problem):
                whole = problem.whiten_state(base)
                best = _rough(problem, others, base, whole, effect, variant, best, places, noise, best_by_chance)
        found.extend(best.values())
    found.sort(key=lambda c: (-c.gain, c.term.label))
    return Screening(
        candidates=tuple(found), chance=np.sort(best_by_chance), wide=np.sort(best_by_search),
        alone=np.sort(best_alone),
    )  # fmt: skip


def _looks_elsewhere(effect: Effect, variant: Variant) -> bool:
    """Whether a variant moves rays over the edges of a simulation that looks through a few sharp ones."""
    return effect.displaces and (variant.rough or by_whole_pixels(variant))


def _rough(
    problem: Problem,
    others: Sequence[Term],
    base: State,
    residual: FloatArray,
    effect: Effect,
    variant: Variant,
    linear: dict[str, Candidate],
    places: tuple[IntArray, tuple[str, ...], str],
    noise: NDArray[np.float32] | None,
    best_by_chance: FloatArray,
) -> dict[str, Candidate]:
    """Candidates of a rough variant by finite trials; a linear estimate is kept where it holds at its full size."""
    unit, labels, column = places
    best: dict[str, Candidate] = {}
    for candidate in linear.values():
        state = forward([*others, candidate.term], problem.view)
        gain = float(np.sum(loss(residual) - loss(residual - problem.whiten_change(base, state))))
        if gain > 0.0:
            best[candidate.term.unit] = replace(candidate, gain=gain)
    term = Term(effect=effect, variant=variant, values=default_values(variant))
    for values, change, gains in outwards(
        problem, others, base, term, list(starts_of(variant)), unit, len(labels)
    ):  # fmt: skip
        named = zip((*labels, ""), gains.tolist(), strict=True) if labels[0] else [("", float(gains[-1]))]
        for label, gain in named:
            if gain > (best[label].gain if label in best else 0.0):
                placed = replace(term, values=values, unit=label, unit_column=column if label else "")
                best[label] = Candidate(term=placed, gain=gain, free=len(placed.free()))
        power = float(change @ change)
        if noise is not None and 1e-6 < power < BY_CHANCE:
            scores = np.asarray(noise @ change.astype(np.float32), dtype=np.float64)
            np.maximum(best_by_chance, scores - 0.5 * power, out=best_by_chance)
    return best


def unit_labels(problem: Problem) -> tuple[str, tuple[str, ...]]:
    """The one category column that makes the calibration unit, and its labels in the order of the unit code."""
    columns = problem.groups.unit_columns
    if len(columns) != 1 or columns[0] not in problem.columns.categories:
        return "", ("",)
    codes, labels = problem.columns.categories[columns[0]]
    unit = problem.groups.unit
    first = np.unique(unit, return_index=True)[1]
    return columns[0], tuple(labels[codes[i]] for i in first)


def handicap_of(variant: Variant) -> float:
    """What a variant of many amplitudes gives up, so that chance finds no more in it than in others."""
    return MANY_PRICE * max(sum(not p.per for p in variant.amplitudes()) - FEW_AMPLITUDES, 0)


