"""What no tangent can score: free patterns over pixels, and scatter that rows of a group share by chance.

A pattern (one value per pixel) is accepted when the values fitted on half of the blocks predict the other half; a
pattern that only mirrors the mean of a found effect is the calibration's answer to that effect, not a finding. Shared
scatter is a finding only beyond what the table declares (`sim_X_repeat_std`); undeclared it is allowed for, unless it
exceeds the scatter of a single frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import Effect, Kind, Parameter, State, Variant
from arl_fixtures.reconcile.followed import condition_of
from arl_fixtures.reconcile.noise import Whitener, fit_tau
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.silence import deaths, some_dark
from arl_fixtures.reconcile.terms import Term, default_values, field_keys, forward

PATTERN_GAIN, PATTERN_Z = 6.0, 2.5
"""Log-likelihood and significance over blocks of a pattern: chance gave 2.1 and 2.0 at most in 110 null tables."""
SPARSE_Z = 6.0
SCATTER_GAIN = 9.0
FEWEST_LEVELS = 5
"""Pixels or zones whose values make a pattern."""
PLACES_OF_A_PIXEL = 1.5
"""Stage angles per pixel, on average, below which what a pixel sees is not told from what it is."""
MIDDLE, WELL_KNOWN, FEW_P = 0.27, 3.0, 1e-3
"""Scatters within which a fifth of all pixels should lie; standard errors in a scatter of pixels that tell of it; and
probability of as many so near as a pattern has that is none."""
LEAST_SHARED = 0.3
"""Row errors that images must share at least, in the tenth of the rows in which it shows most: less is what
neighbouring pixels' noise has in common."""


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
        bare: the term with values as they were measured, not drawn towards none by what is noise in them.
    """

    term: Term
    bare: Term
    gain: float
    z: float
    size: float


def find_patterns(problem: Problem, effects: Sequence[Effect], terms: Sequence[Term]) -> list[Pattern]:
    """Patterns beside the given terms, the best first."""
    found = []
    base = forward(terms, problem.view)
    for effect in effects:
        for variant in effect.variants(problem.view):
            fields = [p for p in variant.parameters if p.per]
            if len(fields) == 1:
                pattern = _fit_pattern(problem, effect, variant, fields[0], terms, base)
                if pattern is not None and pattern.gain > PATTERN_GAIN and pattern.z > PATTERN_Z:
                    found.append(pattern)
    return sorted(found, key=lambda p: -p.gain)


def _fit_pattern(
    problem: Problem, effect: Effect, variant: Variant, parameter: Parameter, terms: Sequence[Term], base: State
) -> Pattern | None:
    view = problem.view
    code, keys = field_keys(parameter.per, view)
    counted = any(channel.name in variant.channels for channel in view.channels(Role.FRACTION))
    null = parameter.null if parameter.null is not None else 0.0
    sparse = parameter.low >= null or parameter.high <= null
    by_light = sparse and not counted and "step" in parameter.per
    if by_light and not any(
        some_dark(d, base[d.channel.name][d.use]) for d in problem.data if d.channel.name in variant.channels
    ):
        return None
    if len(keys) < FEWEST_LEVELS or view.n < (1 if counted else 2) * len(keys):
        return None
    step = 0.1 * parameter.typical
    uniform = dict.fromkeys(keys, null + step)
    term = Term(effect=effect, variant=variant, values=default_values(variant), fields={parameter.name: uniform})
    moved = forward([*terms, term], view)
    names = [d for d in problem.data if moved[d.channel.name] is not base[d.channel.name]]
    gram, score = np.zeros((2, len(keys))), np.zeros((2, len(keys)))
    due, lack = np.zeros(len(keys)), np.zeros(len(keys))
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
        if not counted and np.sum(seen & (size_of > LEAST_PART)) > 2 * strong.sum():
            return None  # what most of them lose in part is no death: dirt, or another scene
        chosen = int(strong.sum())
        if by_light:
            died = deaths(keys, parameter.per, strong, np.sqrt(due) > SPARSE_Z)
            if not died.on_the_way:
                return None
            strong, chosen = died.gone, died.pixels  # each chose one moment: what follows, it did not
        values[strong] = estimate[strong]
        measured = values
        gain = float(0.5 * np.sum(z[strong] ** 2) - chosen * np.log(len(keys)))
        size = float(strong.sum())
        z_half = SPARSE_Z if strong.any() else 0.0
    else:
        tau, gain = fit_tau(pull, total)
        if _sees_one_place(problem) and _sits_in_few(measured[good], total[good], tau):
            return None
        values[good] = pull[good] / (total[good] + 1.0 / max(tau, 1e-12) ** 2)
        size = tau
        z_half = half_z(gram, score, tau)
    fitted = [
        Term(effect=effect, variant=variant, values=default_values(variant), fields={parameter.name: level})
        for level in (_levels(parameter, keys, null, values), _levels(parameter, keys, null, measured))
    ]
    return Pattern(term=fitted[0], bare=fitted[1], gain=gain, z=z_half, size=size)


def _sees_one_place(problem: Problem) -> bool:
    """Whether the stage turns, and most pixels are in the table at one of its angles only."""
    if not problem.view.varies("stage_angle_deg"):
        return False
    rows = problem.view.rows
    pixel = np.unique(problem.columns.group("dut", "pixel_u", "pixel_v")[rows]).size
    place = np.unique(problem.columns.group("dut", "pixel_u", "pixel_v", "stage_angle_deg")[rows]).size
    return place < PLACES_OF_A_PIXEL * pixel


def _sits_in_few(values: FloatArray, precision: FloatArray, tau: float) -> bool:
    """Whether a pattern is that of some pixels, most others being far more alike than gains of such a scatter are.

    Where each was seen at one place only, it is no gain: what a few see there is missing, an edge say.
    """
    sure = values[precision * tau**2 > WELL_KNOWN**2]
    sure = sure - np.median(sure) if len(sure) else sure
    near = float(stats.norm.cdf(MIDDLE)) * 2.0 - 1.0
    return bool(stats.binom.sf(np.sum(np.abs(sure) < MIDDLE * tau) - 1, max(len(sure), 1), near) < FEW_P)


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
    total = np.zeros(len(residual))
    if data.calibrated:
        total = data.scale * data.constants(residual)[data.unit]
    weight = data.root_weight**2
    for name in ("step", "frame"):
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
        level = next((lv for lv in d.levels if lv.name == "pixel"), None)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Shared scatter beyond what is declared or bearable.

    Attributes:
        term: of a `Kind.GROUP_SCATTER` effect, its amplitude set.
        level: `step`, `frame` or `angle`.
        gain: log-likelihood over the declared scatter.
        value: standard deviation in the channel's unit.
        half_width: of its 95 % interval.
        driver: recorded condition that the groups follow, so that it is no mere scatter; empty for none.
    """

    term: Term
    channel: str
    level: str
    gain: float
    value: float
    half_width: float
    driver: str


def find_scatter(problem: Problem, effects: Sequence[Effect], state: State) -> list[Scatter]:
    """Group scatter that the table's declarations do not cover, the strongest first."""
    found = []
    for effect in effects:
        if effect.kind is not Kind.GROUP_SCATTER and not effect.common:
            continue
        for variant in effect.variants(problem.view):
            if "group" not in variant.options:
                continue
            name, group = str(variant.options.get("channel", "")), str(variant.options.get("group", "step"))
            data = next((d for d in problem.data if d.channel.name == name), None)
            if data is None:
                continue
            made = _scatter_of(problem, effect, variant, data, group, state)
            if made is not None:
                found.append(made)
    return sorted(found, key=lambda s: (-round(s.gain, 6), not s.term.effect.common))


def _scatter_of(
    problem: Problem, effect: Effect, variant: Variant, data: ChannelData, group: str, state: State
) -> Scatter | None:
    index = next((k for k, level in enumerate(data.levels) if level.name == group), None)
    if index is None or data.channel.role.value == "scatter":
        return None
    level = data.levels[index]
    inner = {lv.name: data.tau.get(lv.name, 0.0) for lv in data.levels[:index]}
    partial = Whitener(data.root_weight, data.levels[: index + 1], {**inner, level.name: level.floor})
    asked = replace(level, declared=False)  # whether the declaration holds is the question
    tau, gain = data.level_scatter(data.residual(state), asked, partial)
    declared = any(lv.declared for lv in data.levels)
    size = tau * float(np.median(level.scale))
    if gain < SCATTER_GAIN or (level.floor > 0 and (tau < 1.4 or not level.declared)):
        return None
    alone = data.stated * data.spread
    small = size < float(np.median(alone * np.sqrt(np.maximum(problem.view.frames()[data.use], 1.0))))
    driver = condition_of(problem, data, group, state, strict=small and not declared)
    if effect.common:  # of single frames, each of one pulse: nothing else needs to be said of what they share
        driver = ""
    elif not declared and small and not driver:
        return None
    # a share of the signal shows where that is strong
    if not effect.common and not level.declared and float(np.quantile(tau * level.scale / alone, 0.9)) < LEAST_SHARED:
        return None
    amplitude = next(p for p in variant.parameters if p.is_amplitude)
    unit = 1.0 if effect.common else float(np.median(level.scale))  # of a share, or in counts
    extra = float(np.sqrt(max(tau**2 - level.floor**2, 0.0))) * unit
    term = Term(effect=effect, variant=variant, values={**default_values(variant), amplitude.name: extra})
    return Scatter(
        term=term, channel=data.channel.name, level=group, gain=gain, value=extra,
        half_width=1.96 * extra / np.sqrt(2.0 * max(level.count - 1, 1)),
        driver=driver,
    )  # fmt: skip
