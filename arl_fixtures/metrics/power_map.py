"""P_o(φ, θ): from the intensities on the reflectance targets to the relative optical output power of each direction.

On a Lambertian target a pixel reads I = G g P_o ρ cos θ (R₀/R)² + I_off. Each target gives every pixel its own
P = Σ (I − I_off) / (G Σ ρ cos θ (R₀/R)²) over the angles at which the pixel's whole field lay on it. The targets'
levels are compared over the pixels that saw all of them; the map is their mean in shape, so that a wrong reflectance
certificate makes no steps in it.

A gain that all pixels of a frame share (pulse energy jitter) is no pixel noise: it moves every pixel that saw a
target at that angle alike. Its share in any result is found from the sightings themselves (`Sharing`).

The paper neglects the growth of the ray's range (and incidence) with elevation; `Correction.PAPER` keeps that way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.scatter import FEWEST_RETURNS
from arl_fixtures.metrics.step import StepData
from arl_fixtures.metrics.targets import sightings_of

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

HALVES: Final = 2


class Correction(StrEnum):
    """How the path to the target is taken into account."""

    TRUE_RANGE = "true_range"
    PAPER = "paper"


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetMap:
    """Power seen on one target: (2, H, W) for angles of even and odd number, NaN where it was not seen.

    Attributes:
        target: its name.
        power: sum of intensities over sum of weights, relative to full scale.
        weight: sum of weights.
        variance: variance of `power` from repeatability.
        pixel: (m,) flat pixel of each sighting.
        angle: (m,) index of the stage angle of each sighting.
        counts: (m,) intensity of each sighting.
    """

    target: str
    power: Float64Array
    weight: Float64Array
    variance: Float64Array
    pixel: Int64Array
    angle: Int64Array
    counts: Float64Array

    @property
    def whole(self) -> tuple[Float64Array, Float64Array]:
        """Power and its variance from all angles, (H, W)."""
        return _merged(self.power, self.variance, self.weight)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sharing:
    """Which pixels share the frames of which stage angle, m sightings.

    Attributes:
        target: (m,) number of the target, in the order of `PowerMap.level`.
        pixel: (m,) flat pixel.
        angle: (m,) index of the stage angle.
        counts: (m,) intensity, the sighting's share in its pixel's power.
        size: pixels of the image.
        gain_variance: variance of the relative gain that all pixels share at one angle, mean of its frames.
    """

    target: Int64Array
    pixel: Int64Array
    angle: Int64Array
    counts: Float64Array
    size: int
    gain_variance: float

    def covariance(self, sensitivities: Float64Array, half: int | None = None) -> Float64Array:
        """Covariance of results that the angles' gains cause, for a gain variance of 1.

        Args:
            sensitivities: (r, H·W) of each result to the relative error of each pixel's power.
            half: only angles of even (0) or odd (1) number, as in `PowerMap.halves`.

        Returns:
            (r, r).
        """
        kept = slice(None) if half is None else np.flatnonzero(self.angle % HALVES == half)
        pixel, angle, counts = self.pixel[kept], self.angle[kept], self.counts[kept]
        total = np.bincount(pixel, weights=counts, minlength=self.size)
        share = counts / total[pixel]
        by_angle = np.stack([np.bincount(angle, weights=row[pixel] * share) for row in sensitivities]).astype(
            np.float64
        )
        covariance: Float64Array = by_angle @ by_angle.T
        return covariance

    def variance(self, sensitivities: Float64Array) -> float:
        """Variance of one result that the angles' gains cause, for a gain variance of 1.

        Args:
            sensitivities: (targets, H·W) to the relative error of each pixel's power on each target alone.
        """
        cell = self.target * self.size + self.pixel
        total = np.bincount(cell, weights=self.counts, minlength=sensitivities.size)
        by_angle = np.bincount(self.angle, weights=sensitivities.ravel()[cell] * self.counts / total[cell])
        return float(by_angle @ by_angle)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerMap:
    """P_o of one DUT in one step, gain included: its mean is the total power.

    Attributes:
        power: (H, W) P_o, NaN where nothing was seen.
        variance: (H, W) from repeatability.
        halves: (2, H, W) the same from angles of even and of odd number: two independent maps.
        halves_variance: (2, H, W).
        level: target name to relative deviation of its level from the mean of the targets.
        level_u: target name to the repeatability of that.
        sharing: what the frames' common gain does to the map.
    """

    power: Float64Array
    variance: Float64Array
    halves: Float64Array
    halves_variance: Float64Array
    level: dict[str, float]
    level_u: dict[str, float]
    sharing: Sharing

    @property
    def relative(self) -> Float64Array:
        """(H, W) P_o relative to the map's mean."""
        relative: Float64Array = self.power / np.nanmean(self.power)
        return relative


def power_map(step: StepData) -> PowerMap:
    """Power map with the true ray range.

    Raises:
        NotMeasurableError: the intensity was not recorded, or no target was seen.
    """
    return combined_map(step, Correction.TRUE_RANGE)


def combined_map(step: StepData, correction: Correction) -> PowerMap:
    """Power map from all reflectance targets that can be used.

    Raises:
        NotMeasurableError: the intensity was not recorded, or no target was seen.
    """
    maps, reasons = [], []
    for target in step.geometry.stripes:
        try:
            maps.append(target_map(step, target, correction))
        except NotMeasurableError as reason:
            reasons.append(str(reason))
    if not maps:
        raise NotMeasurableError(reasons[0] if reasons else "the scene has no reflectance target")
    whole = [single.whole for single in maps]
    shared = np.isfinite(np.stack([power for power, _ in whole])).all(axis=0)
    if not shared.any():
        raise NotMeasurableError(f"no pixel saw all reflectance targets{step.shortfall}")
    count = int(shared.sum())
    levels = np.array([power[shared].mean() for power, _ in whole])
    level_u = np.array([math.sqrt(variance[shared].sum()) / count for _, variance in whole]) / levels
    mean_level = float(levels.mean())
    shape = levels / mean_level
    stacked = np.stack([single.power / scale for single, scale in zip(maps, shape, strict=True)])
    weight = np.stack([single.weight for single in maps])
    variance = np.stack([single.variance / scale**2 for single, scale in zip(maps, shape, strict=True)])
    halves = [_merged(stacked[:, half], variance[:, half], weight[:, half]) for half in range(HALVES)]
    flat = (-1, *stacked.shape[2:])
    power, power_variance = _merged(stacked.reshape(flat), variance.reshape(flat), weight.reshape(flat))
    return PowerMap(
        power=power,
        variance=power_variance,
        halves=np.stack([half[0] for half in halves]),
        halves_variance=np.stack([half[1] for half in halves]),
        level={single.target: float(scale - 1.0) for single, scale in zip(maps, shape, strict=True)},
        level_u={single.target: float(u) for single, u in zip(maps, level_u, strict=True)},
        sharing=Sharing(
            target=np.repeat(np.arange(len(maps)), [single.pixel.size for single in maps]),
            pixel=np.concatenate([single.pixel for single in maps]),
            angle=np.concatenate([single.angle for single in maps]),
            counts=np.concatenate([single.counts for single in maps]),
            size=power.size,
            gain_variance=_gain_variance(step),
        ),
    )


def target_map(step: StepData, target: str, correction: Correction = Correction.TRUE_RANGE) -> TargetMap:
    """Power seen on one target.

    Raises:
        NotMeasurableError: the intensity was not recorded, or the target was not seen.
    """
    sweep, geometry, dut = step.require("intensity"), step.geometry, step.dut
    sightings = sightings_of(step, target)
    returns = sweep.intensity_returns.ravel()[sightings.index]
    usable = returns >= FEWEST_RETURNS
    index, pixel = sightings.index[usable], sightings.pixel[usable]
    if not index.size:
        raise NotMeasurableError(f"nowhere {FEWEST_RETURNS} intensities from {target} at one angle{step.shortfall}")
    counts = sweep.intensity_counts.ravel()[index].astype(np.float64) - dut.offset_counts
    variance = sweep.intensity_variance.ravel()[index].astype(np.float64) / returns[usable]
    if correction is Correction.PAPER:
        weight = geometry.reflectance.ravel()[index].astype(np.float64)
    else:
        weight = geometry.weight.ravel()[index].astype(np.float64)
    size = sweep.shape[0] * sweep.shape[1]
    # neighbouring angles go to different halves, so that both see the same part of the target
    cell = pixel + size * ((index // size) % HALVES)
    shape = (HALVES, *sweep.shape)

    def total(values: Float64Array) -> Float64Array:
        summed: Float64Array = np.bincount(cell, weights=values, minlength=HALVES * size).astype(np.float64)
        return summed.reshape(shape)

    weights = total(weight)
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(weights > 0.0, dut.full_scale_counts * weights, np.nan)
        return TargetMap(
            target=target,
            power=total(counts) / scale,
            weight=weights,
            variance=total(variance) / scale**2,
            pixel=pixel,
            angle=index // size,
            counts=counts,
        )


def _merged(power: Float64Array, variance: Float64Array, weight: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Mean over the first axis by weight; NaN where all are."""
    weight = np.where(np.isfinite(power), weight, 0.0)
    total = weight.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = weight / total
    mean = np.where(total > 0.0, (share * np.nan_to_num(power)).sum(axis=0), np.nan)
    spread = np.where(total > 0.0, (share**2 * np.nan_to_num(variance)).sum(axis=0), np.nan)
    return mean, spread


def _gain_variance(step: StepData) -> float:
    """Variance of the common relative gain of one angle's mean, over the angles at which a target was seen."""
    sweep, geometry = step.sweep, step.geometry
    size = sweep.shape[0] * sweep.shape[1]
    angles = np.flatnonzero(
        sum(np.bincount(geometry.seen(target) // size, minlength=len(sweep.frames)) for target in geometry.stripes)
    )
    excess = sweep.intensity_common_variance[angles] - sweep.intensity_common_floor[angles]
    return max(float(np.mean(excess)), 0.0) / float(sweep.frames[angles].mean())
