"""Whether a candidate may be named: what counts for it, and what only looks like an effect of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.effects_surface import TOGETHER
from arl_fixtures.reconcile.fit import Fit
from arl_fixtures.reconcile.own_driver import driven_by, drives_another_part
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import PIXEL_COLUMNS, Role
from arl_fixtures.reconcile.scores import FEW_AMPLITUDES, Candidate
from arl_fixtures.reconcile.screen import Surcharge
from arl_fixtures.reconcile.step_means import act_apart
from arl_fixtures.reconcile.terms import Term, forward

PRICE = 2.0
"""Log-likelihood that each free parameter must earn."""
FURTHER, FURTHER_APART = 3.0, 1.0
"""What a further effect on a channel must gain beyond the threshold, as no operator before it is exact; less where
the two have no driver in common."""
TWIN_GAIN, LEAST_ROBUST = 2.0, 0.1
"""Of candidates that differ by less in log-likelihood the one with fewest parameters is taken; where both move edges,
as a test that allows for shared errors counts it, down to this share of the plain one."""
LEAST_SCATTER = 0.03
"""Relative excess of scatter below which rounding and the noise law's own accuracy explain it."""
ESSENTIAL_Z = 2.0
"""Standard errors by which an effect's essential parameter must differ from none."""
PATTERN_ODDS = 0.65
"""Share of the threshold that an effect must gain over free patterns of pixels and angles in its place."""


@dataclass(slots=True, kw_only=True)
class Ranked:
    """A candidate after its non-linear fit beside the present terms.

    Attributes:
        fit: joint fit on the full problem.
        gain: likelihood gained over the present terms, less the price.
        robust: the gain over no mismatch at all, as the test with shared errors sees it.
        alone: whether what stands on its channels tells steps apart and it acts within them, or the reverse.
    """

    candidate: Candidate
    fit: Fit
    gain: float
    robust: float
    alone: bool = False


def evidence(ranked: Ranked, surcharge: Surcharge) -> float:
    """What counts against the threshold: the gain over no mismatch, and enough over a mere pattern of pixels.

    The threshold is the largest gain that chance gives to as many amplitudes, so the first effect on a channel
    pays no price for them again, up to half of what it gains; and so does one that tells steps apart where those
    before it act within them, or the reverse: it is the first of its kind. Any other further one does, and more: it
    may live on what the first one's law does not quite say. As a picture over the pixels it must gain all of the
    threshold beside their free pattern. A search along a shape pays for its many looks, and so
    does what acts in one unit of several.
    """
    variant = ranked.candidate.term.variant
    amplitudes = min(sum(not p.per for p in variant.amplitudes()), FEW_AMPLITUDES)
    before = [] if ranked.alone else _before(ranked.fit.terms)
    picture = bool(before) and set(variant.drivers) <= PIXEL_COLUMNS
    sure = min(ranked.gain if picture else ranked.gain / PATTERN_ODDS, ranked.robust)
    if not before:
        sure += float(np.clip(0.5 * sure, 0.0, PRICE * amplitudes))
    else:
        alike = any(driven_by(term) & driven_by(ranked.fit.terms[-1]) for term in before)
        sure -= FURTHER if alike else FURTHER_APART
    return sure - surcharge.of(ranked.fit.terms[-1])


def worth(fit: Fit, without: Fit) -> float:
    """What a fit gains over another that lacks some of its terms, less the price of their parameters."""
    return fit.log_likelihood - without.log_likelihood - PRICE * (len(fit.keys) - len(without.keys))


def is_as_good(ranked: Ranked, best: Ranked) -> bool:
    """Whether a candidate explains as much as the best one: of two that move edges, to what edges can tell.

    The light of a pixel at an edge is in error by the same in all steps: a test which allows for shared errors then
    counts much less than the likelihood says.
    """
    share = 1.0
    if best.gain > 0.0 and all(r.fit.terms[-1].effect.displaces for r in (ranked, best)):
        share = float(np.clip(best.robust / best.gain, LEAST_ROBUST, 1.0))
    return share * (best.gain - ranked.gain) < TWIN_GAIN


def simplest(ranked: Ranked) -> tuple[bool, int, bool, bool, int, int, float, str]:
    """Order of candidates that explain as much: what asks few numbers, no pattern of pixels, then few columns.

    A law of pixels beside which one that is the same in all of them says as much has shown no pattern. What bears its
    name in a wider sense (`Variant.wider`) comes after what bears its own. Equal ones stand in the order of their
    names, not of rounding errors.
    """
    term, gain = ranked.candidate.term, ranked.gain
    drivers = len(term.variant.drivers)
    return (
        drives_another_part(term), ranked.candidate.free, term.variant.wider,
        bool(PIXEL_COLUMNS & set(term.variant.drivers)), -round(gain), drivers, -round(gain, 1), term.effect.id,
    )  # fmt: skip


def _before(terms: Sequence[Term]) -> list[Term]:
    """Terms before the last that share a channel with it: of what moves means one of the means."""
    own = set(terms[-1].variant.channels)
    own = {name for name in own if not name.endswith("_std")} or own
    return [t for t in terms[:-1] if set(t.variant.channels) & own]


def acts_alone(problem: Problem, terms: Sequence[Term]) -> bool:
    """Whether all on the last term's channels tell steps apart where it acts within them, or the reverse."""
    bare = problem.view.fresh_state()
    own = forward([terms[-1]], problem.view)
    return all(act_apart(problem, bare, forward([term], problem.view), own) for term in _before(terms))


def is_repeat(base: Fit, candidate: Candidate) -> bool:
    """Whether an effect stands already on the same rows, by the same columns: its shape is all it could mend."""
    new = candidate.term
    return not new.effect.several and any(
        term.effect.id == new.effect.id
        and set(term.variant.channels) & set(new.variant.channels)
        and (new.effect.single or driven_by(term) <= driven_by(new) or driven_by(new) <= driven_by(term))
        and (term.unit == new.unit or not term.unit or not new.unit)
        and (_surfaces(term) & _surfaces(new) or not _surfaces(term) or not _surfaces(new))
        for term in base.terms
    )


def _surfaces(term: Term) -> set[str]:
    """Surfaces on which a term acts; empty for all."""
    return {name for name in str(term.variant.options.get("surface", "")).split(TOGETHER) if name}


def lacks_essential(ranked: Ranked) -> bool:
    """Whether a candidate is fitted without what makes its name: a parameter less than two errors from none."""
    place = next(
        (k for k, (index, p) in enumerate(ranked.fit.keys)
         if index == len(ranked.fit.terms) - 1 and p.name == ranked.fit.terms[-1].effect.essential), None
    )  # fmt: skip
    if place is None:
        return False
    variance = np.linalg.pinv(ranked.fit.jacobian.T @ ranked.fit.jacobian)[place, place]
    null = ranked.fit.keys[place][1].null or 0.0
    return bool((ranked.fit.values()[place] - null) ** 2 < ESSENTIAL_Z**2 * variance)


def is_rounding(problem: Problem, base: Fit, ranked: Ranked) -> bool:
    """Whether a candidate changes scatters only, and by less than rounding and few frames leave uncertain."""
    largest = 0.0
    for d in problem.data:
        name = d.channel.name
        if ranked.fit.state[name] is base.state[name]:
            continue
        change = np.abs(ranked.fit.state[name] - base.state[name])[d.use] / d.scale
        if d.channel.role is not Role.SCATTER and np.any(change > 1e-6):
            return False
        largest = max(largest, float(np.quantile(change, 0.95)))
    return largest < LEAST_SCATTER
