"""Temporal scatter from few frames: pooled standard deviations and their uncertainty.

Variances are pooled, never standard deviations, and the quantisation's share is taken out (Sheppard's correction,
step²/12; valid from σ ≈ 0.4 steps on, its remainder exp(−2π²σ²/step²) enters as type B). The square root of a
variance estimate with ν degrees of freedom is low by c4(ν + 1): by 2.7 % for 10 frames of one pixel at one angle, by
nothing for the pooled value of a target.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln

from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.quantity import Contribution, Kind, Quantity

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]

FEWEST_RETURNS: Final = 3
SERIES_DOF: Final = 100.0


def c4(dof: npt.ArrayLike) -> Float64Array:
    """Expected value of s/σ for a sample standard deviation with `dof` degrees of freedom (normal values)."""
    nu = np.asarray(dof, dtype=np.float64)
    exact = np.sqrt(2.0 / nu) * np.exp(gammaln((nu + 1.0) / 2.0) - gammaln(nu / 2.0))
    # the logarithms' difference loses digits as ν grows; the series has them all by then
    series = 1.0 - 1.0 / (4.0 * nu) + 1.0 / (32.0 * nu**2) + 5.0 / (128.0 * nu**3)
    factor: Float64Array = np.where(nu < SERIES_DOF, exact, series)
    return factor


@dataclass(frozen=True, slots=True, kw_only=True)
class Pooled:
    """A pooled variance.

    Attributes:
        variance: mean over pixels and angles, quantisation taken out.
        dof: degrees of freedom of the pooled variance.
        u: standard uncertainty of `variance` from the finite number of frames.
        remainder: bound of what quantisation may still add to the standard deviation.
    """

    variance: float
    dof: float
    u: float
    remainder: float

    @property
    def sigma(self) -> float:
        """Standard deviation, with the small-sample factor."""
        return math.sqrt(max(self.variance, 0.0)) / float(c4(self.dof))

    def quantity(self, unit: str) -> Quantity:
        """The standard deviation as a quantity in the unit of the values."""
        sigma = self.sigma
        # where quantisation leaves nothing over, the square root's slope says nothing
        u = self.u / (2.0 * sigma) if self.variance > self.u else math.sqrt(self.u)
        return Quantity.of(
            sigma,
            unit,
            Contribution("repeatability", u, Kind.A, self.dof),
            Contribution("quantisation", self.remainder, Kind.B),
        )


def pool(variance: Float32Array, returns: UInt8Array, step_size: float) -> Pooled:
    """Pool the variances of many pixels and angles.

    Args:
        variance: sample variances (ddof 1), any shape; NaN where there were too few returns.
        returns: frames behind each, same shape.
        step_size: quantisation step of the values.

    Raises:
        NotMeasurableError: no pixel has enough returns.
    """
    usable = (returns >= FEWEST_RETURNS) & np.isfinite(variance)
    if not usable.any():
        raise NotMeasurableError(f"no pixel with at least {FEWEST_RETURNS} returns")
    nu = returns[usable].astype(np.float64) - 1.0
    s2 = variance[usable].astype(np.float64)
    dof = float(nu.sum())
    mean = float((nu * s2).sum() / dof)
    # Var(s²) = 2σ⁴/ν, and E[s⁴] = σ⁴ (ν + 2)/ν
    u = math.sqrt(2.0 * float((nu**2 * s2**2 / (nu + 2.0)).sum())) / dof
    clean = max(mean - step_size**2 / 12.0, 0.0)
    # where the scatter varies from pixel to pixel, fewer degrees of freedom carry the mean
    effective = max(2.0 * mean**2 / u**2, 1.0) if u > 0.0 else dof
    remainder = step_size * math.exp(-2.0 * math.pi**2 * mean / step_size**2) if step_size > 0.0 else 0.0
    return Pooled(variance=clean, dof=effective, u=u, remainder=remainder)
