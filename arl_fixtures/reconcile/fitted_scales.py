"""Ranges that a calibration has fitted to the simulation in offset and scale, with the effect in them.

A line through ranges takes an effect's slope along. Once the effect is taken away, ranges are stretched by what it
made of the line, and a clock would be named that runs as it should. Where ranges differ from a simulation in more
than noise and do not lean on its ranges at all, a scale of each device stays free beside the effects.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.calibrated_units import Lines
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.model_file import unit_keys
from arl_fixtures.reconcile.pilot import Structure
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.rivals import is_structure
from arl_fixtures.reconcile.roles import Role

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

FITTED_Z = 2.0
"""Standard errors within which a fitted scale is nil."""
STAYING, _DIGITS = 0.5, 6
"""Share of what exceeds the noise that rows of one simulated range must have in common, and its decimals."""
SCALE_Z = 3.0
"""Errors by which ranges must be stretched less than findings do, for a calibration to have taken it away."""
SCALE_SHARE = 0.005
"""Size of a scale that a calibration is expected to leave: of an effect of millimetres over metres."""


def with_fitted_scales(problem: Problem, before: Mapping[str, Structure]) -> dict[str, FloatArray]:
    """Distances whose scale may have been fitted to these rows, and the error of each unit's scale, (units,).

    Args:
        problem: of the table; before: structure in each channel beside a constant of each unit.
    """
    found: dict[str, FloatArray] = {}
    for d in problem.data:
        if d.channel.role is not Role.DISTANCE or not d.calibrated or d.second is not None:
            continue
        if not is_structure(before[d.channel.name]) or not _stays(problem, d):
            continue
        slopes, errors = _slopes(problem, d)
        if np.all(np.abs(slopes) < FITTED_Z * errors):
            found[d.channel.name] = errors
    return found


def _slopes(problem: Problem, d: ChannelData) -> tuple[FloatArray, FloatArray]:
    """How much of its simulated range each unit is off, and the error of that, (units,) each.

    Plain least squares, as a calibration fits: a line that holds back what is far off leans on a curve that stays.
    """
    residual, weight = d.residual(problem.view.fresh_state()), d.root_weight**2
    far, step = problem.view.sim[d.channel.name][d.use], problem.groups.step
    slopes, errors = np.zeros(d.units), np.zeros(d.units)
    for unit in range(d.units):
        rows = np.flatnonzero((d.unit == unit) & (weight > 0.0))
        if not rows.size:
            continue
        w, x, y = weight[rows], far[rows], residual[rows]
        x, y = x - np.average(x, weights=w), y - np.average(y, weights=w)
        power = max(float(w @ x**2), 1e-300)
        slopes[unit] = float(w @ (x * y)) / power
        score = w * x * (y - slopes[unit] * x)
        by_step = score if step is None else np.bincount(step[problem.view.rows[d.use[rows]]], score)
        errors[unit] = max(float(np.linalg.norm(score)), float(np.linalg.norm(by_step))) / power
    return slopes, errors


def _stays(problem: Problem, d: ChannelData) -> bool:
    """Whether most of what differs does so alike in all steps: what comes and goes with a step leaves no scale."""
    residual, weight = d.residual(problem.view.fresh_state()), d.root_weight**2
    mean = np.bincount(d.unit, weight * residual) / np.maximum(np.bincount(d.unit, weight), 1e-300)
    residual = residual - mean[d.unit]
    simulated = np.round(problem.view.sim[d.channel.name][d.use], _DIGITS)
    place = np.unique(np.stack([d.unit, simulated]), axis=1, return_inverse=True)[1].ravel()
    power, pull = np.bincount(place, weight), np.bincount(place, weight * residual)
    alike = float(np.sum(pull**2 / np.maximum(power, 1e-300))) - np.count_nonzero(power > 0.0)
    return bool(alike > STAYING * (float(weight @ residual**2) - np.count_nonzero(weight > 0.0)))


def free_scales(problem: Problem, channels: Container[str]) -> None:
    """Let the scale of each unit's distances stay free beside the effects."""
    for d in problem.data:
        if d.channel.name in channels and d.second is None:
            d.free_second(SCALE_SHARE, problem.view.sim[d.channel.name][d.use])
            d.rebuild(d.tau)


def _hold(d: ChannelData) -> None:
    """Take a channel's free scale away."""
    d.hold_second()
    d.rebuild(d.tau)


def hold_unneeded(decision: Decision) -> None:
    """Take free scales away from channels that no name changes: a law says what rows say, their scale included."""
    acted = {channel for term in decision.best.terms for channel in decision.energy(term)}
    unneeded = set(decision.search.scaled) - acted
    for d in decision.problem.data:
        if d.channel.name in unneeded:
            _hold(d)
            del decision.search.scaled[d.channel.name]
    if unneeded:
        decision.look()


def line_of(d: ChannelData, residual: FloatArray) -> FloatArray:
    """First and second constant of each unit's rows, if these shared no error; (units, 2)."""
    assert d.second is not None
    weight, values = d.root_weight**2, np.zeros((d.units, 2))
    for unit in range(d.units):
        rows = (d.unit == unit) & (weight > 0.0)
        root = np.sqrt(weight[rows])
        both = root[:, None] * np.column_stack([d.scale[rows], d.second[rows]])
        values[unit] = np.linalg.lstsq(both, root * residual[rows], rcond=None)[0]
    return values


def is_stretched(decision: Decision, d: ChannelData, change: FloatArray) -> bool:
    """Whether findings stretch some unit's ranges, which are not stretched as far as the rows tell.

    Args:
        change: what the findings take from the channel's rows.
    """
    errors = decision.search.scaled.get(d.channel.name)
    if errors is None or d.second is None:
        return False
    seen = line_of(d, d.residual(decision.problem.view.fresh_state()))
    return bool(np.any(np.abs(seen + line_of(d, change))[:, 1] > SCALE_Z * errors))


def hold_unstretched(decision: Decision) -> None:
    """Take free scales away from channels whose findings stretch no unit's ranges: an offset is all they need."""
    state, untouched = decision.final_state(), decision.problem.view.fresh_state()
    for d in decision.problem.data:
        if d.channel.name not in decision.search.scaled:
            continue
        d.follow(state)
        if not is_stretched(decision, d, d.residual(state) - d.residual(untouched)):
            _hold(d)


def scales_of(decision: Decision) -> Lines:
    """Gain less one of each unit's simulated distances, beside the findings and the constants, and no zero.

    Of ranges that a calibration has fitted to the simulation with the findings in them: it is what these make of a
    line, which no step's own error touches.
    """
    problem, state = decision.problem, decision.final_state()
    untouched = problem.view.fresh_state()
    code, keys = unit_keys(problem.view, problem.groups.unit_columns)
    lines: Lines = {}
    for d in problem.data:
        name, left = d.channel.name, d.residual(state) - d.residual(untouched)
        if state[name] is untouched[name] or not is_stretched(decision, d, left):
            continue
        labels = [keys[code[d.use[np.flatnonzero(d.unit == unit)[0]]]] for unit in range(d.units)]
        lines[name] = {label: (float(gain), 0.0) for label, gain in zip(labels, line_of(d, left)[:, 1], strict=True)}
    return lines
