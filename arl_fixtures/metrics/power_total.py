"""Total optical power from several targets: every direction counts once, every target's level the same.

The targets' levels are compared over the pixels S that saw all of them; the total is their mean level M times the sum
of the map's shape, T = M Σ_p Σ_t f_t(p) P_t(p)/L_t, with L_t the mean of P_t over S and f_t(p) the weight that target
t has at pixel p. Where all pixels saw all targets in the same proportion the shape's sum is a constant and T has the
uncertainty of the mean of the levels. That is more than the merged map's pixels would have if they were independent,
because a level's error is common to all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.reference import NotMeasurableError

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TotalPower:
    """Sum of the map over its pixels.

    Attributes:
        value: the sum.
        relative_u: its relative standard uncertainty from repeatability.
        sensitivities: (targets, H·W) of its relative error to the relative error of each pixel on each target.
    """

    value: float
    relative_u: float
    sensitivities: Float64Array


def total_power(power: Float64Array, variance: Float64Array, weight: Float64Array) -> TotalPower:
    """Total of the map that several targets give together.

    Args:
        power: (targets, H, W), NaN where a pixel did not see the target.
        variance: of `power`, from repeatability.
        weight: of each target at each pixel.

    Raises:
        NotMeasurableError: no pixel saw all targets.
    """
    seen = np.isfinite(power)
    shared = seen.all(axis=0)
    count = int(shared.sum())
    if not count:
        raise NotMeasurableError("no pixel saw all reflectance targets")
    known = np.where(seen, power, 0.0)
    used = np.where(seen, weight, 0.0)
    level = known[:, shared].mean(axis=1)
    share = used / np.where(seen.any(axis=0), used.sum(axis=0), 1.0)
    shape = (share * known).sum(axis=(1, 2)) / level
    mean, whole = float(level.mean()), float(shape.sum())
    # by P_t(p): through the mean level, through the shape's own value, through the level that the shape is divided by
    by_power = mean * share / level[:, None, None]
    by_power[:, shared] += (whole / (count * len(power)) - mean * shape / (count * level))[:, None]
    total = mean * whole
    return TotalPower(
        value=total,
        relative_u=math.sqrt(float((by_power**2 * np.where(seen, variance, 0.0)).sum())) / total,
        sensitivities=(by_power * known / total).reshape(len(power), -1),
    )
