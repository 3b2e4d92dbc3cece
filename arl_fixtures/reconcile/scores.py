"""What one variant of an effect promises on what is left, and what chance alone would give it.

A tangent is the whitened change of the corrected simulation when an amplitude is switched on by a small step. The
gain of log-likelihood of a variant is that of its amplitudes on the residual; a variant with shapes is tried at the
product of its starts. Each is tried on all units together and on each unit alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.direct import loss, outwards, undiminished
from arl_fixtures.reconcile.effect import Effect, State, Variant
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


class Scored(NamedTuple):
    """Candidates of one variant, and what chance gave it in each draw: freely, along a shape, in one unit alone."""

    candidates: tuple[Candidate, ...]
    chance: FloatArray
    wide: FloatArray
    alone: FloatArray


class Scorer:
    """Scores variants one by one on what other terms leave; none depends on those before it.

    Args:
        problem: rows with weights and scatters.
        others: terms that are switched on already.
        seed: of the noise in which chance is simulated; not at all where None.
    """

    def __init__(self, problem: Problem, others: Sequence[Term], seed: int | None) -> None:
        self.problem, self.others = problem, others
        self.base = forward(others, problem.view)
        residual = problem.whiten_state(self.base)
        self.column, self.labels = unit_labels(problem)
        self.restricted = len(self.labels) > 1
        unit = problem.codes(problem.groups.unit)
        self.unit = unit if self.restricted else np.zeros_like(unit)
        self.taken = {term.variant.label for term in others}
        self.noise = (
            None
            if seed is None
            else np.random.default_rng(seed).standard_normal((DRAWS, len(residual))).astype(np.float32)
        )
        self.by_unit = UnitSums(residual, self.unit, len(self.labels), self.noise)
        self.at_once = UnitSums(residual, np.zeros_like(unit), 1, self.noise)

    def asks(self, effect: Effect, variant: Variant) -> bool:
        """Whether a variant may act beside the terms."""
        if variant.label in self.taken and not effect.several:
            return False
        if variant.rough and any(term.variant.rough for term in self.others):
            return False  # what one displacement leaves at edges is its own error, not a second one
        elsewhere = any(_looks_elsewhere(t.effect, t.variant) for t in self.others)
        return not (elsewhere and _looks_elsewhere(effect, variant))

    def __call__(self, one: tuple[Effect, Variant]) -> Scored:
        """The best candidates of a variant, one for each unit alone and one for all."""
        effect, variant = one
        # what is of one unit by its own conditions is not tried at another one
        alone = self.restricted and not effect.shared and self.column not in variant.where
        scored = Scored((), np.zeros(DRAWS), np.zeros(DRAWS), np.zeros(DRAWS))
        best = self._linear(effect, variant, alone, scored)
        if variant.rough:
            with undiminished(self.problem):
                best = self._rough(effect, variant, alone, best, scored.chance)
        return scored._replace(candidates=tuple(best.values()))

    def _linear(self, effect: Effect, variant: Variant, alone: bool, scored: Scored) -> dict[str, Candidate]:
        """By unit the best along tangents; the draws of chance are raised to what they give."""
        best: dict[str, Candidate] = {}
        sums = self.by_unit if alone else self.at_once
        handicap = handicap_of(variant)
        for shapes in starts_of(variant):
            term = Term(effect=effect, variant=variant, values={**default_values(variant), **shapes})
            tangents = tangents_of(self.problem, self.others, self.base, term)
            grams, scores = sums(tangents)
            whole = np.sum(grams, axis=0)
            if not np.any(np.diag(whole) > 1e-6):
                continue
            for label, gram, score in choices_of(grams, scores, self.labels if alone else ("",)):
                amplitude, gain = solve_amplitudes(gram, score, variant)
                gain = max(gain - handicap, 0.0)
                if gain > (best[label].gain if label in best else 0.0):
                    values = dict(term.values)
                    for p, x in zip(variant.amplitudes(), amplitude, strict=True):
                        values[p.name] = float(np.clip((p.null or 0.0) + x * p.typical, p.low, p.high))
                    best[label] = self._candidate(effect, variant, values, label, gain)
            if self.noise is not None:
                drawn = sums.by_chance(tangents)
                largest = scored.wide if is_search(variant) else scored.chance
                np.maximum(largest, by_chance(np.sum(drawn, axis=0), whole) - handicap, out=largest)
                if alone and not is_search(variant):
                    for gram, score in zip(grams, drawn, strict=True):
                        np.maximum(scored.alone, by_chance(score, gram) - handicap, out=scored.alone)
        return best

    def _rough(
        self, effect: Effect, variant: Variant, alone: bool, linear: dict[str, Candidate], chance: FloatArray
    ) -> dict[str, Candidate]:
        """Candidates by finite trials; a linear estimate is kept where it holds at its full size."""
        problem, others, base = self.problem, self.others, self.base
        unit, labels = (self.unit, self.labels) if alone else (np.zeros_like(self.unit), ("",))
        residual = problem.whiten_state(base)
        best: dict[str, Candidate] = {}
        for candidate in linear.values():
            state = forward([*others, candidate.term], problem.view)
            gain = float(np.sum(loss(residual) - loss(residual - problem.whiten_change(base, state))))
            if gain > 0.0:
                best[candidate.term.unit] = replace(candidate, gain=gain)
        term = Term(effect=effect, variant=variant, values=default_values(variant))
        starts = list(starts_of(variant))
        for values, change, gains in outwards(problem, others, base, term, starts, unit, len(labels)):
            named = zip((*labels, ""), gains.tolist(), strict=True) if labels[0] else [("", float(gains[-1]))]
            for label, gain in named:
                if gain > (best[label].gain if label in best else 0.0):
                    best[label] = self._candidate(effect, variant, values, label, gain)
            power = float(change @ change)
            if self.noise is not None and 1e-6 < power < BY_CHANCE:
                scores = np.asarray(self.noise @ change.astype(np.float32), dtype=np.float64)
                np.maximum(chance, scores - 0.5 * power, out=chance)
        return best

    def _candidate(
        self, effect: Effect, variant: Variant, values: dict[str, float], label: str, gain: float
    ) -> Candidate:
        term = Term(
            effect=effect, variant=variant, values=values, unit=label, unit_column=self.column if label else ""
        )
        return Candidate(term=term, gain=gain, free=len(term.free()))


def _looks_elsewhere(effect: Effect, variant: Variant) -> bool:
    """Whether a variant moves rays over the edges of a simulation that looks through a few sharp ones."""
    return effect.displaces and (variant.rough or by_whole_pixels(variant))


def starts_of(variant: Variant) -> Iterator[dict[str, float]]:
    """The starts of a single shape, which its effect chose; of several their products, at most `MAX_PRODUCTS`."""
    shapes = variant.shapes()
    products = list(itertools.product(*(p.starts for p in shapes)))
    if _tried_along(variant) > 1 and len(products) > MAX_PRODUCTS:
        chosen = np.unique(np.linspace(0, len(products) - 1, MAX_PRODUCTS).astype(int))
        products = [products[i] for i in chosen]
    for product in products:
        yield dict(zip((p.name for p in shapes), product, strict=True))


FEW_AMPLITUDES, MANY_PRICE = 3, 1.4
"""Amplitudes beyond which each costs this: the thousandth of chi2/2 grows by 1.0 a degree of freedom, and what is
common stays the measure of chance."""


def is_search(variant: Variant) -> bool:
    """Whether a variant is tried along a shape from more starts than products of shapes are."""
    return _tried_along(variant) == 1 and max(len(p.starts) for p in variant.shapes()) > MAX_STARTS


def _tried_along(variant: Variant) -> int:
    """Shapes that are tried from more than one start."""
    return sum(len(p.starts) > 1 for p in variant.shapes())


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
