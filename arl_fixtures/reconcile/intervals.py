"""Intervals of fitted parameters that allow for errors shared by steps, angles or pixels."""

from __future__ import annotations

import numpy as np
from scipy import stats

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.fit import Fit, steady_jacobian
from arl_fixtures.reconcile.problem import Problem


def covariance_of(jacobian: FloatArray) -> FloatArray:
    """Inverse of the information, pseudo-inverse where a parameter has none."""
    gram = jacobian.T @ jacobian
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inverse = np.linalg.pinv(gram / np.outer(size, size), hermitian=True, rcond=1e-10)
    return np.asarray(inverse / np.outer(size, size), dtype=np.float64)


def half_widths(problem: Problem, found: Fit) -> FloatArray:
    """Half width of the 95 % interval of each free parameter.

    The widest of the model's own and the sandwich estimates over steps, angles and pixels, each with Student's law of
    its number of groups.
    """
    if not found.keys:
        return np.zeros(0)
    jacobian = steady_jacobian(problem, found)
    inverse = covariance_of(jacobian)
    steps = int(np.unique(problem.codes(problem.groups.step)).size)
    widest = np.sqrt(np.diag(inverse)) * float(stats.t.ppf(0.975, max(min(steps, 200) - 1, 3)))
    for code in (problem.groups.step, problem.groups.angle, problem.groups.pixel):
        if code is None:
            continue
        group = np.unique(problem.codes(code), return_inverse=True)[1]
        count = int(group.max()) + 1
        if count < 8:
            continue
        scores = np.stack([np.bincount(group, column * found.residual, minlength=count) for column in jacobian.T])
        spread = inverse @ (scores @ scores.T) @ inverse * count / (count - 1.0)
        width = np.sqrt(np.maximum(np.diag(spread), 0.0)) * float(stats.t.ppf(0.975, count - 1))
        widest = np.maximum(widest, np.minimum(width, 2.0 * widest))
    return np.asarray(widest)
