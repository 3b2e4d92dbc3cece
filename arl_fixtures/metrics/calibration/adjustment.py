"""Bundle adjustment: K and δ from circle centres, with mount, targets and stage angles as nearly known.

Linear about the assumed camera: deviations of the centres d = J θ + ε, with normal priors on everything that a
certificate or drawing knows (mount, target positions, each stage angle) and none on the intrinsics. The scatter of
the centres beyond repeatability (the coarse sampling of a four-pixel circle) is estimated from the residuals and
joins ε; single wild centres lose their weight (bisquare). What the estimate is worth is said by the places on the
sensor, not by single centres (`calibration.places`).

The estimate's error is H⁻¹(JᵀW ε − P η), H = JᵀWJ + P, with η the true deviations behind the priors P: that splits
its covariance into repeatability (type A) and one type B contribution for each group of priors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.calibration.camera import (
    MOUNT_ANGLES,
    MOUNT_POSITION,
    CircleField,
    free_intrinsics,
)
from arl_fixtures.metrics.calibration.circles import Centres
from arl_fixtures.metrics.calibration.normal import NormalMatrix
from arl_fixtures.metrics.calibration.places import PlaceInfluence, influence, places
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import BenchUncertainty

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

ITERATIONS: Final = 4
TUKEY: Final = 6.0
"""Bisquare constant; wide, because the sampling's scatter is not normal."""
JUMP_PX: Final = 0.02
"""What one ray more or less of 3 × 3 moves the centre of a circle by that is four pixels wide. That is not wild,
however still the others are: where twin and sensor nearly agree, such jumps are all that tells what is left."""
HALF_NORMAL_50: Final = 0.6745
HALF_NORMAL_90: Final = 1.6449
"""Quantiles of |x| for a standard normal x."""
FEWEST_CIRCLES: Final = 100
GROUPS: Final = ("mount", "target position", "stage angle")
LEAST_PX: Final = 1e-4
"""Floor of a centre's standard deviation: no centre is exact."""
LEAST_U: Final = 1e-9
"""Floor of a prior's standard uncertainty: a parameter given as exact stays where it is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Adjustment:
    """Estimated deviations from the assumed camera.

    Attributes:
        names: of the intrinsic parameters.
        offsets: estimated deviation of every parameter but the stage angles, by name.
        centres: what the centres contribute to the covariance of the intrinsic parameters, place by place.
        by_group: covariance of the intrinsic parameters from each group of `GROUPS`.
        circles: centres used.
        residual_px: root mean square of the residuals, robust.
        moved_px: root mean square of what the estimates move the centres by, the stage angles' left out.
    """

    names: tuple[str, ...]
    offsets: dict[str, float]
    centres: PlaceInfluence
    by_group: dict[str, Float64Array]
    circles: int
    residual_px: float
    moved_px: float


def adjust(
    field: CircleField, centres: Centres, uncertainty: BenchUncertainty, known: Mapping[str, float]
) -> Adjustment:
    """Estimate the intrinsics.

    Args:
        field: the circles, as the assumed camera and mount see them.
        centres: where they were found.
        uncertainty: of mount, targets and stage angles.
        known: offsets of mount and targets that `field` already contains, by name; the priors know nothing of them.

    Raises:
        NotMeasurableError: too few circles.
    """
    used = centres.usable
    if int(used.sum()) < FEWEST_CIRCLES:
        raise NotMeasurableError(
            f"{int(used.sum())} circles of the intrinsic targets seen; at least {FEWEST_CIRCLES}"
        )
    equations = _Equations.of(field, used)
    deviation = centres.deviation_px[used].ravel()
    noise = np.maximum(centres.variance_px2[used].ravel(), LEAST_PX**2)
    prior, group = _priors(field, uncertainty, equations.angles)
    pull = np.zeros_like(prior)
    pull[: len(field.names)] = prior[: len(field.names)] * [known.get(name, 0.0) for name in field.names]

    variance = noise
    trust = np.ones_like(deviation)
    theta, residual = np.empty(0), deviation
    for _ in range(ITERATIONS):
        weight = trust / variance
        normal = equations.normal(weight, prior)
        theta = normal.solve(equations.right_side(weight * deviation) - pull)
        residual = deviation - equations.predicted(theta)
        spread = _scale(residual) ** 2
        variance = noise + max(spread - float(np.median(noise)), 0.0)
        trust = np.clip(1.0 - residual**2 / (TUKEY**2 * np.maximum(variance, JUMP_PX**2)), 0.0, None) ** 2

    count = len(free_intrinsics(field.dut.intrinsics))
    covariance = normal.covariance()[:count]
    by_group = {name: (covariance * np.where(group == k, prior, 0.0)) @ covariance.T for k, name in enumerate(GROUPS)}
    whitened = np.sqrt(trust / variance)
    design, stage = equations.whitened(whitened)
    by_place = influence(
        places(field, used, known),
        design,
        stage,
        equations.angle[::2],
        normal,
        (whitened * residual).reshape(-1, 2),
        count,
    )
    moves = np.zeros_like(theta)
    moves[: len(field.names)] = theta[: len(field.names)]
    return Adjustment(
        names=field.names[:count],
        offsets=dict(zip(field.names, theta[: len(field.names)].tolist(), strict=True)),
        centres=by_place,
        by_group=by_group,
        circles=int(used.sum()),
        residual_px=float(np.sqrt(np.average(residual**2, weights=trust))),
        moved_px=float(np.sqrt(np.mean(equations.predicted(moves) ** 2))),
    )


@dataclass(frozen=True, slots=True)
class _Equations:
    """Linear equations of 2k deviations: dense parameters first, then one stage angle each.

    Attributes:
        dense: (2k, p) derivatives by the parameters.
        stage: (2k,) derivative by the own stage angle.
        angle: (2k,) number of that among the angles that occur.
        angles: how many occur.
    """

    dense: Float64Array
    stage: Float64Array
    angle: Int64Array
    angles: int

    @classmethod
    def of(cls, field: CircleField, used: BoolArray) -> _Equations:
        occurs = np.bincount(field.angle[used]) > 0
        number = (np.cumsum(occurs) - 1)[field.angle[used]]
        dense = field.jacobian[used].reshape(-1, len(field.names))
        return cls(dense, field.stage_jacobian[used].ravel(), np.repeat(number, 2), int(occurs.sum()))

    def normal(self, weight: Float64Array, prior: Float64Array) -> NormalMatrix:
        """JᵀWJ and the precisions (p + angles,) of the priors."""
        p = self.dense.shape[1]
        weighted = self.dense * weight[:, None]
        border = np.stack([self._by_angle(self.stage * column) for column in weighted.T])
        own = self._by_angle(weight * self.stage**2)
        return NormalMatrix(self.dense.T @ weighted + np.diag(prior[:p]), border, own + prior[p:])

    def right_side(self, weighted: Float64Array) -> Float64Array:
        """Jᵀ times weighted deviations."""
        return np.concatenate([self.dense.T @ weighted, self._by_angle(weighted * self.stage)])

    def predicted(self, theta: Float64Array) -> Float64Array:
        """J θ."""
        p = self.dense.shape[1]
        predicted: Float64Array = self.dense @ theta[:p] + self.stage * theta[p:][self.angle]
        return predicted

    def whitened(self, factor: Float64Array) -> tuple[tuple[Float64Array, Float64Array], Float64Array]:
        """Derivatives by the dense parameters of u and of v, (k, p) each, and by the stage angle, (k, 2), scaled."""
        dense = self.dense * factor[:, None]
        return (dense[::2], dense[1::2]), (self.stage * factor).reshape(-1, 2)

    def _by_angle(self, values: Float64Array) -> Float64Array:
        return np.bincount(self.angle, weights=values, minlength=self.angles).astype(np.float64)


def _scale(residual: Float64Array) -> float:
    """Standard deviation by quantiles: wild centres do not count, but a tail of every tenth does.

    A sampled circle's centre stays where it is until one of the samples changes sides, and then jumps: most of the
    residuals can be next to nothing while the jumps of the others decide the estimate.
    """
    half, most = np.quantile(np.abs(residual), (0.5, 0.9))
    return float(max(half / HALF_NORMAL_50, most / HALF_NORMAL_90))


def _priors(
    field: CircleField, uncertainty: BenchUncertainty, angles: int
) -> tuple[Float64Array, npt.NDArray[np.int64]]:
    """Precision of each parameter's prior, and the group it belongs to (−1 for none)."""
    precision, group = [], []
    for name in field.names:
        owner, _, axis = name.partition(".")
        if not axis:
            precision.append(0.0)
            group.append(-1)
            continue
        if owner == "mount":
            u = uncertainty.mount_angle_deg if axis in MOUNT_ANGLES else uncertainty.mount_position_m
        else:
            u = uncertainty.target_position_m
        precision.append(max(u, LEAST_U) ** -2)
        group.append(0 if owner == "mount" and axis in MOUNT_ANGLES + MOUNT_POSITION else 1)
    precision += [max(uncertainty.stage_angle_deg, LEAST_U) ** -2] * angles
    group += [2] * angles
    return np.array(precision), np.array(group, dtype=np.int64)
