"""A detector that multiplies its carriers: how its gain stands over the bias, and how near breakdown that is."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effect import Parameter
from arl_fixtures.reconcile.effects_common import FloatArray, shape
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_SWEPT = 0.1
"""Share of the highest bias by which a bias must vary to tell of a breakdown."""
_NEAREST = 0.995
"""Share of the breakdown up to which Miller's law is followed."""


def bias_column(view: View) -> str:
    """The detector's bias, where the table holds one that is swept; else empty."""
    for name in view.voltages():
        low, high = view.span(name)
        if "bias" in name and low > 0.0 and high - low > _SWEPT * high:
            return name
    return ""


def light_column(view: View) -> str:
    """The logged light that falls on the detector, where it varies; else empty.

    What a simulated signal is of it tells by how much the simulation multiplies, whatever its law.
    """
    for name in view.covariates():
        if unit_of(name) in _LIGHT_UNITS and any(word in name for word in ("optical", "incident", "light")):
            low, high = view.span(name)
            if low > 0.0 and high > low:
                return name
    return ""


_LIGHT_UNITS = {"W", "mW", "µW", "nW", "pW"}


def breakdown(view: View, bias: str) -> Parameter:
    """The voltage at which the gain diverges, beyond the highest bias."""
    top = view.span(bias)[1]
    return shape("breakdown", unit_of(bias), 1.01 * top, 4.0 * top, 1.15 * top, 1.5 * top)


def multiplication(bias: FloatArray, at: FloatArray | float, order: float) -> FloatArray:
    """Gain 1 / (1 − (V/V_b)^n) (Miller)."""
    near = np.clip(np.nan_to_num(bias) / np.maximum(at, 1e-9), 0.0, _NEAREST)
    return np.asarray(1.0 / (1.0 - near**order))
