"""Does the twin agree with the recording? Bias and scatter of the residuals per channel and reflectance target.

A residual is a pixel's mean at an angle minus the twin's expectation there: relative for the intensity, in metres for
the distance. The twin's own residuals are its noise model's, drawn once per geometry with a fixed seed. So the bias
says how far off the twin is, the corrected area how much the recording scatters (over pixels, angles and frames)
beyond what the twin says that it should. Agreement is a limit on them: with the guard band it is shown only where
|bias| + U stays within.

Type B of the bias: reflectance certificate and target position, as for the metrics of the channel itself.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.geometry import Geometry
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.scatter import FEWEST_RETURNS
from arl_fixtures.metrics.step import StepData
from arl_fixtures.metrics.targets import sightings_of
from arl_fixtures.metrics.validation import DoubleValidation, double_validation
from arl_fixtures.quantity import Contribution, Kind, Quantity

Float64Array = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

CHANNELS: Final = {"intensity": "%", "distance": "m"}
PARTS: Final = ("bias", "area", "corrected_area", "wasserstein")
MOST_VALUES: Final = 10_000
"""Sightings compared, evenly spread: more of them only cost time, the bench's own uncertainty is far larger."""
SEED: Final = 20_151
"""Of the twin's own residuals; the same in every run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One channel on one target.

    Attributes:
        found: bias, areas, distance, in `CHANNELS[channel]`.
        sampling_u: standard uncertainty from the finite samples.
        size: values compared.
    """

    found: DoubleValidation
    sampling_u: float
    size: int


def compare(step: StepData, channel: str, target: str) -> Comparison:
    """Residuals of recording and twin on one target.

    Args:
        step: the step.
        channel: ``intensity`` or ``distance``.
        target: name of a reflectance target.

    Raises:
        NotMeasurableError: the channel was not recorded, or the target was not seen.
    """
    sweep, geometry = step.require(channel), step.geometry
    index = sightings_of(step, target).index
    index = index[:: 1 + index.size // MOST_VALUES]
    expected = geometry.intensity_counts.ravel()[index].astype(np.float64)
    if channel == "intensity":
        returns = sweep.intensity_returns.ravel()[index]
        residual = 100.0 * (sweep.intensity_counts.ravel()[index].astype(np.float64) / expected - 1.0)
    else:
        returns = sweep.distance_returns.ravel()[index]
        twin_m = geometry.distance_m.ravel()[index].astype(np.float64)
        residual = sweep.distance_m.ravel()[index].astype(np.float64) - twin_m
    usable = (returns >= FEWEST_RETURNS) & np.isfinite(residual)
    if not usable.any():
        raise NotMeasurableError(
            f"nowhere {FEWEST_RETURNS} {channel} values from {target} at one angle{step.shortfall}"
        )
    index, residual, returns = index[usable], residual[usable], returns[usable]
    sigma = _twin_scatter(geometry, channel, expected[usable])
    normal = _normals(geometry.intensity_counts.shape).ravel()[index].astype(np.float64)
    own = normal * sigma / np.sqrt(returns)
    found = double_validation(residual, own)
    sampling = math.sqrt((float(residual.var()) + float(own.var())) / residual.size)
    return Comparison(found=found, sampling_u=sampling, size=residual.size)


def evaluate(step: StepData) -> list[Measurement]:
    """Bias, areas and distance per channel and target."""
    measured = []
    for channel, unit in CHANNELS.items():
        for target in step.geometry.stripes:
            names = {part: f"twin_{channel}_{part}" for part in PARTS}
            try:
                result = compare(step, channel, target)
            except NotMeasurableError as reason:
                measured += [step.unmeasured(name, str(reason), scope=target) for name in names.values()]
                continue
            sampling = Contribution("repeatability", result.sampling_u, Kind.A, result.size - 1)
            for part, name in names.items():
                known = (sampling,) if part == "corrected_area" else (sampling, *_bench(step, channel))
                quantity = Quantity.of(getattr(result.found, part), unit, *known)
                measured.append(step.measured(name, quantity, scope=target))
    return measured


def _bench(step: StepData, channel: str) -> tuple[Contribution, ...]:
    bench, reference_m = step.uncertainty, step.dut.reference_range_m
    if channel == "distance":
        return (
            Contribution("target position", bench.target_position_m, Kind.B),
            Contribution("mount position", bench.mount_position_m, Kind.B),
        )
    return (
        Contribution("reflectance certificate", 100.0 * bench.reflectance_relative, Kind.B),
        Contribution("target position", 200.0 * bench.target_position_m / reference_m, Kind.B),
        Contribution("mount position", 200.0 * bench.mount_position_m / reference_m, Kind.B),
    )


def _twin_scatter(geometry: Geometry, channel: str, counts: Float64Array) -> Float64Array:
    """One frame's scatter by the noise model, coding included: percent of the intensity, or metres."""
    noise = geometry.dut.noise
    variance = noise.read_noise_counts**2 + noise.shot_counts * counts + (noise.relative * counts) ** 2
    if channel == "intensity":
        relative: Float64Array = 100.0 * np.sqrt(variance + 1.0 / 12.0) / counts
        return relative
    slope = noise.distance_slope_m**2 * variance / counts**2
    scatter: Float64Array = np.sqrt(
        noise.distance_factor**2 * (noise.distance_floor_m**2 + slope) + noise.range_step_m**2 / 12.0
    )
    return scatter


@functools.lru_cache(maxsize=1)
def _normals(shape: tuple[int, ...]) -> Float32Array:
    """The same for every DUT, so that nothing depends on which others there are."""
    return np.random.default_rng(SEED).standard_normal(shape, dtype=np.float32)


UNITS: Final = {"intensity": "%", "distance": "m"}

METRIC = Metric(
    names=tuple(f"twin_{channel}_{part}" for channel in CHANNELS for part in PARTS),
    evaluate=evaluate,
    units={f"twin_{channel}_{part}": unit for channel, unit in UNITS.items() for part in PARTS},
)
