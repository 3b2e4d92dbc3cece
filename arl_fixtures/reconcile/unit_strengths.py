"""Names in every unit's own strength: two lasers of one kind do not age alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.acceptance import PRICE
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.terms import Strengths, Term, field_keys, forward

LEAST_IN_UNIT, LEAST_POWER = 0.25, 0.02
"""Least factor of a name in a unit, of those that have a share of what it changes: one with next to none lacks it."""
STRENGTH_GAIN, STRENGTH_SIZE = 6.0, 0.1
"""Log-likelihood and difference from which units are said to have strengths of their own."""


def may_differ(term: Term) -> bool:
    """Whether units may have a name in strengths of their own.

    What displaces rays does not grow with a factor; what belongs to one unit, to the scene or to single pixels has no
    factor by unit.
    """
    return not (term.fields or term.unit or term.effect.displaces or term.effect.shared)


def of_each_unit(d: ChannelData, full: State, bare: State) -> State | None:
    """The state with names in which every unit has its own factor of what they change; None where there is one unit.

    None as well where a unit that should have its part has next to none: an effect in one of the units is another.

    Args:
        d: a channel; full, bare: states with and without the names.
    """
    if np.unique(d.unit).size < 2:
        return None
    power, score = _power_and_score(d, full, bare)
    factor = factors_of(power, score)
    if factor is None:
        return None
    name, of_row = d.channel.name, np.ones(full[d.channel.name].shape)
    of_row[d.use] = factor[d.unit]
    return {**full, name: bare[name] + of_row * (full[name] - bare[name])}


def with_strengths(problem: Problem, terms: Sequence[Term]) -> tuple[Term, ...]:
    """The terms, those with the strengths of each unit that are clearly not alike in all."""
    found = list(terms)
    for place, term in enumerate(terms):
        if may_differ(term):
            rest = [t for k, t in enumerate(found) if k != place]
            found[place] = replace(term, strengths=_strengths_of(problem, rest, term))
    return tuple(found)


def _strengths_of(problem: Problem, rest: Sequence[Term], term: Term) -> Strengths | None:
    columns = problem.groups.unit_columns
    code, keys = field_keys(columns, problem.view)
    if len(keys) < 2:
        return None
    full, bare = forward([*rest, term], problem.view), forward(rest, problem.view)
    power, score = np.zeros(len(keys)), np.zeros(len(keys))
    for d in problem.data:
        if full[d.channel.name] is not bare[d.channel.name]:
            of_code = np.zeros(int(d.unit.max()) + 1, dtype=np.int64)
            of_code[d.unit] = code[d.use]
            for total, own in zip((power, score), _power_and_score(d, full, bare), strict=True):
                np.add.at(total, of_code, own)
    factor = factors_of(power, score)
    if factor is None:
        return None
    there = power > LEAST_POWER * power.sum()
    common = float(score.sum() / power.sum())
    gain = 0.5 * float(np.sum((score[there] - common * power[there]) ** 2 / power[there]))
    apart = float(np.ptp(factor[there]))
    if gain < STRENGTH_GAIN + PRICE * (there.sum() - 1) or apart < STRENGTH_SIZE:
        return None
    known = np.flatnonzero(there)
    return Strengths(
        per=tuple(columns),
        levels={keys[k]: float(factor[k]) for k in known},
        errors={keys[k]: float(1.0 / np.sqrt(power[k])) for k in known},
    )


def _power_and_score(d: ChannelData, full: State, bare: State) -> tuple[FloatArray, FloatArray]:
    """Squares of what names change, and its product with what they leave, both whitened, by unit."""
    name = d.channel.name
    moved, left = d.whiten(d.expect * (full[name] - bare[name])[d.use]), d.whiten(d.residual(full))
    power: FloatArray = np.bincount(d.unit, moved * moved).astype(np.float64)
    score: FloatArray = np.bincount(d.unit, moved * left).astype(np.float64)
    return power, score


def factors_of(power: FloatArray, score: FloatArray) -> FloatArray | None:
    """Factor of each unit, 1 for those in which names hardly act; None where one lacks what it should have.

    Args:
        power, score: squares of what names change in each unit, and its product with what they leave, whitened.
    """
    there = power > LEAST_POWER * power.sum()
    factor = np.ones(power.shape)
    factor[there] += score[there] / power[there]
    return None if not there.any() or bool(np.any(factor[there] < LEAST_IN_UNIT)) else factor
