"""Scatter of steps that the table states and that wanders: one day like the day before, told apart from an effect.

A declaration says how much steps differ, not that each differs anew. Where they wander by no more than that, whatever
is slow follows them: half a year's weather finds its likeness in half a year's drift. A real effect comes on top of
what is stated; one that is not takes its part from it, and leaves less than was declared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Features, Law
from arl_fixtures.reconcile.noise import IN_STEPS
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.step_means import share_between
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.whitener import Whitener

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

FEWEST_STEPS = 12
"""Steps from which their order tells whether they wander."""
BETWEEN = 0.5
"""Share of a change that must lie between steps for it to be one of these."""
LONGEST = 0.995
"""Largest correlation of a step with the next."""
WANDERS, BEYOND = 6.0, 12.0
"""Log-likelihood that a wander must gain over steps that differ anew, which chance gives to one table in a thousand;
and that a change which was looked for among many must gain beside one."""
LEAST_LEFT = 0.7
"""Share of what is stated below which a change has taken its likeness from that."""
LEAST_SIZE = 0.02
"""Least share of what is stated by which steps may scatter in truth."""
MOST_A_STEP = 2.0
"""Log-likelihood a step that a law may gain at most by foretelling all that steps share as stated."""


def drop_wanderers(decision: Decision) -> bool:
    """Drop the names that stand only for steps which wander within what the table states; tells whether any fell."""
    view, terms = decision.problem.view, decision.best.terms
    full = forward(terms, view)
    rest = [forward([t for t in terms if t is not term], view) for term in terms]
    gone: set[int] = set()
    for d in decision.problem.data:
        slow = [k for k, without in enumerate(rest) if acts_between(d, without, full)]
        if slow and wanders(d, forward([t for k, t in enumerate(terms) if k not in slow], view), full):
            gone |= {k for k in slow if _acts_mostly(decision, terms[k], d)}
    if not gone:
        return False
    decision.keep([t for k, t in enumerate(terms) if k not in gone])
    return True


def is_wander(d: ChannelData, state: State, law: Law, features: Features) -> bool:
    """Whether a law of a channel stands only for such steps; one without terms where they are slow at all.

    Unless it gains more than steps could give if all that they share were foretold.
    """
    name = d.channel.name
    told = {**state, name: state[name] + law.correction(features, state[name])}
    if acts_between(d, state, told):
        return wanders(d, state, told, trees=bool(law.trees or not law.terms))
    step = d.level("step")
    if step is None or law.gain > MOST_A_STEP * step.count:
        return False
    return not law.terms and is_slow(d, state)


def acts_between(d: ChannelData, before: State, after: State) -> bool:
    """Whether a change of a channel lies between steps for the most part."""
    name = d.channel.name
    return after[name] is not before[name] and share_between(d, after[name] - before[name]) > BETWEEN


def is_slow(d: ChannelData, state: State) -> bool:
    """Whether steps that a table says to scatter are each like the one before."""
    left = _stated_means(d, state)
    return left is not None and _at_best(*left) > _likelihood(*left, 0.0) + WANDERS


def wanders(d: ChannelData, before: State, after: State, *, trees: bool = False) -> bool:
    """Whether a channel's steps tell less of a change between them than of a wander within what is stated.

    Args:
        d: the channel.
        before, after: corrected simulation without the change and with it.
        trees: whether trees foretell the change, of which a few can follow any wander.
    """
    start, end = _stated_means(d, before), _stated_means(d, after)
    if start is None or end is None:
        return False
    wander = _at_best(*start)
    if wander < max(_likelihood(*start, 0.0) + WANDERS, _likelihood(*end, 0.0)):
        return False
    left, noise = end
    takes_it = float(np.mean(left**2 / (1.0 + noise))) < LEAST_LEFT
    if takes_it and not trees:  # too much may be stated: what foretells a step better than its neighbour is none
        return _at_best_of_any_size(*end) < _at_best_of_any_size(*start) + BEYOND
    return takes_it or _at_best(left, noise) < wander + BEYOND


def _acts_mostly(decision: Decision, term: Term, d: ChannelData) -> bool:
    """Whether most of what a name changes is in one channel, in standard errors."""
    energy = decision.energy(term)
    return energy.get(d.channel.name, 0.0) > 0.5 * sum(energy.values())


def _stated_means(d: ChannelData, state: State) -> tuple[FloatArray, FloatArray] | None:
    """Mean of each step in units of what is stated, and its variance by the rows' noise; as steps are numbered.

    None where nothing is stated of what steps share, or they are few.
    """
    step = d.level("step")
    if step is None or not step.declared or step.count < FEWEST_STEPS or d.channel.role is Role.SCATTER:
        return None
    inner = tuple(level for level in d.levels if level.name in IN_STEPS)
    left = d.residual(state)
    if d.calibrated:
        left = left - d.scale * d.constants(left)[d.unit]
    sums, weight = Whitener(d.root_weight, (*inner, step), d.tau).group_sums(left, "step")
    seen = weight > 0.0
    return sums[seen] / weight[seen] / step.floor, 1.0 / weight[seen] / step.floor**2


def _at_best(mean: FloatArray, noise: FloatArray) -> float:
    """Log-likelihood of the steps' means with the correlation that is likeliest."""
    found = minimize_scalar(lambda r: -_likelihood(mean, noise, r), bounds=(0.0, LONGEST), method="bounded")
    return -float(found.fun)


def _at_best_of_any_size(mean: FloatArray, noise: FloatArray) -> float:
    """The same where steps scatter by no more than what is stated, but perhaps by less."""

    def loss(share: float) -> float:
        return float(len(mean) * np.log(share)) - _at_best(mean / share, noise / share**2)

    found = minimize_scalar(loss, bounds=(LEAST_SIZE, 1.0), method="bounded")
    return -min(float(found.fun), loss(1.0))


def _likelihood(mean: FloatArray, noise: FloatArray, correlation: float) -> float:
    """Log-likelihood, less its constant, of means of variance 1 beside their noise, each correlated with the next."""
    expected, variance, total = 0.0, 1.0, 0.0
    for seen, own in zip(mean, noise, strict=True):  # the filter of Kalman (J. Basic Eng. 82 (1960) 35)
        spread = variance + own
        off = seen - expected
        total -= 0.5 * (np.log(spread) + off**2 / spread)
        share = variance / spread
        expected = correlation * (expected + share * off)
        variance = correlation**2 * (1.0 - share) * variance + 1.0 - correlation**2
    return float(total)
