"""What no tangent can score: free patterns over pixels.

A pattern (one value per pixel) is accepted when the values fitted on half of the blocks predict the other half; a
pattern that only mirrors the mean of a found effect is the calibration's answer to that effect, not a finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import Effect, Parameter, State, Variant
from arl_fixtures.reconcile.noise import PARTS_OF_STEPS, fit_tau, less_constants
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.silence import FEWEST_OF_PIXEL, deaths, some_dark
from arl_fixtures.reconcile.terms import Term, default_values, field_keys, forward
from arl_fixtures.reconcile.uneven_pixels import is_smooth, sees_one_place, sits_in_few

PATTERN_GAIN, PATTERN_Z = 6.0, 2.5
"""Log-likelihood and significance over blocks of a pattern: chance gave 2.1 and 2.0 at most in 110 null tables."""
SPARSE_Z = 6.0
FEWEST_LEVELS = 5
"""Pixels or zones whose values make a pattern."""
LEAST_ANSWERS, LEAST_LIGHT, LEAST_PART = 0.5, 0.85, 0.15
"""Share of its answers, or where none are counted of its light, that a dead pixel lacks; and a part of either."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """A fitted pattern.

    Attributes:
        term: with its levels' values.
        gain: log-likelihood over no pattern.
        z: significance of predicting one half of the blocks from the other.
        size: standard deviation (dense) or number of levels (sparse).
        smooth: whether neighbours are alike, so that it is no pattern of single pixels.
        bare: the term with values as they were measured, not drawn towards none by what is noise in them.
    """

    term: Term
    bare: Term
    gain: float
    z: float
    size: float
    smooth: bool = False

    @property
    def is_dense(self) -> bool:
        """Whether each pixel has a value of its own, to either side."""
        return any(p.per and p.low < (p.null or 0.0) < p.high for p in self.term.variant.parameters)


def find_patterns(
    problem: Problem, effects: Sequence[Effect], terms: Sequence[Term], *, smooth: bool = False
) -> list[Pattern]:
    """Patterns beside the given terms, the best first; those in which neighbours are alike only if `smooth`."""
    found = []
    base = forward(terms, problem.view)
    for effect in effects:
        for variant in effect.variants(problem.view):
            fields = [p for p in variant.parameters if p.per]
            if len(fields) == 1:
                pattern = _fit_pattern(problem, effect, variant, fields[0], terms, base)
                if pattern is not None and pattern.gain > PATTERN_GAIN and pattern.z > PATTERN_Z:
                    found.append(pattern)
    return sorted((p for p in found if smooth or not p.smooth), key=lambda p: -p.gain)


def _fit_pattern(
    problem: Problem, effect: Effect, variant: Variant, parameter: Parameter, terms: Sequence[Term], base: State
) -> Pattern | None:
    view = problem.view
    code, keys = field_keys(parameter.per, view)
    counted = any(channel.name in variant.channels for channel in view.channels(Role.FRACTION))
    null = parameter.null if parameter.null is not None else 0.0
    sparse = parameter.low >= null or parameter.high <= null
    by_light = sparse and not counted and ("step" if view.varies("step") else "cycle") in parameter.per
    if by_light and not any(
        some_dark(d, base[d.channel.name][d.use]) for d in problem.data if d.channel.name in variant.channels
    ):
        return None
    if len(keys) < FEWEST_LEVELS or view.n < (1 if counted or by_light else 2) * len(keys):
        return None
    step = 0.1 * parameter.typical
    uniform = dict.fromkeys(keys, null + step)
    term = Term(effect=effect, variant=variant, values=default_values(variant), fields={parameter.name: uniform})
    moved = forward([*terms, term], view)
    names = [d for d in problem.data if moved[d.channel.name] is not base[d.channel.name]]
    gram, score = np.zeros((2, len(keys))), np.zeros((2, len(keys)))
    due, lack, rows = np.zeros(len(keys)), np.zeros(len(keys)), np.zeros(len(keys), dtype=np.int64)
    answers = np.full(len(keys), np.inf)
    for d in names:
        if d.channel.role.value == "scatter":
            continue
        tangent = d.expect * (moved[d.channel.name] - base[d.channel.name])[d.use] / step
        residual = d.residual(base)
        if not sparse:  # a few dead pixels would pull the mean of their step
            residual = residual - shared_part(d, residual)
        weight = d.root_weight**2
        if sparse and counted:  # that none of a row's frames had an answer is no wild reading, nor is their light
            weight = 1.0 / (d.stated * d.spread) ** 2
        if by_light:
            certain = tangent / (d.stated * d.spread) ** 2
            due += np.bincount(code[d.use], certain * tangent, minlength=len(keys))
            lack += np.bincount(code[d.use], certain * residual, minlength=len(keys))
        rows = np.maximum(rows, np.bincount(code[d.use], minlength=len(keys)))
        half = _halves(problem, d, code[d.use])
        for k in (0, 1):
            part = half == k
            gram[k] += np.bincount(code[d.use][part], (weight * tangent**2)[part], minlength=len(keys))
            score[k] += np.bincount(code[d.use][part], (weight * tangent * residual)[part], minlength=len(keys))
        if d.channel.role is Role.FRACTION:
            share = np.bincount(code[d.use], tangent * residual, minlength=len(keys))
            answers = share / np.maximum(np.bincount(code[d.use], tangent**2, minlength=len(keys)), 1e-12)
    total, pull = gram.sum(axis=0), score.sum(axis=0)
    good = total > 1e-9
    if good.sum() < FEWEST_LEVELS:
        return None
    values, measured = np.zeros(len(keys)), np.zeros(len(keys))
    measured[good] = pull[good] / total[good]
    if sparse:
        z = pull / np.sqrt(np.maximum(total, 1e-12))
        right = pull * (1.0 if parameter.low >= null else -1.0) > 0
        estimate = pull / np.maximum(total, 1e-12)
        # rows without light are held back as outliers: whether a level has any left is asked of them as they stand
        sure = lack / np.sqrt(np.maximum(due, 1e-12)) if by_light else z
        seen = good & right & (np.abs(sure) > SPARSE_Z)
        size_of = np.minimum(np.abs(estimate), np.abs(answers))
        strong = seen & (size_of > (LEAST_ANSWERS if counted else LEAST_LIGHT))
        if not counted:  # what is darker than dark, or is so once, is a wild reading
            strong &= ((size_of - 1.0) * np.sqrt(total) < SPARSE_Z) & (rows >= FEWEST_OF_PIXEL)
        if not counted and np.sum(seen & (size_of > LEAST_PART)) > 2 * strong.sum():
            return None  # what most of them lose in part is no death: dirt, or another scene
        chosen = int(strong.sum())
        if by_light:
            died = deaths(keys, parameter.per, due, lack, rows)
            if not died.on_the_way:
                return None
            strong, chosen = died.gone & good, died.pixels  # each chose one moment: what follows, it did not
        values[strong] = parameter.typical if by_light else estimate[strong]
        measured = values
        gain = float(0.5 * np.sum(z[strong] ** 2) - chosen * np.log(len(keys)))
        size = float(strong.sum())
        z_half, alike = SPARSE_Z if strong.any() else 0.0, False
    else:
        tau, gain = fit_tau(pull, total)
        if sees_one_place(problem) and sits_in_few(measured[good], total[good], tau):
            return None
        alike = is_smooth(parameter.per, keys, np.where(total * tau**2 > 1.0, measured, np.nan))
        values[good] = pull[good] / (total[good] + 1.0 / max(tau, 1e-12) ** 2)
        size = tau
        z_half = half_z(gram, score, tau)
    fitted = [
        Term(effect=effect, variant=variant, values=default_values(variant), fields={parameter.name: level})
        for level in (_levels(parameter, keys, null, values), _levels(parameter, keys, null, measured))
    ]
    return Pattern(term=fitted[0], bare=fitted[1], gain=gain, z=z_half, size=size, smooth=alike)


def _levels(
    parameter: Parameter, keys: Sequence[tuple[str, ...]], null: float, values: FloatArray
) -> dict[tuple[str, ...], float]:
    """Value of each level that differs from none."""
    level = {
        key: float(np.clip(null + x, parameter.low, parameter.high)) for key, x in zip(keys, values, strict=True)
    }
    return {key: x for key, x in level.items() if x != null}


def _halves(problem: Problem, data: ChannelData, level: IntArray) -> IntArray:
    """Half of each row: whole blocks by turns, or images where blocks are parts of these and keep a pixel's rows.

    Where no images are told apart a pixel's own rows go by turns: each was measured anew.
    """
    groups, rows = problem.groups, problem.view.rows[data.use]
    for code in (data.block, groups.frame, groups.step):
        if code is None:
            continue
        here = code if code is data.block else code[rows]
        half = np.unique(here, return_inverse=True)[1].astype(np.int64) % 2
        both = np.intersect1d(level[half == 0], level[half == 1])
        if 2 * len(both) > len(np.unique(level)):
            return half
    order = np.argsort(level, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(level))[:-1]])
    turn = np.empty(len(level), dtype=np.int64)
    turn[order] = np.arange(len(level)) - start[level[order]]
    return turn % 2


def half_z(gram: FloatArray, score: FloatArray, tau: float) -> float:
    """Significance of the product of both halves' estimates."""
    first = score[0] / np.maximum(gram[0] + 1.0 / max(tau, 1e-12) ** 2, 1e-12)
    product = first * score[1]
    scale = float(np.sqrt(np.sum(first**2 * gram[1])))
    return float(product.sum()) / scale if scale > 0 else 0.0


def shared_part(data: ChannelData, residual: FloatArray) -> FloatArray:
    """Estimate of what units, steps and images share in a residual (weighted means, shrunk by their scatter).

    Steps before their images: of a step's mean each image would keep another share, and images would seem to differ.
    """
    total, weight = np.zeros(len(residual)), data.root_weight**2
    if data.calibrated and data.second is not None:
        total = residual - less_constants(residual, data.scale, weight, data.unit, second=data.second)
    elif data.calibrated:
        total = data.scale * data.constants(residual)[data.unit]
    for name in ("step", *PARTS_OF_STEPS):
        for level in (level for level in data.levels if level.name == name):
            tau = data.tau.get(level.name, 0.0)
            if tau > 0:
                top = np.bincount(level.code, weight * level.scale * (residual - total), minlength=level.count)
                bottom = np.bincount(level.code, weight * level.scale**2, minlength=level.count)
                total = total + level.scale * (top / (bottom + 1.0 / tau**2))[level.code]
    return total


def is_calibration(problem: Problem, pattern: Pattern, terms: Sequence[Term]) -> bool:
    """Whether a pattern mirrors the per-pixel mean of what the terms do: a calibration refitted on their effect."""
    if not terms:
        return False
    view = problem.view
    base, without = forward(terms, view), view.fresh_state()
    moved = forward([*terms, pattern.term], view)
    for d in problem.data:
        name = d.channel.name
        if moved[name] is base[name] or d.channel.role.value == "scatter":
            continue
        level = d.level("pixel")
        if level is None:
            continue
        ours = _mean_by(level.code, ((moved[name] - base[name])[d.use] / d.scale), level.count)
        theirs = _mean_by(level.code, ((base[name] - without[name])[d.use] / d.scale), level.count)
        unit = np.zeros(level.count, dtype=np.int64)
        unit[level.code] = d.unit
        ours = ours - _mean_by(unit, ours, d.units)[unit]
        theirs = theirs - _mean_by(unit, theirs, d.units)[unit]
        if float(ours @ theirs) < 0 and _squared_correlation(ours, theirs) > 0.4:
            return True
    return False


def _mean_by(code: IntArray, x: FloatArray, count: int) -> FloatArray:
    size = np.maximum(np.bincount(code, minlength=count), 1)
    return np.asarray(np.bincount(code, x, minlength=count) / size)


def _squared_correlation(a: FloatArray, b: FloatArray) -> float:
    power = float(a @ a) * float(b @ b)
    return float(a @ b) ** 2 / power if power > 0 else 0.0
