"""Devices of which each has a gain and a zero of its own in all it reads: calibrated first, compared then.

One nominal simulation of several devices, none of them calibrated: their light differs by gains and zeros, their
ranges by offsets and scales. One constant a device and channel is free in every comparison. Where light differs
from device to device by both and range by either, the second constants are calibration too, and no dark signal or
clock that devices share. A line a device then brings the simulation to each, and stays free beside the effects.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from arl_fixtures.reconcile.channel_data import CALIBRATED, ChannelData
from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray
from arl_fixtures.reconcile.model_file import unit_keys
from arl_fixtures.reconcile.pilot import Structure
from arl_fixtures.reconcile.pixel_calibration import zero_fitted
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

APART_Z = 5.0
"""Standard errors by which the lines of two devices must differ from none, and from each other."""
LEAST_SHARE = 0.5
"""Share of what is to be explained of the light that the lines must explain."""
FEWEST_ROWS, FEWEST_GROUPS = 30, 4
ROUNDS, HUBER = 4, 2.5

Lines = dict[str, dict[str, tuple[float, float]]]
"""Channel to unit label to gain less one, and zero."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """Lines of a channel's units.

    Attributes:
        values: gain less one and zero, (units, 2); errors: their standard errors.
        middle: what the lines add in the middle of each unit's rows, and its standard error, (units, 2).
        gain: log-likelihood gained beside a constant per unit.
    """

    values: FloatArray
    errors: FloatArray
    middle: FloatArray
    gain: float


def find_lines(problem: Problem, before: Mapping[str, Structure]) -> Lines:
    """Gain and zero of each unit in each channel; empty unless they differ from unit to unit in light and range.

    Args:
        problem: with the spread of its rows; before: structure of each channel beside a constant per unit.
    """
    told = [d for d in problem.data if d.calibrated and d.units > 1]
    if {d.channel.role for d in told} != set(CALIBRATED):
        return {}
    lines: Lines = {}
    code, keys = unit_keys(problem.view, problem.groups.unit_columns)
    for d in told:
        found = fitted_lines(problem, d)
        if found is None:
            return {}
        if d.channel.role is Role.INTENSITY:
            differ = _differ(found.values[:, 0], found.errors[:, 0]) and _differ(
                found.values[:, 1], found.errors[:, 1]
            )
            if not differ or found.gain < LEAST_SHARE * before[d.channel.name].gain:
                return {}
        elif not (_differ(*found.middle.T) or _differ(found.values[:, 0], found.errors[:, 0])):
            return {}
        labels = [keys[code[d.use[np.flatnonzero(d.unit == k)[0]]]] for k in range(d.units)]
        lines[d.channel.name] = {
            label: (float(a), float(b)) for label, (a, b) in zip(labels, found.values, strict=True)
        }
    return lines


def calibrate_simulation(
    columns: Columns, unit_columns: tuple[str, ...], lines: Mapping[str, Mapping[str, Iterable[float]]]
) -> None:
    """Bring a table's simulation to each unit's gain and zero, in place; to their mean for a unit without a line."""
    if not lines:
        return
    code, keys = unit_keys(View(columns), unit_columns)
    for channel, units in lines.items():
        name = f"sim_{channel}"
        if name in columns.numbers:
            known = {label: np.asarray(list(line), dtype=np.float64) for label, line in units.items()}
            mean = np.mean(list(known.values()), axis=0)
            gain, zero = np.array([known.get(key, mean) for key in keys])[code].T
            columns.numbers[name] = columns.numbers[name] * (1.0 + gain) + zero
    columns.memo.clear()


def free_lines(problem: Problem, lines: Lines) -> None:
    """Let the second constant of each unit stay free beside the effects, as large as the lines are."""
    for d in problem.data:
        if d.channel.name in lines:
            is_light = d.channel.role is Role.INTENSITY
            scale = np.ones(len(d.use)) if is_light else problem.view.sim[d.channel.name][d.use]
            size = max(abs(line[1 if is_light else 0]) for line in lines[d.channel.name].values())
            d.free_second(size, scale)


def free_fitted_zeros(problem: Problem) -> None:
    """Let each unit's signal have a zero of its own where whoever made the table has fitted one to it."""
    for d in problem.data:
        if d.channel.role is Role.INTENSITY and zero_fitted(problem.columns, d.channel.name):
            d.free_zero()
            d.rebuild(d.tau)


def _differ(values: FloatArray, errors: FloatArray) -> bool:
    """Whether constants of two units differ from none and from each other."""
    own = np.flatnonzero(np.abs(values) > APART_Z * errors)
    return any(abs(values[i] - values[j]) > APART_Z * np.hypot(errors[i], errors[j]) for i, j in combinations(own, 2))


def fitted_lines(problem: Problem, d: ChannelData) -> Fitted | None:
    """Lines that bring a channel's simulation to its units; None where a unit has too few rows to tell."""
    sim, residual = problem.view.sim[d.channel.name][d.use], d.residual(problem.view.fresh_state())
    rows = problem.view.rows[d.use]
    groups = [c[rows] for c in (problem.groups.step, problem.groups.angle, problem.groups.pixel) if c is not None]
    values, errors, middle, gain = np.zeros((d.units, 2)), np.zeros((d.units, 2)), np.zeros((d.units, 2)), 0.0
    for unit in range(d.units):
        own = np.flatnonzero(d.unit == unit)
        if len(own) < FEWEST_ROWS:
            return None
        x, y, root = sim[own], residual[own], d.root_weight[own]
        design = np.stack([x, np.ones(len(own))], axis=1) * root[:, None]
        if np.linalg.matrix_rank(design) < 2:
            return None
        weight = np.ones(len(own))
        for _ in range(ROUNDS):
            held = np.sqrt(weight)
            line = np.linalg.lstsq(design * held[:, None], y * root * held, rcond=None)[0]
            left = y * root - design @ line
            weight = np.minimum(1.0, HUBER / np.maximum(np.abs(left), 1e-9))
        first = design[:, 0] if d.channel.role is Role.INTENSITY else design[:, 1]
        alone = y * root - first * float((weight * first) @ (y * root)) / float((weight * first) @ first)
        gain += 0.5 * float(weight @ alone**2 - weight @ left**2)
        values[unit] = line
        spread = _covariance(design, weight * left, weight, [group[own] for group in groups])
        errors[unit], at = np.sqrt(np.diag(spread)), np.array([np.average(x, weights=root**2), 1.0])
        middle[unit] = float(at @ line), np.sqrt(float(at @ spread @ at))
    return Fitted(values=values, errors=errors, middle=middle, gain=gain)


def _covariance(design: FloatArray, left: FloatArray, weight: FloatArray, groups: list[IntArray]) -> FloatArray:
    """Covariance of a line, the largest that rows sharing errors in any of the groups allow (sandwich)."""
    bread = np.linalg.inv(design.T @ (design * weight[:, None]))
    worst = bread
    for group in groups:
        code = np.unique(group, return_inverse=True)[1]
        count = int(code.max()) + 1
        if count >= FEWEST_GROUPS:
            scores = np.stack([np.bincount(code, column * left, minlength=count) for column in design.T])
            found = bread @ (scores @ scores.T) @ bread * count / (count - 1.0)
            worst = found if np.trace(found @ np.linalg.inv(worst)) > len(worst) else worst
    return np.asarray(worst)
