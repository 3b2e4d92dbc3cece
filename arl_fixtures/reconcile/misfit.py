"""Whether what a further name explains is the misfit of one that stands: a wrong shape, a side effect, its edges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from arl_fixtures.reconcile.acceptance import LEAST_SCATTER, Ranked, acts_alone
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_render import rendered
from arl_fixtures.reconcile.fit import Fit
from arl_fixtures.reconcile.own_driver import driven_by, has_own_driver, mends_shape
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.region import rows_of_most
from arl_fixtures.reconcile.roles import ORDERS, PIXEL_COLUMNS, Role
from arl_fixtures.reconcile.step_means import outgrows
from arl_fixtures.reconcile.terms import Term, forward

MISFIT_SHARE, HIDDEN_SHARE, EXACT_SHARE = 0.15, 0.004, 0.0004
"""A further effect on a channel must gain this share of what one there gains: with a driver in common, without one,
and without one where that one's law is a plain number, which leaves nothing."""
PICTURE_SHARE = 0.015
"""The same where both are pictures over the pixels, the further one by no other column."""
QUIET, QUIET_GAIN = 0.15, 3.0
"""Share of its mean square below which an effect hardly acts, and what a further one must gain there."""
STILL = 0.3
"""Standard errors up to which a row counts as not mixed."""
STEADY_GAIN, CLEAR_GAIN = 2.0, 8.0
"""Log-likelihood by which a further effect is as large wherever a strong one acts, and does not grow with it; and
what it must gain itself if it gains next to nothing against the strong one."""
UNDONE = 1.0 / 3.0
"""Share of the squares of two effects of the same drivers that both together must keep: nobody saw what they undo."""
EDGE_PART, MOST_OF, FEW_ROWS = 0.3, 0.8, 0.4
"""Part of a gain at edges that the operator may have left there, the share of it that must lie in the rows which hold
that share of what the operator does, and how many of all rows these may be."""
SIDE_SHARE = 0.5
"""Share of a gain from which it lives on the side effects of others, and what it must be of what these gain there."""
SIDE_LEAST = 0.2
"""Part of what a further effect changes of a scatter, that effects before it must have changed on the side."""
AT_EDGE = 1e-3
"""Share of an amplitude's range that counts as its edge."""
_SMALLEST = 1e-300
LEAST_MEANS = 0.2
"""Share of what a mean's effect gains on scatters that it must gain on means, which tell more of it."""


def is_misfit(problem: Problem, base: Fit, ranked: Ranked, gains: Mapping[int, float]) -> bool:
    """Whether a further effect only mends the shape of one that is already there.

    No operator is exact. What it leaves has its own drivers and channels, and is small against what it explains.
    Two laws of the same drivers that undo each other draw a curve by their difference: neither is seen.
    """
    new = ranked.fit.terms[-1]
    if (base.terms or new.effect.mixes) and _is_beyond_reach(new):
        return True  # half of an image and its mirror averages what the simulation of an even scene has of noise
    if _mends_side_effects(problem, ranked) or _undoes(problem, base, ranked) or _worsens_own(problem, base, ranked):
        return True
    for index, term in enumerate(base.terms):
        if not set(term.variant.channels) & set(new.variant.channels) or _is_side(term, new):
            continue
        by_steps = acts_alone(problem, (base.terms[index], new))
        if not by_steps and _lives_at_edges(problem, base, ranked, index, gains.get(index, 0.0)):
            return True
        common = bool(_shared_drivers(problem, term, new))
        alike = common and not has_own_driver(problem, ranked.fit.terms, term)
        hidden = EXACT_SHARE if term.effect.exact else HIDDEN_SHARE
        picture = driven_by(new) <= driven_by(term) and bool(driven_by(new) & PIXEL_COLUMNS)
        if picture:
            hidden = max(hidden, PICTURE_SHARE)
        least = (MISFIT_SHARE if alike else hidden) * gains.get(index, 0.0)
        another = new.effect.several and new.effect.id == term.effect.id
        apart = (another or not (alike or picture)) and (by_steps or _stands_apart(problem, base, ranked, index))
        clear = not common and min(ranked.gain, ranked.robust) > CLEAR_GAIN
        apart = apart and (
            ranked.gain > 0.1 * least
            or (by_steps and _outgrows(problem, term, new))
            or (clear and _grows_with(problem, base, ranked, index) < -STEADY_GAIN)
        )
        if ranked.gain < least and not apart:
            return True
        small = ranked.gain < MISFIT_SHARE * gains.get(index, 0.0)
        if small and not (alike or by_steps) and mends_shape(problem, ranked.fit.terms, ranked.fit.terms[index]):
            return True
    return False


def _outgrows(problem: Problem, term: Term, new: Term) -> bool:
    """Whether steps differ by a new effect by more than what the operator of an earlier one may miss of them."""
    view = problem.view
    return outgrows(problem, view.fresh_state(), forward([term], view), forward([new], view))


def _shared_drivers(problem: Problem, term: Term, new: Term) -> set[str]:
    """What drives both of two effects; not the order of rows where one tells steps apart and one acts within them."""
    common = driven_by(term) & driven_by(new)
    return set() if common and common <= ORDERS and acts_alone(problem, (term, new)) else common


def _is_beyond_reach(new: Term) -> bool:
    """Whether an effect's fit ends at the edge of what it can physically be: it stands for something else."""
    return any(
        edge != p.null and abs(float(new.values[p.name]) - edge) < AT_EDGE * (p.high - p.low)
        for p in new.variant.amplitudes()
        if not p.per
        for edge in (p.low, p.high)
    )


def _worsens_own(problem: Problem, base: Fit, ranked: Ranked) -> bool:
    """Whether a further effect agrees worse with its own channels, and mends what another one makes of these.

    Light that nobody measured mends the walk of a range with it, where the walk's law is not quite that.
    """
    if not base.terms:
        return False
    own = set(ranked.fit.terms[-1].variant.channels)
    moved = [d for d in problem.data if ranked.fit.state[d.channel.name] is not base.state[d.channel.name]]
    if all(d.channel.name in own for d in moved):
        return False
    return _gain_on([d for d in moved if d.channel.name in own], base, ranked) < 0.0


def _gain_on(channels: Sequence[ChannelData], base: Fit, ranked: Ranked) -> float:
    """What a further effect gains on some channels, the scatters of each at their best."""
    return sum(
        d.fit_scatter(d.residual(ranked.fit.state))[0] - d.fit_scatter(d.residual(base.state))[0] for d in channels
    )


def _is_side(term: Term, new: Term) -> bool:
    """Whether an effect moves the channels of another, which are scatters, on the side only."""
    return all(name.endswith("_std") for name in new.variant.channels) and not all(
        name.endswith("_std") for name in term.variant.channels
    )


def _undoes(problem: Problem, base: Fit, ranked: Ranked) -> bool:
    """Whether a further effect and one of the same drivers take back most of what the other does.

    Not where a channel that the other one leaves alone shows the further effect: light that came by a floor.
    """
    terms = ranked.fit.terms
    for index, term in enumerate(terms[:-1]):
        if driven_by(term) != driven_by(terms[-1]) or not set(term.variant.channels) & set(
            terms[-1].variant.channels
        ):
            continue
        alone = [
            problem.whiten_change(forward([t for t in terms if t is not other], problem.view), ranked.fit.state)
            for other in (terms[index], terms[-1])
        ]
        both = alone[0] + alone[1]
        if float(both @ both) < UNDONE * sum(float(change @ change) for change in alone):
            beside = set(terms[-1].variant.channels) - set(term.variant.channels)
            means = [d for d in problem.data if d.channel.name in beside and d.channel.role is not Role.SCATTER]
            if _gain_on(means, base, ranked) < CLEAR_GAIN:
                return True
    return False


def _mends_side_effects(problem: Problem, ranked: Ranked) -> bool:
    """Whether a further effect lives on scatters that effects before it moved on the side.

    How a noise follows a signal is read off the table: what that leaves there calls for no name of other channels,
    nor for one that is small beside it. Nor is an effect on means seen by scatters alone.
    """
    untouched, after = problem.view.fresh_state(), ranked.fit.state
    before = forward(ranked.fit.terms[:-1], problem.view)  # not the base: there scatters pull at what moves signals
    gains: dict[bool, float] = {True: 0.0, False: 0.0}
    moved, plain, largest, means = 0.0, False, 0.0, 0.0
    for d in problem.data:
        name = d.channel.name
        if np.array_equal(after[name], before[name], equal_nan=True):
            continue
        scatter = d.channel.role is Role.SCATTER
        plain |= not scatter
        old, new = (d.whiten(d.residual(state)) for state in (before, after))
        side = scatter and before[name] is not untouched[name]
        side = side and _largest(before, untouched, d) > SIDE_LEAST * _largest(after, before, d)
        if scatter:
            gains[side] += 0.5 * float(old @ old - new @ new)
        else:
            means += d.fit_scatter(d.residual(after))[0] - d.fit_scatter(d.residual(before))[0]
        largest = max(largest, _largest(after, before, d))
        if side:
            first = d.whiten(d.residual(untouched))
            moved += 0.5 * float(first @ first - old @ old)
    if plain and means < LEAST_MEANS * sum(gains.values()):  # of scatters so far
        return True
    gains[False] += means
    if gains[True] <= SIDE_SHARE * (gains[True] + max(gains[False], 0.0)):
        return False
    return plain or gains[True] < SIDE_SHARE * moved or largest < 2.0 * LEAST_SCATTER


def _largest(after: State, before: State, d: ChannelData) -> float:
    """Relative change of a channel that one row in twenty exceeds."""
    name = d.channel.name
    change = np.abs(after[name] - before[name])[d.use]
    return float(np.quantile(change / np.maximum(np.abs(before[name][d.use]), _SMALLEST), 0.95))


def _moved_by(problem: Problem, base: Fit, index: int) -> FloatArray:
    """Squares by which one of the terms moves each row of all channels, in units of the rows' errors."""
    rest = forward([t for k, t in enumerate(base.terms) if k != index], problem.view)
    return np.concatenate([
        (d.root_weight * (base.state[d.channel.name] - rest[d.channel.name])[d.use]) ** 2 for d in problem.data
    ])  # fmt: skip


def _stands_apart(problem: Problem, base: Fit, ranked: Ranked, index: int) -> bool:
    """Whether a further effect gains as much where an earlier one hardly acts: what mends its shape does not.

    Of what lies within a pixel a table knows little: where that is mixed, there is no row in which little is mixed.
    """
    moved = _moved_by(problem, base, index)
    power = problem.whiten_change(forward(ranked.fit.terms[:-1], problem.view), ranked.fit.state) ** 2
    gain = 0.5 * (problem.whiten_state(base.state) ** 2 - problem.whiten_state(ranked.fit.state) ** 2)
    seen = power > 1e-9
    if not seen.any():
        return False
    least = STILL**2 if base.terms[index].effect.mixes else QUIET * float(np.mean(moved[seen]))
    quiet = seen & (moved < least)
    share = float(power[quiet].sum() / power.sum())
    return share > QUIET and float(gain[quiet].sum()) > max(QUIET_GAIN, 0.5 * share * float(gain[seen].sum()))


def _lives_at_edges(problem: Problem, base: Fit, ranked: Ranked, index: int, gain: float) -> bool:
    """Whether a further effect of all rows explains what the operator of one that moves edges leaves at these.

    A scene that is known from the table's own samples only is known worst where it jumps: a periodic error whose
    period fits the ranges of the surfaces is nil on all of them, and free on the mixtures between.
    """
    term, new = base.terms[index], ranked.fit.terms[-1]
    moves = term.effect.displaces or term.effect.mixes
    if not moves or new.effect.displaces or new.effect.mixes or rendered(problem.view) is not None:
        return False
    if ranked.gain > EDGE_PART * gain:
        return False
    moved = _moved_by(problem, base, index)
    acted = rows_of_most(moved, MOST_OF)
    if len(acted) > FEW_ROWS * len(moved):
        return False
    told = problem.whiten_state(base.state) ** 2 - problem.whiten_state(ranked.fit.state) ** 2
    return float(told[acted].sum()) > MOST_OF * float(told.sum())


def _grows_with(problem: Problem, base: Fit, ranked: Ranked, index: int) -> float:
    """Log-likelihood by which a further effect is rather as large in each row as an earlier one is there.

    What an earlier one's law does not quite say is, or is a function of that one's size. Light is compared by
    the share that the earlier one takes.
    """
    view, before = problem.view, forward(ranked.fit.terms[:-1], problem.view)
    rest = forward([t for k, t in enumerate(base.terms) if k != index], view)
    own, grown, bent = 0.0, 0.0, 0.0
    for d in problem.data:
        name = d.channel.name
        if ranked.fit.state[name] is before[name]:
            continue
        size, unit = (base.state[name] - rest[name])[d.use], np.ones(len(d.use))
        if d.channel.role is Role.INTENSITY:
            unit = np.abs(rest[name])[d.use]
            size = size / np.maximum(unit, _SMALLEST)
        size = size / max(float(np.max(np.abs(size))), _SMALLEST)
        change, left = (ranked.fit.state[name] - before[name])[d.use] * d.expect, d.whiten(d.residual(before))
        own += _told([d.whiten(change)], left)
        grown += _told([d.whiten(change * np.abs(size))], left)
        bent += _told([d.whiten(unit * size**power) for power in range(4)], left) - 4.0
    return max(grown, bent) - own


def _told(columns: Sequence[FloatArray], left: FloatArray) -> float:
    """Log-likelihood that a sum of columns takes from a whitened residual."""
    design = np.column_stack(columns)
    design = design / np.maximum(np.linalg.norm(design, axis=0), _SMALLEST)
    fitted = design @ np.linalg.lstsq(design, left, rcond=None)[0]
    return 0.5 * float(fitted @ fitted)
