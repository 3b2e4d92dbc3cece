"""What steps differ by: whether names act there at all, and what they leave that follows a recorded condition."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile.cells import within_cells
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.followed import condition_of
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.terms import Term, forward

WITHIN_STEPS = 0.1
"""Share of a change, between steps, below which it acts within steps and tells nothing of what steps differ by."""

MISSED = 0.3
"""Part of a change of the steps' means that an operator which acts within steps may miss."""
GOING, STAYING = 0.5, 0.8
"""Share of a name's gain that must come and go where the same is seen, and of what is left that must stay there."""
CLEAR_GAIN = 20.0
"""Log-likelihood that a name must gain by what comes and goes."""


def left_in_steps(problem: Problem, d: ChannelData, terms: Sequence[Term], least: float) -> float:
    """Share of what steps differ by that they still differ by, at least `least`; 0 where it follows no condition.

    Args:
        problem: the table.
        d: a channel with a mismatch.
        terms: the names.
        least: smallest share of interest.
    """
    name = d.channel.name
    level = d.level("step")
    state, untouched = forward(terms, problem.view), problem.view.fresh_state()
    if level is None or state[name] is untouched[name]:
        return 0.0
    taus = [d.fit_scatter(d.residual(s))[1]["step"] for s in (untouched, state)]
    size = float(np.median(level.scale))
    before, after = (size**2 * max(tau**2 - level.floor**2, 0.0) for tau in taus)
    moved = d.scale * beside_constants(d, d.expect * (state[name] - untouched[name])[d.use] / d.scale)
    share = after / max(before, float(np.mean(moved**2)), 1e-300)
    return share if share > least and condition_of(problem, d, "step", state) else 0.0


def acts_within_steps(problem: Problem, d: ChannelData, terms: Sequence[Term]) -> bool:
    """Whether names change a channel within steps only: what steps differ by is then another matter."""
    moved = forward(terms, problem.view)[d.channel.name] - problem.view.sim[d.channel.name]
    return share_between(d, moved) < WITHIN_STEPS


def beside_constants(d: ChannelData, change: FloatArray) -> FloatArray:
    """A change on a channel's rows, in units of its scale, less what the calibration of each unit takes of it."""
    if not d.calibrated:
        return change
    return change - (np.bincount(d.unit, change) / np.maximum(np.bincount(d.unit), 1))[d.unit]


def outgrows(problem: Problem, bare: State, before: State, own: State) -> bool:
    """Whether steps' means differ by one change by more than what an operator may miss of another change of them.

    Args:
        problem: the table.
        bare: without either.
        before: with the effect whose operator may miss something; own: with the other one.
    """
    size = [0.0, 0.0]
    for d in problem.data:
        name = d.channel.name
        if before[name] is bare[name] or own[name] is bare[name]:
            continue
        for k, state in enumerate((before, own)):
            size[k] += _between_and_all(d, state[name] - bare[name])[0]
    return size[1] > MISSED**2 * size[0]


def share_between(d: ChannelData, change: FloatArray) -> float:
    """Share of a change's mean square, beside the units' constants, that its steps' means hold.

    Not a number without steps or change.

    Args:
        d: a channel.
        change: of its corrected simulation, on the problem's rows.
    """
    between, total = _between_and_all(d, change)
    return between / total if d.level("step") is not None and total > 0.0 else float("nan")


def _between_and_all(d: ChannelData, change: FloatArray) -> tuple[float, float]:
    """Mean squares of a change's step means and of all of it, beside the units' constants; 0 between no steps."""
    level = d.level("step")
    moved = beside_constants(d, change[d.use] / d.scale)
    total = float(np.mean(moved**2))
    if level is None:
        return 0.0, total
    count = np.bincount(level.code, minlength=level.count)
    means = np.bincount(level.code, moved, minlength=level.count) / np.maximum(count, 1)
    return float(np.average(means**2, weights=count)), total


def leaves_other_rows(
    problem: Problem, d: ChannelData, terms: Sequence[Term], rows: IntArray, predicted: FloatArray
) -> bool:
    """Whether names tell whole images apart only, and what is left acts within images only: two causes, then.

    Args:
        problem: the table.
        d: a channel with images.
        terms: the names.
        rows: of the channel, that were looked at; predicted: there, of what is left, in units of the scale.
    """
    level = d.level("frame")
    if level is None or len(predicted) != len(rows):
        return False
    code, unit = level.code[rows], d.unit[rows]
    moved = forward(terms, problem.view)[d.channel.name] - problem.view.sim[d.channel.name]
    shares = []
    for change in ((moved[d.use] / d.scale)[rows], predicted):
        if d.calibrated:
            change = change - (np.bincount(unit, change) / np.maximum(np.bincount(unit), 1))[unit]
        count = np.bincount(code, minlength=level.count)
        means = np.bincount(code, change, minlength=level.count) / np.maximum(count, 1)
        shares.append(float(np.average(means**2, weights=count)) / max(float(np.mean(change**2)), 1e-300))
    return shares[0] > 1.0 - WITHIN_STEPS and shares[1] < WITHIN_STEPS


def leaves_what_stays(
    problem: Problem, d: ChannelData, terms: Sequence[Term], term: Term, rows: IntArray, predicted: FloatArray
) -> bool:
    """Whether a name tells whole steps apart, and what is left stays wherever the same is seen: two causes, then.

    A wrong name of one cause leaves what comes and goes as well, gains by what stays, or changes a picture by the
    same pattern that it leaves.

    Args:
        problem: the table.
        d: a channel.
        terms: all names; term: one of them.
        rows: of the channel, that were looked at; predicted: there, of what is left, in units of the scale.
    """
    name = d.channel.name
    full, rest = (forward(some, problem.view) for some in (terms, [t for t in terms if t is not term]))
    if full[name] is rest[name] or len(predicted) != len(rows) or not tells_steps(d, full[name] - rest[name]):
        return False
    place, left = places_of(problem)[d.use], predicted - float(predicted.mean())
    going = within_cells(left, place[rows])
    if float(going @ going) > (1.0 - STAYING) * float(left @ left):
        return False
    change, missed = d.whiten(d.expect * (full[name] - rest[name])[d.use]), d.whiten(d.residual(rest))
    whole, within = (
        0.5 * float(c @ x) ** 2 / max(float(c @ c), 1e-300)
        for c, x in ((change, missed), (within_cells(change, place), within_cells(missed, place)))
    )
    return within > max(GOING * whole, CLEAR_GAIN)


def tells_steps(d: ChannelData, change: FloatArray) -> bool:
    """Whether a change is the same in all rows of a step, by its counts or as a part of what the rows show."""
    level = d.level("step")
    if level is None:
        return False
    for scale in (d.scale, np.ones(len(d.scale))):
        moved = beside_constants(d, change[d.use] / scale)
        rest = within_cells(moved, level.code)
        if float(rest @ rest) < WITHIN_STEPS * float(moved @ moved):
            return True
    return False


def places_of(problem: Problem) -> IntArray:
    """What each row sees: a pixel or ray (of a device) for which the simulation says the same in all channels."""
    simulated = [f"sim_{d.channel.name}" for d in problem.data if d.channel.role is not Role.SCATTER]
    columns = problem.view.columns
    return columns.group("dut", *columns.ray_columns, *simulated)[problem.view.rows]


def act_apart(problem: Problem, before: State, after: State, other: State) -> bool:
    """Whether of two changes one tells steps apart only, and the other acts within steps only, in each channel.

    Args:
        problem: the table.
        before: corrected simulation; after: with one change; other: with the other.
    """
    both = False
    for d in problem.data:
        name = d.channel.name
        if after[name] is before[name] or other[name] is before[name]:
            continue
        low, high = sorted(share_between(d, state[name] - before[name]) for state in (after, other))
        if not (low < WITHIN_STEPS and high > 1.0 - WITHIN_STEPS):
            return False
        both = True
    return both
