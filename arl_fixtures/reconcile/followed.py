"""Which recorded condition what a group of rows shares follows: then it is no scatter, whatever its law.

Two tests over all conditions: a parabola, and whether neighbours in the condition's order are alike, which a loop, a
wave or a table of a firmware shows as well. For the second the same permutations of the groups serve every condition,
so that conditions which go along with each other count as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.problem import ChannelData, Problem
from arl_fixtures.reconcile.roles import unit_of

DRIVEN_P, ALIKE_P = 0.05, 0.02
"""Below these probabilities, over all conditions, a parabola or likeness of neighbours is no chance."""
FEWEST_GROUPS = 8
PERMUTATIONS = 2000
HELD_BACK = 3.0
"""Scatters to which a group is held back before neighbours are compared."""
SECOND = 0.5
"""Weight of the next but one neighbour."""


@dataclass(frozen=True, slots=True)
class _Shared:
    """What groups share: whitened mean beside the units' constants, its weight, and conditions at each group."""

    mean: FloatArray
    left: FloatArray
    root: FloatArray
    constants: list[FloatArray]
    conditions: dict[str, FloatArray]


def condition_of(problem: Problem, data: ChannelData, group: str, state: State) -> str:
    """Temperature, time, ramp or supply that what groups of rows share follows; empty for none.

    Args:
        problem: the table; data: the channel; state: corrected simulation.
        group: `step`, `frame` or `angle`.
    """
    shared = _shared_of(problem, data, group, state)
    return _parabola(shared, data.units) or _neighbours(shared)


def _shared_of(problem: Problem, data: ChannelData, group: str, state: State) -> _Shared:
    level = next(lv for lv in data.levels if lv.name == group)
    weight = data.root_weight**2 * data.scale
    bottom = np.bincount(level.code, weight * data.scale, minlength=level.count)
    mean = np.bincount(level.code, weight * data.residual(state), minlength=level.count) / np.maximum(bottom, 1e-300)
    view = problem.view
    names = [*view.temperatures()[:2], "time_s", "ramp", "cycle"]
    names += [n for n in sorted(view.columns.numbers) if unit_of(n) in {"V", "A"} and not n.startswith("sim_")]
    if group != "step":  # images and angles of one step share its conditions
        names = ["stage_angle_deg"]
    size = np.maximum(np.bincount(level.code, minlength=level.count), 1)
    conditions = {}
    for name in dict.fromkeys(names):
        if view.varies(name) and name != data.channel.name:
            x = np.bincount(level.code, np.nan_to_num(view.number(name)[data.use]), minlength=level.count) / size
            if x.std() > 0:
                conditions[name] = (x - x.mean()) / x.std()
    unit = np.zeros(level.count, dtype=np.int64)
    unit[level.code] = data.unit
    constants = [(unit == k).astype(np.float64) for k in range(data.units)]
    root = np.sqrt(np.minimum(bottom, np.median(bottom)))
    target = mean * root
    base = np.stack(constants, axis=1) * root[:, None]
    left = target - base @ np.linalg.lstsq(base, target, rcond=None)[0]
    return _Shared(target, left, root, constants, conditions)


def _parabola(shared: _Shared, units: int) -> str:
    best, p_value = "", 1.0
    count = len(shared.mean)
    for name, x in shared.conditions.items():
        few = count - units < 6 or len(np.unique(x)) < 4
        columns = [x] if few else [x, x**2]
        design = np.stack([*shared.constants, *columns], axis=1) * shared.root[:, None]
        left = shared.mean - design @ np.linalg.lstsq(design, shared.mean, rcond=None)[0]
        rest = count - design.shape[1]
        if rest < 2 or float(left @ left) <= 0.0:
            continue
        ratio = (float(shared.left @ shared.left) - float(left @ left)) / len(columns) / (float(left @ left) / rest)
        p = float(stats.f.sf(ratio, len(columns), rest))
        if p < p_value:
            best, p_value = name, p
    return best if p_value * len(shared.conditions) < DRIVEN_P else ""


def _neighbours(shared: _Shared) -> str:
    orders = {n: np.argsort(x, kind="stable") for n, x in shared.conditions.items() if len(np.unique(x)) > 4}
    if len(shared.left) < FEWEST_GROUPS or not orders:
        return ""
    spread = 1.4826 * float(np.median(np.abs(shared.left)))
    held = np.clip(shared.left, -HELD_BACK * spread, HELD_BACK * spread)
    rng = np.random.default_rng(len(held))
    mixed = np.stack([held, *(rng.permutation(held) for _ in range(PERMUTATIONS))])
    scores = np.stack([_likeness(mixed[:, order]) for order in orders.values()])
    scores = (scores - scores.mean(axis=1, keepdims=True)) / np.maximum(scores.std(axis=1, keepdims=True), 1e-300)
    largest = scores.max(axis=0)
    p_value = float(np.mean(largest[1:] >= largest[0]))
    return list(orders)[int(np.argmax(scores[:, 0]))] if p_value < ALIKE_P else ""


def _likeness(x: FloatArray) -> FloatArray:
    """Sum of products of neighbours, the next but one counting half; x is (draws, groups)."""
    near = np.sum(x[:, :-1] * x[:, 1:], axis=1)
    return np.asarray(near + SECOND * np.sum(x[:, :-2] * x[:, 2:], axis=1))
