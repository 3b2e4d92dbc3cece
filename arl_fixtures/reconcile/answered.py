"""Effects on the light before a comparator, with what the distance answers to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from arl_fixtures.reconcile.acceptance import TWIN_GAIN, worth
from arl_fixtures.reconcile.effect import Kind, Stage
from arl_fixtures.reconcile.fit import Fit, finish, fit
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.range_answer import answers
from arl_fixtures.reconcile.terms import Term
from arl_fixtures.reconcile.view import View


def answered(term: Term, view: View) -> Iterator[Term]:
    """The term with each distance that may answer to its light; none of one that acts on it by itself, or behind."""
    variant = term.variant
    if term.answer is not None or term.effect.kind is not Kind.MEAN or term.effect.stage >= Stage.TIMING:
        return
    for answer in answers(view):
        pulled = term.effect.stage is Stage.TARGET  # where a pixel sees two surfaces: a comparator is no part of it
        if answer.signal in variant.channels and (pulled or answer.distance not in variant.channels):
            channels = dict.fromkeys((*variant.channels, answer.distance))
            yield replace(term, answer=answer, variant=replace(variant, channels=tuple(channels)))


def in_place_of_others(problem: Problem, best: Fit) -> Fit:
    """The fit with answers in the place of names that act on a distance alone, where they say as much."""
    for own in best.terms:
        for term in answered(own, problem.view):
            for other in best.terms:
                if term.answer is None or set(other.variant.channels) != {term.answer.distance}:
                    continue
                if other.effect.stage is not Stage.TIMING:
                    continue
                terms = tuple(term if t is own else t for t in best.terms if t is not other)
                trial = finish(problem, fit(problem, terms, rounds=4))
                if worth(trial, best) > -TWIN_GAIN:
                    return in_place_of_others(problem, trial)
    return best
