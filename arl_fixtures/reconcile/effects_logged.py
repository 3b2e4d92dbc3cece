"""Logged operating data without their reading noise.

A supply is read once per row or image, with noise, while what it does to the signal follows its true value. A slope
on noisy readings comes out too small by var(true) / (var(true) + var(noise)) (Fuller, Measurement Error Models, 1987,
eq. 1.1.7), and what it leaves looks like scatter between steps. The mean over a step has next to no such noise.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import FloatArray, per_table
from arl_fixtures.reconcile.view import View

LEAST_NOISE = 1e-4
"""Share of a column's variance within steps below which a step's mean says nothing that the readings do not.

It is small because steps share errors: what readings do within steps weighs more than what they do between them.
"""


def step_mean(view: View, column: str) -> FloatArray:
    """Mean reading of each row's step (of its DUT and cycle), shape (rows of the view,); NaN where none was taken."""
    means = per_table(view, ("step mean", column), lambda: _means(view, column))
    return means[view.rows]


def is_noisy(view: View, column: str) -> bool:
    """Whether readings scatter within steps and a table has several of them in a step."""

    def look() -> bool:
        values = view.columns.numbers[column]
        if "step" not in view.columns.numbers and "set_temperature_c" not in view.columns.numbers:
            return False
        inside = values - _means(view, column)
        return bool(np.nanvar(inside) > LEAST_NOISE * np.nanvar(values) > 0.0 and np.nanvar(inside) > 0.0)

    return per_table(view, ("noisy", column), look)


def _means(view: View, column: str) -> FloatArray:
    values = view.columns.numbers[column]
    code = view.columns.group("dut", "cycle", "step", *(() if "step" in view.columns.numbers else _CONDITIONS))
    there = np.isfinite(values)
    count = np.bincount(code[there], minlength=int(code.max()) + 1)
    total = np.bincount(code[there], values[there], minlength=int(code.max()) + 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((total / count)[code], dtype=np.float64)


_CONDITIONS = ("set_temperature_c", "ramp")
