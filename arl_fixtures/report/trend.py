"""Whether a metric drifts with the number of cycles, by which law, and when it will stand at its limit.

Two laws of degradation are tried on the values y at the cycle counts n: y = a + b n, and y = a + b n^p with p between
0.3 and 3 (power laws of n describe fatigue and diffusion; N. R. Draper and H. Smith, Applied Regression Analysis, 3rd
ed., 1998, ch. 1, 24). There is a trend where Student's t of the straight line's slope says so; the power law replaces
the line where its AICc (C. M. Hurvich and C.-L. Tsai, Biometrika 76 (1989) 297-307) is lower by at least 2.

Values scatter about the law with one variance, estimated from the residuals, but never below the repeatability that
they state themselves. The interval of the cycle at which a measured value stands at the limit is the inverse of the
prediction interval (calibration: Draper and Smith, ch. 3.2): all n at which a new value could lie on the limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq, minimize_scalar
from scipy.special import stdtr, stdtrit

Float64Array = npt.NDArray[np.float64]

FEWEST_CYCLES: Final = 4
FEWEST_FOR_POWER: Final = 7
EXPONENTS: Final = (0.3, 3.0)
LOWER_AICC: Final = 2.0
HORIZON: Final = 1e6
"""Cycles beyond which nothing is foretold."""


class Law(StrEnum):
    """How a value depends on the cycle count."""

    LINEAR = "linear"
    POWER = "power law"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A law fitted to values.

    Attributes:
        law: which.
        exponent: p; 1 for the straight line.
        intercept: a, in the values' unit.
        slope: b, per cycle^p.
        sigma: scatter of a value about the law.
        dof: degrees of freedom of `sigma`.
        p: probability of a slope at least as steep by chance, two-sided; of the straight line for either law.
        gram_inverse: (k, k) inverse of JᵀJ, k = 2 or 3 parameters.
    """

    law: Law
    exponent: float
    intercept: float
    slope: float
    sigma: float
    dof: int
    p: float
    gram_inverse: Float64Array

    def value(self, n: float) -> float:
        """Expected value at a cycle count."""
        return self.intercept + self.slope * math.pow(n, self.exponent)

    def prediction_half_width(self, n: float, coverage: float = 0.95) -> float:
        """Half width of the interval in which a single new value at cycle n lies with `coverage`."""
        gradient = _gradient(n, self.slope, self.exponent, len(self.gram_inverse))
        spread = 1.0 + float(gradient @ self.gram_inverse @ gradient)
        return float(stdtrit(self.dof, 0.5 * (1.0 + coverage))) * self.sigma * math.sqrt(spread)


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """When a limit is reached, as cycle counts.

    Attributes:
        expected: where the law meets the limit; infinity when it does not.
        earliest: lower end of the interval.
        latest: upper end; infinity when the values do not exclude that it is never reached.
    """

    expected: float
    earliest: float
    latest: float


def fit_trend(cycles: npt.ArrayLike, values: npt.ArrayLike, repeatability: float = 0.0) -> Fit | None:
    """Fit the better of both laws.

    Args:
        cycles: (m,) cycle counts, from 0.
        values: (m,) values.
        repeatability: standard uncertainty of a single value from repeatability, which the scatter cannot undercut.

    Returns:
        None for fewer than 4 values, or all at one cycle count.
    """
    n, y = np.asarray(cycles, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if n.size < FEWEST_CYCLES or np.ptp(n) == 0.0:
        return None
    line, line_rss = _fit(n, y, 1.0, Law.LINEAR, repeatability)
    if n.size < FEWEST_FOR_POWER:
        return line

    def rss_of(exponent: float) -> float:
        return _fit(n, y, exponent, Law.POWER, repeatability)[1]

    best = float(minimize_scalar(rss_of, bounds=EXPONENTS, method="bounded", options={"xatol": 1e-4}).x)
    power, power_rss = _fit(n, y, best, Law.POWER, repeatability)
    floor = n.size * repeatability**2 + 1e-300
    gain = _aicc(line_rss, floor, n.size, 3) - _aicc(power_rss, floor, n.size, 4)
    return replace(power, p=line.p) if gain >= LOWER_AICC else line


def _aicc(rss: float, floor: float, count: int, parameters: int) -> float:
    """Corrected Akaike criterion; residuals below what repeatability explains are no better fit."""
    penalty = 2.0 * parameters * count / (count - parameters - 1)
    return count * math.log(max(rss, floor) / count) + penalty


def _fit(n: Float64Array, y: Float64Array, exponent: float, law: Law, repeatability: float) -> tuple[Fit, float]:
    """Least squares at a given exponent, and the sum of squared residuals."""
    # scaled so that n³ of thousands of cycles stays well conditioned
    scale = float(np.abs(n).max())
    design = np.stack([np.ones_like(n), (n / scale) ** exponent], axis=1)
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    residual = y - design @ solution
    rss = float(residual @ residual)
    intercept, slope = float(solution[0]), float(solution[1]) / scale**exponent
    count = 3 if law is Law.POWER else 2
    dof = n.size - count
    sigma = math.sqrt(max(rss / dof, repeatability**2))
    jacobian = np.stack([_gradient(float(each), slope, exponent, count) for each in n])
    largest = np.abs(jacobian).max(axis=0)
    # without a slope the exponent moves nothing, and is left out
    weight = np.divide(1.0, largest, out=np.zeros_like(largest), where=largest > 0.0)
    gram = np.linalg.pinv((jacobian * weight).T @ (jacobian * weight)) * np.outer(weight, weight)
    slope_u = sigma * math.sqrt(float(gram[1, 1]))
    t = abs(slope) / slope_u if slope_u > 0.0 else (math.inf if slope else 0.0)
    fit = Fit(
        law=law,
        exponent=exponent,
        intercept=intercept,
        slope=slope,
        sigma=sigma,
        dof=dof,
        p=2.0 * float(stdtr(dof, -t)),
        gram_inverse=gram,
    )
    return fit, rss


def _gradient(n: float, slope: float, exponent: float, count: int) -> Float64Array:
    """Of the law to its parameters a, b and, where it is fitted, p."""
    if count == 2:
        return np.array([1.0, n**exponent])
    return np.array([1.0, n**exponent, slope * n**exponent * math.log(n) if n > 0.0 else 0.0])


def crossing(fit: Fit, limit: float, start: float, coverage: float = 0.95) -> Crossing:
    """When a measured value stands at a limit, counted from cycle 0 and not before `start`.

    Args:
        fit: the law.
        limit: in the values' unit.
        start: the newest cycle: what lies before is known.
        coverage: of the interval.
    """
    sign = 1.0 if fit.slope > 0.0 else -1.0

    def beyond(offset: float) -> Callable[[float], float]:
        return lambda n: sign * (fit.value(n) - limit) + offset * fit.prediction_half_width(n, coverage)

    return Crossing(
        expected=_first_root(beyond(0.0), start),
        earliest=_first_root(beyond(1.0), start),
        latest=_first_root(beyond(-1.0), start),
    )


def _first_root(distance: Callable[[float], float], start: float) -> float:
    """Where a distance first becomes positive, from `start` on; infinity where it does not."""
    low, step = start, 1.0
    if distance(low) >= 0.0:
        return low
    while low < HORIZON:
        high = low + step
        if distance(high) >= 0.0:
            return float(brentq(distance, low, high, xtol=1e-6))
        low, step = high, 1.3 * step
    return math.inf
