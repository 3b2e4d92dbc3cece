"""The multiplication of an avalanche detector, read from the simulation's own signals at several bias voltages.

Miller's law, M = 1 / (1 − (V / V_b)^n): the signal at a bias over that at another tells V_b and n. What moves the
breakdown voltage moves the gain the more the nearer the bias is to it, and what is generated in the detector before
the multiplication (a dark current) is multiplied, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from arl_fixtures.reconcile.effect import Variant
from arl_fixtures.reconcile.effects_common import is_of, per_table
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]

_FEWEST_LEVELS, _MOST_LEVELS = 3, 64
_MISFIT = 0.02
"""Largest error of the law's logarithm over the bias levels."""
_LEAST_GAIN = 0.1
"""Change of the gain's logarithm over the bias levels below which there is no multiplication to speak of."""
_NEAREST = 0.999
"""Share of the breakdown voltage up to which the law is used: beyond it there is no gain but a discharge."""


@dataclass(frozen=True, slots=True)
class Multiplication:
    """Miller's law of a table's simulation: the bias column, breakdown voltage in volts and exponent."""

    column: str
    breakdown_v: float
    exponent: float

    def gain(self, share: FloatArray | float) -> FloatArray:
        """Gain at a share of the breakdown voltage."""
        return np.asarray(1.0 / (1.0 - np.clip(share, 0.0, _NEAREST) ** self.exponent))


def of_options(variant: Variant) -> Multiplication:
    """The law that a variant's options hold: what was read from one table predicts others."""
    options = variant.options
    return Multiplication(str(options["bias"]), float(options["breakdown"]), float(options["exponent"]))


def multiplication(view: View, channel: str) -> Multiplication | None:
    """How the simulation multiplies a signal; None where no bias varies or its signals do not follow Miller's law."""
    return per_table(view, ("multiplication", channel), lambda: _find(view, channel))


def _find(view: View, channel: str) -> Multiplication | None:
    for column in view.covariates():
        if is_of(column, "bias") and unit_of(column) == "V" and view.varies(column):
            found = _fitted(view, channel, column)
            if found is not None:
                return found
    return None


def _fitted(view: View, channel: str, column: str) -> Multiplication | None:
    bias, signal = view.columns.numbers[column], view.columns.numbers[f"sim_{channel}"]
    good = np.isfinite(bias) & (bias > 0.0) & np.isfinite(signal) & (signal > 0.0)
    levels, code = np.unique(bias[good], return_inverse=True)
    if not _FEWEST_LEVELS <= levels.size <= _MOST_LEVELS:
        return None
    # medians of the same experiment at every bias: its signals differ by the gain
    seen = np.array([np.median(np.log(signal[good][code == k])) for k in range(levels.size)])
    top = float(levels[-1])

    def off(x: FloatArray) -> FloatArray:
        law = -np.log1p(-((levels / (top * (1.0 + np.exp(x[0])))) ** np.exp(x[1])))
        return np.asarray(law - np.mean(law) - (seen - np.mean(seen)))

    starts = [(np.log(over), np.log(n)) for over in (0.02, 0.1, 0.4) for n in (1.0, 3.0)]
    best = min((least_squares(off, start) for start in starts), key=lambda found: float(found.cost))
    if float(np.max(np.abs(best.fun))) > _MISFIT or float(np.ptp(seen)) < _LEAST_GAIN:
        return None
    return Multiplication(column, top * (1.0 + float(np.exp(best.x[0]))), float(np.exp(best.x[1])))
