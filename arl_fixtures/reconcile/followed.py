"""Which recorded condition what a group of rows shares follows: then it is no scatter, whatever its law.

Two tests over all conditions: a parabola, and whether neighbours in the condition's order are alike, which a loop, a
wave or a table of a firmware shows as well. For the second the same permutations of the groups serve every condition,
so that conditions which go along with each other count as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Axis, LawTerm
from arl_fixtures.reconcile.noise import Level
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

DRIVEN_P, ALIKE_P = 0.025, 0.01
"""Below these probabilities, over all conditions, a parabola or likeness of neighbours is no chance."""
NO_CONDITIONS = frozenset({"n_frames", "step", "stage_angle_deg", "pixel_u", "pixel_v"})
"""Columns that only number steps, or that belong to rows."""
STEADY = 0.02
"""Share of a column's variance that rows of one step may hold for it to be a condition of the step."""
STRICT, STRICT_ALIKE = 0.08, 0.02
"""Share of these probabilities that is allowed where a condition alone tells of a mismatch; likeness has no law."""
FEWEST_GROUPS = 8
PERMUTATIONS = 2000
STRICT_PERMUTATIONS = 20_000
HELD_BACK = 3.0
"""Scatters to which a group is held back before neighbours are compared."""
LEAST_FORETOLD = 0.8
"""Share of the squares left by groups that the others foretell, to which a line or its bend must bring them."""
SECOND = 0.5
"""Weight of the next but one neighbour."""


@dataclass(frozen=True, slots=True)
class _Shared:
    """What groups share: whitened mean beside the units' constants, its weight, and conditions at each group.

    `spans`: mean and standard deviation of each condition.
    """

    mean: FloatArray
    left: FloatArray
    root: FloatArray
    constants: list[FloatArray]
    conditions: dict[str, FloatArray]
    spans: dict[str, tuple[float, float]]


def condition_of(problem: Problem, data: ChannelData, group: str, state: State, *, strict: bool = False) -> str:
    """Temperature, time, ramp or supply that what groups of rows share follows; empty for none.

    Args:
        problem: the table; data: the channel; state: corrected simulation.
        group: `step`, `frame` or `angle`.
        strict: where nothing else tells of a mismatch.
    """
    shared = _shared_of(problem, data, group, state)
    driven = _parabola(shared, data.units, (STRICT if strict else 1.0) * DRIVEN_P)
    likely = _neighbours(shared, ALIKE_P, PERMUTATIONS) if not driven else ""
    if strict and likely:
        likely = _neighbours(shared, STRICT_ALIKE * ALIKE_P, STRICT_PERMUTATIONS)
    return driven or likely


def followed_law(problem: Problem, data: ChannelData, group: str, state: State, name: str) -> list[LawTerm]:
    """Line or parabola in a condition that groups follow, if groups left out are foretold by it; else no term.

    Args:
        problem, data, group, state: as of `condition_of`.
        name: the condition.
    """
    shared = _shared_of(problem, data, group, state)
    if name not in shared.conditions:
        return []
    x, (middle, width) = shared.conditions[name], shared.spans[name]
    least, chosen = LEAST_FORETOLD * _left_out(shared, []), list[FloatArray]()
    for columns in ([x], [x, x**2]):
        left = _left_out(shared, columns)
        if left < least:
            least, chosen = LEAST_FORETOLD * left, columns
    if not chosen:
        return []
    design = np.stack([*shared.constants, *chosen], axis=1) * shared.root[:, None]
    values = np.linalg.lstsq(design, shared.mean, rcond=None)[0]
    rest = shared.mean - design @ values
    spread = float(rest @ rest) / max(len(rest) - design.shape[1], 1)
    errors = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)) * spread)
    return [
        LawTerm(
            axes=(Axis(column=name, kind=kind, middle=middle, width=width),), value=float(value), error=float(error)
        )
        for kind, value, error in zip(
            ("linear", "square"), values[-len(chosen) :], errors[-len(chosen) :], strict=False
        )
    ]


def _left_out(shared: _Shared, columns: list[FloatArray]) -> float:
    """Sum of squares of groups that the others foretell."""
    design = np.stack([*shared.constants, *columns], axis=1) * shared.root[:, None]
    hat = design @ np.linalg.pinv(design)
    left = shared.mean - hat @ shared.mean
    return float(np.sum((left / np.maximum(1.0 - np.diag(hat), 1e-6)) ** 2))


def _shared_of(problem: Problem, data: ChannelData, group: str, state: State) -> _Shared:
    level = next(lv for lv in data.levels if lv.name == group)
    weight = data.root_weight**2 * data.scale
    bottom = np.bincount(level.code, weight * data.scale, minlength=level.count)
    mean = np.bincount(level.code, weight * data.residual(state), minlength=level.count) / np.maximum(bottom, 1e-300)
    conditions, spans = _conditions(problem.view, data, level)
    unit = np.zeros(level.count, dtype=np.int64)
    unit[level.code] = data.unit
    constants = [(unit == k).astype(np.float64) for k in range(data.units)]
    root = np.sqrt(np.minimum(bottom, np.median(bottom)))
    target = mean * root
    base = np.stack(constants, axis=1) * root[:, None]
    left = target - base @ np.linalg.lstsq(base, target, rcond=None)[0]
    return _Shared(target, left, root, constants, conditions, spans)


def _conditions(
    view: View, data: ChannelData, level: Level
) -> tuple[dict[str, FloatArray], dict[str, tuple[float, float]]]:
    """Standardised conditions at each group, and their means and standard deviations.

    What the bench records, and whatever else is steady within a step.
    """
    recorded = [*view.temperatures()[:2], "time_s", "ramp", "cycle"]
    recorded += [n for n in view.covariates() if unit_of(n) in {"V", "A"}]
    others = [n for n in view.covariates() if n not in NO_CONDITIONS and unit_of(n) != "°C"]
    # images and angles of one step share its conditions
    names = [*recorded, *others] if level.name == "step" else ["stage_angle_deg"]
    size = np.maximum(np.bincount(level.code, minlength=level.count), 1)
    found, spans = {}, {}
    for name in dict.fromkeys(names):
        if not view.varies(name) or name == data.channel.name:
            continue
        rows = np.nan_to_num(view.number(name)[data.use])
        x = np.bincount(level.code, rows, minlength=level.count) / size
        steady = name in recorded or float(np.mean((rows - x[level.code]) ** 2)) < STEADY * float(np.var(rows))
        if (steady or level.name != "step") and x.std() > 0:
            spans[name] = float(x.mean()), float(x.std())
            found[name] = (x - x.mean()) / x.std()
    return found, spans


def _parabola(shared: _Shared, units: int, least: float) -> str:
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
    return best if p_value * len(shared.conditions) < least else ""


def _neighbours(shared: _Shared, least: float, draws: int) -> str:
    orders = {n: np.argsort(x, kind="stable") for n, x in shared.conditions.items() if len(np.unique(x)) > 4}
    if len(shared.left) < FEWEST_GROUPS or not orders:
        return ""
    spread = 1.4826 * float(np.median(np.abs(shared.left)))
    held = np.clip(shared.left, -HELD_BACK * spread, HELD_BACK * spread)
    rng = np.random.default_rng(len(held))
    mixed = np.stack([held, *(rng.permutation(held) for _ in range(draws))])
    scores = np.stack([_likeness(mixed[:, order]) for order in orders.values()])
    scores = (scores - scores.mean(axis=1, keepdims=True)) / np.maximum(scores.std(axis=1, keepdims=True), 1e-300)
    largest = scores.max(axis=0)
    p_value = float(np.mean(largest[1:] >= largest[0]))
    return list(orders)[int(np.argmax(scores[:, 0]))] if p_value < least else ""


def _likeness(x: FloatArray) -> FloatArray:
    """Sum of products of neighbours, the next but one counting half; x is (draws, groups)."""
    near = np.sum(x[:, :-1] * x[:, 1:], axis=1)
    return np.asarray(near + SECOND * np.sum(x[:, :-2] * x[:, 2:], axis=1))
