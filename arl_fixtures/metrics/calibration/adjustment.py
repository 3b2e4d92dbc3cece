"""Bundle adjustment: K and δ from circle centres, with mount, targets and stage angles as nearly known.

Linear about the assumed camera: deviations of the centres d = J θ + ε, with normal priors on everything that a
certificate or drawing knows (mount, target positions, each stage angle) and none on the intrinsics. The scatter of
the centres beyond repeatability (the coarse sampling of a four-pixel circle) is estimated from the residuals and
joins ε; single wild centres lose their weight (bisquare). The circles of one row of the targets pass the same places
of the image one after the other, at the same height in the pixel grid, so their residuals are alike there, whichever
circle, target and stage angle it is: the scatter of the places' own sums, not of single residuals, says what the
estimate is worth (cluster-robust covariance with a factor per image axis).

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
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import BenchUncertainty

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

ITERATIONS: Final = 4
TUKEY: Final = 6.0
"""Bisquare constant; wide, because the sampling's scatter is not normal."""
HALF_NORMAL_50: Final = 0.6745
HALF_NORMAL_90: Final = 1.6449
"""Quantiles of |x| for a standard normal x."""
FEWEST_CIRCLES: Final = 100
GROUPS: Final = ("mount", "target position", "stage angle")
PLACE_PX: Final = (8.0, 16.0)
"""Columns of one place, for errors in u and in v. Both depend on where a circle lies in the grid of the samples.
Along a row its position in u goes through the grid with every step of the stage, and what is left is alike over two
widths of a circle; its height stays nearly the same, so errors in v are alike over more of the row."""
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
        kernels: (2, p, p) covariance of the intrinsic parameters from the centres' u and from their v, were all
            residuals independent and as large as assumed.
        identity: (k,) which circle at which angle each used centre is.
        place: (k, 2) in which place of the image it was seen, from 0: for its u and for its v.
        free: (2,) share of the places' sums of squares in u and in v that the parameters leave free.
        residuals: (k, 2) in standard deviations as assumed.
        sigma_px: (k, 2) standard deviation assumed of each.
        by_group: the same from each group of `GROUPS`.
        dof: degrees of freedom of the repeatability.
        circles: centres used.
        residual_px: root mean square of the residuals, robust.
        moved_px: root mean square of what the estimated intrinsics and mount move the centres by.
    """

    names: tuple[str, ...]
    offsets: dict[str, float]
    kernels: Float64Array
    identity: Int64Array
    place: Int64Array
    free: tuple[float, float]
    residuals: Float64Array
    sigma_px: Float64Array
    by_group: dict[str, Float64Array]
    dof: float
    circles: int
    residual_px: float
    moved_px: float

    @property
    def repeatability(self) -> Float64Array:
        """Covariance of the intrinsic parameters from the circle centres."""
        return self.scaled(self.residuals, np.arange(len(self.place)))

    def scaled(self, residuals: Float64Array, used: Int64Array) -> Float64Array:
        """Covariance of the intrinsic parameters if the centres scatter as these residuals do.

        Args:
            residuals: (j, 2) in the standard deviations assumed here.
            used: (j,) which centres they belong to.
        """
        factors = [_cluster_factor(residuals[:, axis], self.place[used, axis]) / self.free[axis] for axis in (0, 1)]
        covariance: Float64Array = np.tensordot(factors, self.kernels, axes=1)
        return covariance


def adjust(
    field: CircleField, centres: Centres, uncertainty: BenchUncertainty, known: Mapping[str, float]
) -> Adjustment:
    """Estimate the intrinsics.

    Args:
        field: the circles, as the assumed camera and mount see them.
        centres: where they were found.
        uncertainty: of mount, targets and stage angles.
        known: offsets of mount parameters that `field` already contains, by name; the priors know nothing of them.

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
    inverse, theta, residual = np.empty((0, 0)), np.empty(0), deviation
    for _ in range(ITERATIONS):
        weight = trust / variance
        inverse = np.linalg.inv(equations.normal(weight) + np.diag(prior)).astype(np.float64)
        theta = inverse @ (equations.right_side(weight * deviation) - pull)
        residual = deviation - equations.predicted(theta)
        spread = _scale(residual) ** 2
        variance = noise + max(spread - float(np.median(noise)), 0.0)
        trust = np.clip(1.0 - residual**2 / (TUKEY**2 * variance), 0.0, None) ** 2

    count = len(free_intrinsics(field.dut.intrinsics))
    # weights of (1 − x²)² stand for evidence of a share of an observation: the sandwich has them squared
    squared = trust * trust / variance
    kernels = []
    for axis in (0, 1):
        of_axis = np.where(np.arange(squared.size) % 2 == axis, squared, 0.0)
        kernels.append((inverse @ equations.normal(of_axis) @ inverse.T)[:count, :count])
    by_group = {name: (inverse * np.where(group == k, prior, 0.0)) @ inverse.T for k, name in enumerate(GROUPS)}
    place = _places(field, used)
    whitened = np.sqrt(trust / variance)
    independent = [len(of_axis) ** 2 / np.square(np.bincount(of_axis), dtype=float).sum() for of_axis in place.T]
    moves = np.zeros_like(theta)
    camera = [k for k, name in enumerate(field.names) if "." not in name or name.startswith("mount.")]
    moves[camera] = theta[camera]
    return Adjustment(
        names=field.names[:count],
        offsets=dict(zip(field.names, theta[: len(field.names)].tolist(), strict=True)),
        kernels=np.stack(kernels),
        identity=field.identity[used],
        place=place,
        free=(
            equations.free_share(whitened, place[:, 0], inverse, 0),
            equations.free_share(whitened, place[:, 1], inverse, 1),
        ),
        residuals=(whitened * residual).reshape(-1, 2),
        sigma_px=np.sqrt(variance).reshape(-1, 2),
        by_group={name: part[:count, :count] for name, part in by_group.items()},
        dof=float(max(sum(independent) - len(field.names), 1.0)),
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

    def normal(self, weight: Float64Array) -> Float64Array:
        """JᵀWJ; each deviation depends on one stage angle only."""
        p = self.dense.shape[1]
        matrix = np.zeros((p + self.angles, p + self.angles))
        matrix[:p, :p] = self.dense.T @ (self.dense * weight[:, None])
        for k in range(p):
            matrix[k, p:] = self._by_angle(weight * self.stage * self.dense[:, k])
        matrix[p:, :p] = matrix[:p, p:].T
        diagonal = np.arange(p, p + self.angles)
        matrix[diagonal, diagonal] = self._by_angle(weight * self.stage**2)
        return matrix

    def right_side(self, weighted: Float64Array) -> Float64Array:
        """Jᵀ times weighted deviations."""
        return np.concatenate([self.dense.T @ weighted, self._by_angle(weighted * self.stage)])

    def predicted(self, theta: Float64Array) -> Float64Array:
        """J θ."""
        p = self.dense.shape[1]
        predicted: Float64Array = self.dense @ theta[:p] + self.stage * theta[p:][self.angle]
        return predicted

    def free_share(self, whitened: Float64Array, place: Int64Array, inverse: Float64Array, axis: int) -> float:
        """Expected sum of the squares of the places' sums of residuals, as a share of what it is without a fit.

        For residuals that are independent and of variance 1: tr(Z(I − H)Zᵀ)/n with the hat matrix H and Z the sums.

        Args:
            whitened: (2k,) factor that makes each residual's variance 1.
            place: (k,) place of each centre.
            inverse: covariance of the parameters.
            axis: 0 for u, 1 for v.
        """
        p = self.dense.shape[1]
        sums = np.zeros((int(place.max()) + 1, len(inverse)))
        weight = whitened[axis::2]
        np.add.at(sums[:, :p], place, self.dense[axis::2] * weight[:, None])
        np.add.at(sums, (place, p + self.angle[axis::2]), self.stage[axis::2] * weight)
        taken = float(((sums @ inverse) * sums).sum())
        return max(1.0 - taken / place.size, 1.0 / place.size)

    def _by_angle(self, values: Float64Array) -> Float64Array:
        return np.bincount(self.angle, weights=values, minlength=self.angles).astype(np.float64)


def _scale(residual: Float64Array) -> float:
    """Standard deviation by quantiles: wild centres do not count, but a tail of every tenth does.

    A sampled circle's centre stays where it is until one of the samples changes sides, and then jumps: most of the
    residuals can be next to nothing while the jumps of the others decide the estimate.
    """
    half, most = np.quantile(np.abs(residual), (0.5, 0.9))
    return float(max(half / HALF_NORMAL_50, most / HALF_NORMAL_90))


def _places(field: CircleField, used: BoolArray) -> Int64Array:
    """Places of each used centre in the image, (k, 2) from 0: row of the targets by `PLACE_PX` columns."""
    height_um = np.rint(1e6 * field.up_m[used]).astype(np.int64)
    u_px = field.pixels()[used, 0]
    places = []
    for width_px in PLACE_PX:
        column = np.floor(u_px / width_px).astype(np.int64)
        places.append(np.unique(height_um * (1 + int(column.max())) + column, return_inverse=True)[1])
    return np.stack(places, axis=1).astype(np.int64)


def _cluster_factor(residuals: Float64Array, place: Int64Array) -> float:
    """Variance of the places' sums of residuals, in what it would be with independent residuals of variance 1."""
    sums = np.bincount(place, weights=residuals)
    return float(sums @ sums) / len(residuals)


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
