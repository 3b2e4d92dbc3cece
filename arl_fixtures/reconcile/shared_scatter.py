"""Scatter that rows of a step, an image or an angle share by chance: a finding beyond what the table declares.

Undeclared it is allowed for, unless it exceeds the scatter of a single frame (of single readings: twice that).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import Effect, Kind, State, Variant
from arl_fixtures.reconcile.effects_common import pure_rows
from arl_fixtures.reconcile.followed import condition_of
from arl_fixtures.reconcile.noise import Level
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.terms import Term, default_values
from arl_fixtures.reconcile.whitener import Whitener

SCATTER_GAIN = 9.0
LEAST_SHARED = 0.3
"""Row errors that images must share at least, in the tenth of the rows in which it shows most: less is what
neighbouring pixels' noise has in common."""
LARGE_WITHIN = 2.0
"""Row errors from which what images or angles share within a step is told, though single frames scatter by more."""
LARGE_READING = 2.0
"""Scatters of a row from which what steps of single readings share is told: of frames, one would do."""
MOST_TAKEN = 0.5
"""Share of an image's weight in one row from which the others tell nothing of how it scatters."""
EVERYWHERE, NORMAL_QUARTILE = 0.6, 0.6745
"""Share of a scatter that the median of what groups are off by must show, as a normal law would."""


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


def _is_everywhere(partial: Whitener, residual: FloatArray, name: str, tau: float) -> bool:
    """Whether most groups are off by about as much as a scatter says: what is off at a few edges is no scatter."""
    sums, weight = partial.group_sums(residual, name)
    mean = sums[weight > 0.0] / weight[weight > 0.0]
    usual = float(np.median(np.abs(mean - np.median(mean)))) / NORMAL_QUARTILE
    return usual > EVERYWHERE * tau


def _rows_own(data: ChannelData, level: Level, state: State) -> float:
    """What rows scatter by within images, as far as their mean feels it, in units of what their weights say; ≥ 1.

    Where a few bright rows carry an image's mean and scatter by more than is stated, their images seem to scatter.
    The sandwich of White (Econometrica 48 (1980) 817), each row's deviation freed of what the mean took from it.
    """
    direction, z = data.root_weight * level.scale, data.root_weight * data.residual(state)
    weight = np.maximum(np.bincount(level.code, direction**2, level.count), 1e-300)
    inner = z - direction * (np.bincount(level.code, direction * z, level.count) / weight)[level.code]
    taken = np.bincount(level.code, direction**4, level.count) / weight**2
    several = taken < MOST_TAKEN
    if not several.any():
        return 1.0
    found = np.bincount(level.code, (direction * inner) ** 2, level.count) / weight
    return float(np.sqrt(max(np.mean(found[several] / (1.0 - taken[several])), 1.0)))


def _gain_away_from_edges(problem: Problem, data: ChannelData, index: int, state: State) -> float:
    """What the scatter of a level gains in rows that see one surface; infinite where none is said to see more.

    A stage that stands a little beside its position moves what edges tell, image by image, and no signal within them.
    """
    inside = np.flatnonzero(pure_rows(problem.view)[problem.view.rows[data.use]])
    if len(inside) == len(data.use) or not len(inside):
        return np.inf
    part = data.part(inside)
    level = part.levels[index]
    inner = {lv.name: data.tau.get(lv.name, 0.0) for lv in part.levels[:index]}
    partial = Whitener(part.root_weight, part.levels[: index + 1], {**inner, level.name: level.floor})
    return part.level_scatter(part.residual(state), replace(level, declared=False), partial)[1]


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
    if group == "frame" and gain >= SCATTER_GAIN:
        gain = data.level_scatter(data.residual(state) / _rows_own(data, level, state), asked, partial)[1]
    if group != "step" and gain >= SCATTER_GAIN:
        gain = min(gain, _gain_away_from_edges(problem, data, index, state))
    declared = any(lv.declared for lv in data.levels)
    size = tau * float(np.median(level.scale))
    if gain < SCATTER_GAIN or (level.floor > 0 and (tau < 1.4 or not level.declared)):
        return None
    alone = data.stated * data.spread
    told = float(np.quantile(tau * level.scale / alone, 0.9))
    frames = np.maximum(problem.view.frames()[data.use], 1.0)
    bearable = np.where(frames > 1.0, 1.0, LARGE_READING) * alone * np.sqrt(frames)
    small = size < float(np.median(bearable))
    if small and group != "step" and told > LARGE_WITHIN:  # a table can declare what steps share only
        small = not _is_everywhere(partial, data.residual(state), level.name, tau)
    driver = condition_of(problem, data, group, state, strict=small and not declared)
    if effect.common:  # of single frames, each of one pulse: nothing else needs to be said of what they share
        driver = ""
    elif not declared and small and not driver:
        return None
    # a share of the signal shows where that is strong
    if not effect.common and not level.declared and told < LEAST_SHARED:
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
