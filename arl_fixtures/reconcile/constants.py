"""Gains and offsets of units beside the findings, as far as the data tell them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import softmax

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.decide import Decision
from arl_fixtures.reconcile.fitted_scales import is_stretched, line_of
from arl_fixtures.reconcile.model_file import unit_keys
from arl_fixtures.reconcile.noise import Level
from arl_fixtures.reconcile.roles import Role

CONSTANT_Z = 3.5
"""Errors by which a constant must differ from nothing that no finding explains."""
NAMED_ERRORS = 1.5
"""Errors that a constant beside a name must exceed: a name's law brings its own zero, an empirical one none."""
PRIOR = (0.4, 0.2, 0.4)
"""Of a simulation calibrated on these rows, on others with the same effect, and without the effect."""
FITTED_HERE = 0.5
"""Probability of a calibration on these rows from which gain and zero are both what it took of the findings."""
FITTED_ERRORS = 1.5
"""Rows' own errors of the mean within which a simulation agrees that was calibrated on these very rows."""


def constants_of(decision: Decision) -> dict[str, dict[str, float]]:
    """Gain or offset of each unit that the fit needs beside the findings.

    What a finding changes on average is in the measurement, too, unless a calibration took it away: there the
    constant belongs to the prediction as far as it exceeds its own error (1.5 times that beside a name), and as a
    whole as far as the simulation agrees with the rows' mean better than steps and images that differ by chance
    would let it, which only a calibration on these rows does; what the findings make of the mean is taken back as
    far as it agrees better than with them, and stands out of the constant's own error. Either way it is no larger
    than what the findings make of the mean of some step: nothing else was there to be calibrated away, and a law's
    zero shifts no more. Beyond that, and elsewhere, it must be significant. Beside a law that is nil at an
    arbitrary place it is what rows say, and so it is where a unit was seen in a single step: be it the step's own,
    the rows to come are of that step. A unit in which nothing was found to act has one only if it is significant.
    """
    problem = decision.problem
    state, untouched = decision.final_state(), problem.view.fresh_state()
    lawful = {law.channel for law in decision.laws}
    result: dict[str, dict[str, float]] = {}
    code, keys = unit_keys(problem.view, problem.groups.unit_columns)
    for d in problem.data:
        if not d.calibrated:
            continue
        d.follow(state)
        acted = not np.array_equal(state[d.channel.name], untouched[d.channel.name], equal_nan=True)
        floats = any(t.effect.floating and d.channel.name in t.variant.channels[:1] for t in decision.terms)
        sure = 0.0 if floats else 1.0 if d.channel.name in lawful else NAMED_ERRORS
        before, left = d.residual(untouched), d.residual(state)
        stretched = acted and is_stretched(decision, d, left - before)
        values, errors = _shrunk(d, left, sure) if acted else _plain(d, left)
        if acted:
            reach = reach_of(d, before - left)
            odds, mean = calibrated(d, before, left, errors, reach, floats=floats), _means(d, left)[0]
            if d.second is None:  # else the zero took the mean along
                taken = _beyond(mean - _means(d, before)[0], errors)
                values = odds.here * mean + odds.elsewhere * taken + odds.never * values
            if d.channel.name in lawful:
                reach = np.maximum(reach, _span_of(d, before - left))
            lone, alone = ~np.isfinite(errors), _means(d, left)[1]
            values = np.where(lone, _less(d.constants(left), sure * alone), values)
            errors = np.where(lone, alone, errors)
            values = np.where(np.abs(values) > CONSTANT_Z * errors, values, np.clip(values, -reach, reach))
            if stretched:
                values = line_of(d, left - before)[:, 0]
            elif d.second is not None and odds.here > FITTED_HERE:
                values = line_of(d, left)[:, 0]  # with its zero: neither is what the findings make of a mean
        touched = np.bincount(d.unit, np.abs(before - left), minlength=d.units) > 0.0
        if acted and not touched.all():  # by what happens in another device
            plain, plain_errors = _plain(d, left)
            values, errors = np.where(touched, values, plain), np.where(touched, errors, plain_errors)
        found: dict[str, float] = {}
        for unit in range(d.units):
            first = d.use[np.flatnonzero(d.unit == unit)[0]]
            if abs(values[unit]) > (0.0 if touched[unit] else CONSTANT_Z * errors[unit]):
                found[keys[code[first]]] = float(values[unit])
        if found:
            result[d.channel.name] = found
    return result


def zeros_of(decision: Decision, constants: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Zero of each unit's signal that the user's calibration fitted to a recording with an effect in it.

    It is what the rows' mean leaves beside the findings and the gains in `constants`; left out where it is none. A
    mean that the untouched simulation does not have, either, was not fitted here: then steps share errors in it.
    """
    problem, state = decision.problem, decision.final_state()
    untouched = problem.view.fresh_state()
    code, keys = unit_keys(problem.view, problem.groups.unit_columns)
    result: dict[str, dict[str, float]] = {}
    for d in problem.data:
        name = d.channel.name
        if (
            d.second is None
            or d.channel.role is not Role.INTENSITY
            or np.array_equal(state[name], untouched[name], equal_nan=True)
        ):
            continue
        d.follow(state)
        weight, gains = d.root_weight**2, constants.get(name, {})
        found: dict[str, float] = {}
        for unit in range(d.units):
            rows = np.flatnonzero((d.unit == unit) & (weight > 0.0))
            if not rows.size:
                continue
            key = keys[code[d.use[rows[0]]]]
            left = d.residual(state)[rows] - d.scale[rows] * gains.get(key, 0.0)
            zero, error = float(np.average(left, weights=weight[rows])), float(1.0 / np.sqrt(weight[rows].sum()))
            before = float(np.average(d.residual(untouched)[rows], weights=weight[rows]))
            if abs(before) > CONSTANT_Z * error:
                error = max(error, _error_by_steps(d, left - zero, rows))
            if abs(zero) > CONSTANT_Z * error:
                found[key] = zero
        if found:
            result[name] = found
    return result


def _error_by_steps(d: ChannelData, apart: FloatArray, rows: IntArray) -> float:
    """Error of a mean of rows whose steps share theirs, told from these; none of a single step."""
    step = d.level("step")
    if step is None:
        return 0.0
    weight = d.root_weight[rows] ** 2
    sums = np.bincount(step.code[rows], weight * apart)
    return float(np.sqrt(np.sum(sums**2)) / np.sum(weight))


def of_unseen(decision: Decision, constants: Mapping[str, Mapping[str, float]]) -> tuple[list[str], dict[str, float]]:
    """Units that a comparison has seen, and the gain or offset that another one is foretold to have.

    What all units need beside a finding (a walk has its zero at some signal) another one needs as well: their mean,
    less the share of it that their scatter may be. Of a single unit nothing tells its own share: it is taken for the
    law's zero as far as the finding moves some rows by as much.
    """
    problem = decision.problem
    state, untouched = decision.final_state(), problem.view.fresh_state()
    code, keys = unit_keys(problem.view, problem.groups.unit_columns)
    seen = [keys[k] for k in np.unique(code)]
    unseen: dict[str, float] = {}
    for channel, found in constants.items():
        values = np.array([found.get(key, 0.0) for key in seen])
        mean = float(values.mean())
        if len(values) == 1 and mean != 0.0:
            d = next(d for d in problem.data if d.channel.name == channel)
            change = (d.residual(untouched) - d.residual(state)) / d.scale
            reach = float(np.quantile(np.abs(change), 0.99))
            unseen[channel] = float(np.clip(mean, -reach, reach))
        if len(values) > 1 and mean != 0.0:
            error = float(values.std(ddof=1)) / np.sqrt(len(values))
            value = mean * max(1.0 - (error / mean) ** 2, 0.0)
            if value != 0.0:
                unseen[channel] = value
    return seen, unseen


def _plain(d: ChannelData, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Constants of the units and their errors under the channel's noise."""
    return d.constants(residual), d.constant_errors


def _means(d: ChannelData, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean gain or offset of each unit's rows, and its error if these shared none."""
    weight = (d.root_weight * d.scale) ** 2
    power = np.maximum(np.bincount(d.unit, weight, minlength=d.units), 1e-300)
    return np.bincount(d.unit, weight * residual / d.scale, minlength=d.units) / power, 1.0 / np.sqrt(power)


def reach_of(d: ChannelData, change: FloatArray) -> FloatArray:
    """Largest gain or offset that a change of the rows means for one step of each unit."""
    step = d.level("step")
    code, count = (np.zeros_like(d.unit), 1) if step is None else (step.code, step.count)
    part = d.unit * count + code
    weight = (d.root_weight * d.scale) ** 2
    power = np.bincount(part, weight, minlength=d.units * count)
    moved = np.bincount(part, weight * change / d.scale, minlength=d.units * count)
    return np.asarray(np.max(np.abs(moved / np.maximum(power, 1e-300)).reshape(d.units, count), axis=1))


def _span_of(d: ChannelData, change: FloatArray) -> FloatArray:
    """From the least to the largest gain or offset that a change makes of rows: a law may be nil at either end."""
    low, high = np.quantile(change / d.scale, [0.01, 0.99])
    return np.full(d.units, float(high - low))


class Calibrated(NamedTuple):
    """Probabilities that a simulation was calibrated on these rows, on others with the same effect, or without."""

    here: float
    elsewhere: float
    never: float


def calibrated(
    d: ChannelData, untouched: FloatArray, left: FloatArray, errors: FloatArray, reach: FloatArray,
    *, floats: bool = False,
) -> Calibrated:  # fmt: skip
    """How the user's calibration dealt with what the findings make of the mean, told from both means.

    Calibrated on these rows, the untouched simulation agrees with their mean as well as if they shared nothing;
    calibrated on others, up to what steps are off by chance; never with the effect in it, the corrected simulation
    does so, or each unit has a constant of its own that is about as large as what the findings make. A law that is
    nil at an arbitrary place (`floats`) leaves such a constant by itself.

    Args:
        d: the channel; untouched, left: residuals of the simulation as it is and beside the findings.
        errors: of the units' constants, infinite where a single step tells no scatter of steps.
        reach: what the findings make of each unit's mean. Without a calibration it is in the mean as well, and a
            single step's own error would have to cancel it: that much at least the mean then is by chance.
    """
    means, alone = _means(d, untouched)
    beside, _ = _means(d, left)
    expected = np.maximum(np.where(np.isfinite(errors), errors, reach), alone)
    fitted = FITTED_ERRORS * alone
    chance = np.hypot(expected, fitted)
    wide = np.hypot(chance, reach)
    never = np.logaddexp(_density(beside, chance), _density(beside, wide)) - np.log(2.0)
    if floats:
        never = _density(means, wide)
    told_of = np.array([float(np.sum(x)) for x in (_density(means, fitted), _density(means, chance), never)])
    if not np.all(np.isfinite(errors)):  # what one step is off by says nothing of others
        told_of[1] = -np.inf
    return Calibrated(*softmax(told_of + np.log(PRIOR)).tolist())


def _density(x: FloatArray, scatter: FloatArray) -> FloatArray:
    """Logarithm of a normal density, but for a constant."""
    return np.asarray(-0.5 * (x / scatter) ** 2 - np.log(scatter))


def _shrunk(d: ChannelData, residual: FloatArray, sure: float) -> tuple[FloatArray, FloatArray]:
    """Constants of the units under the noise that is left, each less the share of it that `sure` errors may be."""
    kept = d.tau
    d.rebuild(d.fit_scatter(residual)[1])
    values, errors = _plain(d, residual)
    d.rebuild(kept)
    step = d.level("step")
    if step is not None and step.floor > 0.0 and not step.declared:
        values, errors = _by_steps(d, residual, step)
    return _less(values, sure * errors), errors


def _less(values: FloatArray, errors: FloatArray) -> FloatArray:
    """Each value less the share of it that errors may be."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(values != 0.0, 1.0 - (errors / values) ** 2, 0.0)
    return np.asarray(values * np.clip(np.nan_to_num(share), 0.0, 1.0))


def _beyond(values: FloatArray, errors: FloatArray) -> FloatArray:
    """Each value as far as it is large beside its error: a calibration elsewhere was off by as much in any case."""
    power = values**2
    return np.asarray(values * np.nan_to_num(power / np.maximum(power + errors**2, 1e-300)))


def _by_steps(d: ChannelData, residual: FloatArray, step: Level) -> tuple[FloatArray, FloatArray]:
    """Constants of the units from the means of their steps, where these are too few to tell their scatter.

    A single step may be off by itself: its constant tells nothing of others, its error is infinite.
    """
    weight = d.root_weight**2
    values, errors = np.zeros(d.units), np.zeros(d.units)
    for unit in range(d.units):
        rows = d.unit == unit
        power = np.bincount(step.code[rows], (weight * d.scale**2)[rows], minlength=step.count)
        sums = np.bincount(step.code[rows], (weight * d.scale * residual)[rows], minlength=step.count)
        there = power > 0.0
        means = sums[there] / power[there]
        white = 1.0 / np.sqrt(float(np.sum(power)))
        scatter = float(np.std(means, ddof=1)) / np.sqrt(len(means)) if len(means) > 1 else np.inf
        values[unit], errors[unit] = float(np.sum(sums) / np.sum(power)), max(white, scatter)
    return values, errors
