"""Whether units differ by a condition that each has once: a torque, an age, a supplier's batch number.

A unit's own gain or offset is free, as its user may have calibrated it. What is steady within a unit but differs
between many of them is then told by these constants alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Axis, Law, LawTerm
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role

FEWEST_UNITS = 8
STEADY = 0.02
"""Share of a column's variance that rows of one unit may hold for it to be a condition of the unit."""
UNITS_P = 0.005
"""Below this probability, over all conditions and both shapes, units follow one by no chance."""


def law_of_units(problem: Problem, data: ChannelData, state: State) -> Law | None:
    """A line or parabola in a condition that the units' constants follow; None where they follow none.

    Args:
        problem: the table; data: the channel, its units' constants free; state: corrected simulation.
    """
    if data.units < FEWEST_UNITS or not data.calibrated or data.channel.role is Role.SCATTER:
        return None
    constants, errors = data.constants(data.residual(state)), data.constant_errors
    known = np.isfinite(errors) & np.isfinite(constants)
    if known.sum() < FEWEST_UNITS:
        return None
    constants, errors = constants[known], errors[known]
    spread = max(float(np.var(constants)) - float(np.mean(errors**2)), 0.0)
    root = 1.0 / np.sqrt(errors**2 + spread)
    tried = []
    for name, (x, middle, width) in _conditions(problem, data, known).items():
        for kinds in (("linear",), ("linear", "square")):
            columns = [np.ones_like(x), *(x if kind == "linear" else x**2 for kind in kinds)]
            if len(np.unique(x)) <= len(kinds):
                continue
            tried.append((_chance(constants, root, columns), name, kinds, columns, middle, width))
    if not tried:
        return None
    p_value, name, kinds, columns, middle, width = min(tried, key=lambda one: one[0])
    if p_value * len(tried) > UNITS_P:
        return None
    values, deviations, gain = _fit(constants, root, columns)
    terms = [
        LawTerm(axes=(Axis(column=name, kind=kind, middle=middle, width=width),), value=float(v), error=float(e))
        for kind, v, e in zip(kinds, values[1:], deviations[1:], strict=True)
    ]
    relative = data.channel.role is Role.INTENSITY
    return Law(channel=data.channel.name, relative=relative, terms=terms, drivers=[name], gain=gain)


def _conditions(
    problem: Problem, data: ChannelData, known: NDArray[np.bool_]
) -> dict[str, tuple[FloatArray, float, float]]:
    """Each unit's standardised value of what is steady in it, with the mean and standard deviation over units."""
    view, found = problem.view, {}
    size = np.maximum(np.bincount(data.unit, minlength=data.units), 1)
    for name in dict.fromkeys([*view.temperatures(), *view.covariates()]):
        if not view.varies(name) or name == data.channel.name:
            continue
        rows = np.nan_to_num(view.number(name)[data.use])
        x = np.bincount(data.unit, rows, minlength=data.units) / size
        if float(np.mean((rows - x[data.unit]) ** 2)) >= STEADY * float(np.var(rows)):
            continue
        x = x[known]
        if x.std() > 0.0:
            found[name] = (x - x.mean()) / x.std(), float(x.mean()), float(x.std())
    return found


def _fit(target: FloatArray, root: FloatArray, columns: list[FloatArray]) -> tuple[FloatArray, FloatArray, float]:
    """Coefficients, their standard errors and the gain in log-likelihood over the first column alone."""
    design, goal = np.stack(columns, axis=1) * root[:, None], target * root
    values = np.linalg.lstsq(design, goal, rcond=None)[0]
    left, rest = goal - design @ values, len(goal) - design.shape[1]
    variance = float(left @ left) / max(rest, 1)
    errors = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)) * variance)
    alone = goal - root * float(root @ goal) / float(root @ root)
    gain = 0.5 * len(goal) * float(np.log(float(alone @ alone) / max(float(left @ left), 1e-300)))
    return np.asarray(values, dtype=np.float64), np.asarray(errors, dtype=np.float64), gain


def _chance(target: FloatArray, root: FloatArray, columns: list[FloatArray]) -> float:
    """Probability of the F ratio of the columns beyond the first."""
    gain = _fit(target, root, columns)[2]
    more, rest = len(columns) - 1, len(target) - len(columns)
    if rest < 2:
        return 1.0
    ratio = (np.exp(2.0 * gain / len(target)) - 1.0) * rest / more
    return float(stats.f.sf(ratio, more, rest))
