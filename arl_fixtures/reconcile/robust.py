"""A gain of likelihood as a test sees it that allows for errors shared by steps, angles or pixels."""

from __future__ import annotations

import numpy as np
from scipy import special, stats

from arl_fixtures.reconcile.columns import BoolArray, FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.fit import Fit
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.simulated_noise import averages_noise
from arl_fixtures.reconcile.terms import forward

MOST_LEFT = 3.0
"""Standard errors to which rows left by a rough term are held back."""
LEAST_TAIL = -650.0
"""Logarithm of the least probability that is told from none: below, it is itself what a gain is worth."""
LEAST_UNLIMITED = 0.1
"""Share of a change that counts as seen by rows that are not held back, where there is less."""
SMALLEST = 1e-290
"""Probability from which a number holds it with all its digits."""
_PLACE = ("pixel_u", "pixel_v", "stage_angle_deg")
SPARE_PLACES, SPARE_FIXED = 1.5, 2.0
"""Places beyond its parameters from which a term must gain that displaces rays, or that does the same to a place at
all times: fewer are hit by any that has so many."""
SPARE_ROWS = 1.5
"""Rows from which a gain must come, each with all its channels."""
REST_GAIN, REST_SHARE = 15.0, 0.15
"""Log-likelihood, and share of the whole, that the other places gain together where a few gain most: so many that one
large edge among them makes no chance of them."""
OF_PLACES = 0.9
"""Share of a change that is the same in a place at all times where it is such a term."""
PRIOR_GROUPS, BARE_GROUPS = 20.0, 2.0
"""Groups on which the noise model's own covariance counts as resting; and where it was only told from the steps."""


def robust_gain(problem: Problem, found: Fit, first: int, gain: float) -> float:
    """A gain of the terms from `first` on, as a test sees it that allows for errors shared by whole groups.

    The fitted change as a whole is one direction. The scores along it, summed over steps, angles or pixels, scatter
    more than the model says where rows share errors: that ratio (sandwich over model, blended as if the model's own
    rested on `PRIOR_GROUPS` groups) divides the gain, and Student's tail for the number of groups replaces the normal
    one. The least favourable grouping counts; that of images takes rows as they are, outliers and all, as what turns
    a whole image makes one of each of its edges.
    """
    if gain <= 0.0 or len(found.terms) == first:
        return gain
    others = forward(found.terms[:first], problem.view)
    whole, residual = problem.whiten_change(others, found.state), found.residual
    change = whole
    if any(term.variant.rough or term.effect.displaces for term in found.terms):
        # rays that cross an edge a digit too early are no error that rows share
        held = np.minimum(1.0, MOST_LEFT / np.maximum(np.abs(residual), MOST_LEFT))
        change, residual = change * held, residual * held
    kept = [k for k, (index, _) in enumerate(found.keys) if index < first]
    if kept:
        basis, _ = np.linalg.qr(found.jacobian[:, kept])
        whole, change = whole - basis @ (basis.T @ whole), change - basis @ (basis.T @ change)
    if float(change @ change) <= 0.0:
        return 0.0
    won = _gain_of_places(problem.codes(np.arange(problem.columns.n)), whole, found.residual)
    if _places_won(won) < SPARE_ROWS and not _others_gain(won, 1):
        return 0.0  # what an effect does it does to more than one row: that one is wild, in all its channels
    if problem.view.varies("stage_angle_deg") and _hits_few_places(problem, found, first, change, residual):
        return 0.0
    if any(averages_noise(problem, term, whole, found.residual) for term in found.terms[first:]):
        return 0.0
    worst = np.inf
    groups = problem.groups
    for code in (groups.step, groups.frame, groups.angle, groups.pixel, groups.block):
        if code is None:
            continue
        group = np.unique(problem.codes(code), return_inverse=True)[1]
        count = int(group.max()) + 1
        if count < 4:
            continue
        moved, left = (whole, found.residual) if code is groups.frame else (change, residual)
        scores = np.bincount(group, moved * left, minlength=count)
        ratio = float(scores @ scores) / float(moved @ moved) * count / (count - 1.0)
        if code is groups.frame:
            ratio /= max(_unlimited(problem, found, whole), LEAST_UNLIMITED) ** 2
        prior = _resting(problem, others, found.state) if code is groups.step else PRIOR_GROUPS
        ratio = max((prior + count * ratio) / (prior + count), 1.0)
        freedom = prior + count - 1.0
        worst = min(worst, _normal_gain(np.sqrt(2.0 * gain / ratio), freedom))
    return gain if not np.isfinite(worst) else worst


def _hits_few_places(problem: Problem, found: Fit, first: int, change: FloatArray, left: FloatArray) -> bool:
    """Whether a gain comes from hardly more places (a pixel at a stage angle) than it has parameters.

    A pixel sees the same edge at the same angle in every step: where in the pixel the edge lies is one number that
    all its rows share. A term of as many parameters as there are such places would hit them all: of those that
    displace rays one with several, and one that does the same to a place at all times, whichever device looks at it.
    What mixes pixels with others acts in few places by its nature. A temperature is read in no place, whichever
    pixel's row it stands on.
    """
    change = np.where(_of_places(problem), change, 0.0)
    if not np.any(change):
        return False
    shapes, newest = sum(index >= first for index, _ in found.keys), found.terms[first:]
    if any(term.variant.rough or term.effect.displaces for term in newest):
        gain = _gain_of_places(problem.codes(problem.columns.group("dut", *_PLACE)), change, left)
        few = shapes > 1 and _places_won(gain) < shapes + SPARE_PLACES
        return few and not _others_gain(gain, shapes)
    if any(term.effect.mixes for term in newest):
        return False
    places = problem.codes(problem.columns.group(*_PLACE))
    channel = np.repeat(np.arange(len(problem.data)), [len(d.use) for d in problem.data])
    if _share_of_places(places * len(problem.data) + channel, change) < OF_PLACES:
        return False
    # what noise makes of the gains of places (a scatter of twice the change) is no sign of few
    noise, gain = 4.0 * float(change @ change), _gain_of_places(places, change, left)
    # a place in bright light says much more than the others, and those may still say it, each by itself
    return _places_won(gain, noise) < shapes + SPARE_FIXED and not _others_gain(gain, shapes + int(SPARE_FIXED))


def _of_places(problem: Problem) -> BoolArray:
    """Whether a pixel or a stage angle sees the stacked rows; rows of a log among images have neither."""
    view = problem.view
    placed = np.zeros(view.n, dtype=bool)
    for name in _PLACE:
        if view.has(name):
            placed |= np.isfinite(view.number(name))
    return np.concatenate([placed[d.use] & (d.channel.role is not Role.TEMPERATURE) for d in problem.data])


def _gain_of_places(place: IntArray, change: FloatArray, left: FloatArray) -> FloatArray:
    """Twice the log-likelihood that a change gains in each place."""
    return np.asarray(np.bincount(place, (change + 2.0 * left) * change), dtype=np.float64)


def _places_won(gain: FloatArray, noise: float = 0.0) -> float:
    """From how many places a gain comes, each counting by its part of it; `noise` is part of their squares."""
    return max(float(gain.sum()), 0.0) ** 2 / max(float(gain @ gain) - noise, 1e-300)


def _others_gain(gain: FloatArray, count: int) -> bool:
    """Whether a term gains enough without the `count` places that gain most, which its parameters may have hit."""
    rest, whole = 0.5 * float(np.sort(gain)[:-count].sum()), 0.5 * float(gain.sum())
    return rest > max(REST_GAIN, REST_SHARE * whole)


def _share_of_places(place: IntArray, change: FloatArray) -> float:
    """Share of a change that is the same in every row of a place: what it sees, no condition, tells it."""
    there = change != 0.0
    mean = np.bincount(place[there], change[there]) / np.maximum(np.bincount(place[there]), 1)
    return float(np.sum(mean[place[there]] ** 2)) / float(change @ change)


def _unlimited(problem: Problem, found: Fit, change: FloatArray) -> float:
    """Share of a change on rows that are not held back: for a limited loss its curvature, not its weights, counts.

    Where the pose of an image is off, all its edges are, and rows held back for it pull with a constant force (Huber,
    Robust Statistics, 1981, chapter 7): they are no witnesses.
    """
    trust = np.concatenate([d.trust for d in problem.data])
    free = np.abs(found.residual) < MOST_LEFT * np.sqrt(trust)
    return float(change[free] @ change[free]) / float(change @ change)


def _resting(problem: Problem, before: State, after: State) -> float:
    """Groups on which the steps' scatter rests, for a change of the simulation.

    A scatter that no repeatability states is told from the very steps that the change would explain: it then rests on
    next to nothing, as far as the change is the same on all rows of a step.
    """
    shared = total = 0.0
    for d in problem.data:
        if after[d.channel.name] is before[d.channel.name]:
            continue
        change = d.root_weight * (after[d.channel.name] - before[d.channel.name])[d.use]
        total += float(change @ change)
        level = d.level("step")
        if level is not None and not level.declared and level.floor == 0.0:
            count = np.maximum(np.bincount(level.code, minlength=level.count), 1)
            mean = np.bincount(level.code, change, minlength=level.count) / count
            shared += float(np.sum(count * mean**2))
    share = shared / total if total > 0.0 else 0.0
    return PRIOR_GROUPS + (BARE_GROUPS - PRIOR_GROUPS) * share


def _normal_gain(t_value: float, freedom: float) -> float:
    """Half the square of the normal deviate with the tail probability of a Student deviate."""
    if t_value <= 0.0:
        return 0.5 * float(stats.norm.isf(stats.t.sf(t_value, freedom))) ** 2
    tail = log_beta(-float(np.log1p(t_value**2 / freedom)), 0.5 * freedom, 0.5) - float(np.log(2.0))
    if tail < LEAST_TAIL:
        return -tail
    return 0.5 * float(stats.norm.isf(np.exp(tail))) ** 2


def log_beta(log_x: float, a: float, b: float) -> float:
    """Logarithm of the regularised incomplete beta function I_x(a, b), also where it is less than any number.

    The tails of Student's t and of an F ratio are of this kind; below what a number holds the first term of the
    series is exact to x (DLMF 8.17.7).
    """
    value = float(special.betainc(a, b, np.exp(log_x)))
    return float(np.log(value)) if value > SMALLEST else a * log_x - float(np.log(a) + special.betaln(a, b))
