"""Ranges that a calibration has fitted to the simulation in offset and scale, with the effect in them.

A line through ranges takes an effect's slope along. Once the effect is taken away, ranges are stretched by what it
made of the line, and a clock would be named that runs as it should. Where ranges differ from a simulation in more
than noise and do not lean on its ranges at all, a scale of each device stays free beside the effects.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
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


def hold_unneeded(decision: Decision) -> None:
    """Take free scales away from channels that no name changes: a law says what rows say, their scale included."""
    acted = {channel for term in decision.best.terms for channel in decision.energy(term)}
    unneeded = set(decision.search.scaled) - acted
    for d in decision.problem.data:
        if d.channel.name in unneeded:
            d.hold_second()
            d.rebuild(d.tau)
            del decision.search.scaled[d.channel.name]
    if unneeded:
        decision.look()
