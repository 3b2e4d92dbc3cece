"""ΔD(u, v): relative distance error against the true ray range per target, and its dependence on the intensity.

The measured mean at an angle is compared with the range of the pixel's centre ray there; a pixel's errors are
averaged over the angles at which it saw the target, the target's value over the pixels, so that every direction
counts once. Propagation is linear. Type B: position of the target and of the DUT (their relative errors are the
value's; the DUT's is the same for all targets and leaves the slope alone), stage angle (dR/dφ ≤ R tan θ, independent
from angle to angle).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.scatter import FEWEST_RETURNS
from arl_fixtures.metrics.step import StepData
from arl_fixtures.metrics.targets import sightings_of
from arl_fixtures.quantity import Contribution, Kind, Quantity

Float64Array = npt.NDArray[np.float64]

FEWEST_TARGETS: Final = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorMap:
    """Distance error on one target.

    Attributes:
        relative: (H, W) mean of measured/true − 1; NaN where the target was not seen.
        u: (H, W) its standard uncertainty from repeatability.
        mean_m: mean error over pixels, metres.
        mean_u_m: its standard uncertainty from repeatability, metres.
        log_intensity: mean over pixels of log10 of the intensity in counts.
        range_m: mean true range.
        stage_sensitivity_m_per_rad: root mean square of dR/dφ over the pixels.
        angles: number of stage angles involved.
        offset_u_m: standard uncertainty of the mean error from the offset that all pixels of a frame share.
    """

    relative: Float64Array
    u: Float64Array
    mean_m: float
    mean_u_m: float
    log_intensity: float
    range_m: float
    stage_sensitivity_m_per_rad: float
    angles: int
    offset_u_m: float


def error_map(step: StepData, target: str) -> ErrorMap:
    """Distance error of every pixel on one target.

    Raises:
        NotMeasurableError: the distance was not recorded, or the target was not seen.
    """
    sweep, geometry = step.require("distance"), step.geometry
    sightings = sightings_of(step, target)
    returns = sweep.distance_returns.ravel()[sightings.index].astype(np.float64)
    usable = returns >= FEWEST_RETURNS
    index, pixel, returns = sightings.index[usable], sightings.pixel[usable], returns[usable]
    if not index.size:
        raise NotMeasurableError(f"nowhere {FEWEST_RETURNS} distances from {target} at one angle{step.shortfall}")
    true_m = geometry.true_range_m.ravel()[index].astype(np.float64)
    error_m = sweep.distance_m.ravel()[index] - true_m
    variance = sweep.distance_variance.ravel()[index] / returns
    size = sweep.shape[0] * sweep.shape[1]
    angles = np.bincount(pixel, minlength=size)
    seen = angles > 0

    def mean_of(values: Float64Array) -> Float64Array:
        total = np.bincount(pixel, weights=values, minlength=size)
        mean: Float64Array = np.where(seen, total / np.maximum(angles, 1), np.nan)
        return mean

    pixel_error_m = mean_of(error_m)
    with np.errstate(invalid="ignore"):
        pixel_variance = mean_of(variance) / angles
    intensity = np.maximum(sweep.intensity_counts.ravel()[index], 1.0)
    known = np.isfinite(intensity)
    # |dR/dφ| of a plane seen under θ is at most R tan θ
    cosine = geometry.cos_incidence.ravel()[index].astype(np.float64)
    slope_m = true_m * np.sqrt(np.maximum(1.0 / cosine**2 - 1.0, 0.0))
    by_angle = np.bincount(index // size, minlength=len(sweep.frames)) / index.size
    wobble_m2 = float((by_angle * (sweep.distance_common_variance - sweep.distance_common_floor)).sum())
    return ErrorMap(
        relative=mean_of(error_m / true_m).reshape(sweep.shape),
        u=(np.sqrt(pixel_variance) / mean_of(true_m)).reshape(sweep.shape),
        mean_m=float(np.nanmean(pixel_error_m)),
        mean_u_m=math.sqrt(float(np.nansum(pixel_variance))) / int(seen.sum()),
        log_intensity=float(np.log10(intensity[known]).mean()) if known.any() else math.nan,
        range_m=float(true_m.mean()),
        stage_sensitivity_m_per_rad=float(np.sqrt((slope_m**2).mean())),
        angles=int(np.count_nonzero(by_angle)),
        offset_u_m=math.sqrt(max(wobble_m2, 0.0) * float((by_angle**2 / sweep.frames).sum())),
    )


def evaluate(step: StepData) -> list[Measurement]:
    """ΔD per target, spread over the pixels, slope against the logarithm of the intensity."""
    measured: list[Measurement] = []
    maps: list[ErrorMap] = []
    lacking = ""
    for target in step.geometry.stripes:
        try:
            errors = error_map(step, target)
        except NotMeasurableError as reason:
            measured += [step.unmeasured(name, str(reason), scope=target) for name in METRIC.names[:2]]
            lacking = lacking or f": {reason}"
            continue
        maps.append(errors)
        measured.append(step.measured("distance_error", _error(step, errors), scope=target))
        measured.append(step.measured("distance_error_spread", _spread(errors), scope=target))
    try:
        step.require("intensity")
        measured.append(step.measured("distance_error_per_decade", _per_decade(step, maps)))
    except NotMeasurableError as reason:
        measured.append(step.unmeasured("distance_error_per_decade", f"{reason}{lacking}"))
    return measured


def _bench_contributions(step: StepData, errors: ErrorMap) -> tuple[Contribution, ...]:
    """Contributions to the mean error besides the pixels' repeatability, metres."""
    u_angle_rad = math.radians(step.uncertainty.stage_angle_deg)
    u_turn_m = errors.stage_sensitivity_m_per_rad * u_angle_rad / math.sqrt(errors.angles)
    return (
        Contribution("target position", step.uncertainty.target_position_m, Kind.B),
        Contribution("stage angle", u_turn_m, Kind.B),
        Contribution("mount position", step.uncertainty.mount_position_m, Kind.B),
        Contribution("frame offset", errors.offset_u_m),
    )


def _error(step: StepData, errors: ErrorMap) -> Quantity:
    to_percent = 100.0 / errors.range_m
    parts = (Contribution("repeatability", errors.mean_u_m), *_bench_contributions(step, errors))
    scaled = (Contribution(part.name, part.u * to_percent, part.kind, part.dof) for part in parts)
    return Quantity.of(100.0 * float(np.nanmean(errors.relative)), "%", *scaled)


def _spread(errors: ErrorMap) -> Quantity:
    """Standard deviation over the pixels that repeatability does not explain."""
    seen = np.isfinite(errors.relative)
    n = int(seen.sum())
    total = float(np.var(errors.relative[seen], ddof=1))
    noise = float((errors.u[seen] ** 2).mean())
    spread = math.sqrt(max(total - noise, 0.0))
    u_variance = total * math.sqrt(2.0 / (n - 1))
    u = math.sqrt(spread**2 + u_variance) - spread
    return Quantity.of(100.0 * spread, "%", Contribution("repeatability", 100.0 * u, Kind.A, n - 1))


def _per_decade(step: StepData, maps: list[ErrorMap]) -> Quantity:
    """Slope of the mean error against log10 intensity over the targets, weighted least squares."""
    usable = [errors for errors in maps if math.isfinite(errors.log_intensity)]
    if len(usable) < FEWEST_TARGETS:
        raise NotMeasurableError("needs two reflectance targets of different brightness")
    x = np.array([errors.log_intensity for errors in usable])
    y_m = np.array([errors.mean_m for errors in usable])
    noise = np.array([errors.mean_u_m for errors in usable])
    bench = np.array([[part.u for part in _bench_contributions(step, errors)] for errors in usable])
    # where the DUT stands is the same for all targets
    noise, bench = np.hypot(noise, bench[:, 3]), bench[:, :2]
    weight = 1.0 / (noise**2 + (bench**2).sum(axis=1) + 1e-12)
    lever = weight * (x - np.average(x, weights=weight))
    strength = float(lever @ x)
    if strength <= 0.0:
        raise NotMeasurableError("the reflectance targets are equally bright")
    return Quantity.of(
        float(lever @ y_m) / strength,
        "m",
        Contribution("repeatability", float(np.linalg.norm(lever * noise)) / strength),
        Contribution("target position", float(np.linalg.norm(lever * bench[:, 0])) / strength, Kind.B),
        Contribution("stage angle", float(np.linalg.norm(lever * bench[:, 1])) / strength, Kind.B),
    )


METRIC = Metric(
    names=("distance_error", "distance_error_spread", "distance_error_per_decade"),
    evaluate=evaluate,
    units={"distance_error": "%", "distance_error_spread": "%", "distance_error_per_decade": "m"},
)
