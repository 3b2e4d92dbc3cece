"""What σ_I and σ_D have in common: values per reflectance target, change, noisy pixels, common part of a frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.scatter import FEWEST_RETURNS, Pooled, c4, pool
from arl_fixtures.metrics.statistics import SweepSummary
from arl_fixtures.metrics.step import NO_REFERENCE, StepData
from arl_fixtures.metrics.targets import sightings_of
from arl_fixtures.quantity import Contribution, Quantity
from arl_fixtures.twin.settings import DutSettings

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]

NOISY_FACTOR: Final = 1.6
"""A pixel is noisy whose scatter is this many times its neighbours' on the same target."""
FEWEST_DOF: Final = 20
STRIP_COLUMNS: Final = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class ScatterChannel:
    """Where a channel's scatter is found.

    Attributes:
        name: prefix of the metrics' names.
        unit: of the values.
        common_unit: of the common part: dimensionless for a gain.
        variance: (n, H, W) own variance.
        returns: (n, H, W) frames behind it.
        common: (n,) variance of the common part and its floor.
        step_size: quantisation step of a DUT's values, in `unit`.
    """

    name: str
    unit: str
    common_unit: str
    variance: Callable[[SweepSummary], Float32Array]
    returns: Callable[[SweepSummary], UInt8Array]
    common: Callable[[SweepSummary], tuple[Float64Array, Float64Array]]
    step_size: Callable[[DutSettings], float]

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names of the values."""
        return tuple(
            f"{self.name}_{what}" for what in ("scatter", "scatter_change", "noisy_pixels", "common_scatter")
        )

    @property
    def metric_units(self) -> dict[str, str]:
        """Unit of each value; the common part is relative where the channel is an intensity."""
        common = "1" if self.unit == "counts" else self.unit
        return dict(zip(self.metric_names, (self.unit, "%", "1", common), strict=True))


def evaluate_channel(step: StepData, channel: ScatterChannel) -> list[Measurement]:
    """All values of one channel.

    Raises:
        NotMeasurableError: the channel was not recorded.
    """
    step.require(channel.name)
    scatter, change, noisy, common = channel.metric_names
    measured: list[Measurement] = []
    for target in step.geometry.stripes:
        try:
            pooled = _pooled(step, channel, target)
        except NotMeasurableError as reason:
            measured += [step.unmeasured(name, str(reason), scope=target) for name in (scatter, change, noisy)]
            continue
        measured.append(step.measured(scatter, pooled.quantity(channel.unit), scope=target))
        measured.append(_changed(step, channel, target, pooled))
        measured.append(step.measured(noisy, _noisy_pixels(step, channel, target), scope=target))
    measured.append(step.measured(common, common_part(*channel.common(step.sweep), step.sweep, channel.common_unit)))
    return measured


def remember_channel(step: StepData, channel: ScatterChannel) -> Mapping[str, npt.NDArray[Any]]:
    """Pooled variance, dof and its uncertainty per target, as arrays of three."""
    remembered = {}
    for target in step.geometry.stripes:
        pooled = _pooled(step, channel, target)
        remembered[f"{channel.name}_scatter.{target}"] = np.array(
            [pooled.variance, pooled.dof, pooled.u, pooled.remainder]
        )
    return remembered


def scatter_map(step: StepData, channel: ScatterChannel, target: str) -> Float64Array:
    """σ(u, v) on one target, pooled over the angles at which a pixel saw it; (H, W), NaN where it did not.

    Quantisation is taken out and the small-sample factor applied.

    Raises:
        NotMeasurableError: the target is hidden or was hardly seen.
    """
    s2, nu = _per_pixel(step, channel, target)
    with np.errstate(invalid="ignore", divide="ignore"):
        clean = np.maximum(s2 - channel.step_size(step.dut) ** 2 / 12.0, 0.0)
        sigma: Float64Array = np.where(nu > 0, np.sqrt(clean) / c4(np.maximum(nu, 1.0)), np.nan)
    return sigma


def common_part(variance: Float64Array, floor: Float64Array, sweep: SweepSummary, unit: str) -> Quantity:
    """Standard deviation that all pixels of a frame share, over the whole sweep.

    Angles are weighted by what pixel noise leaves of their estimate; a noise floor larger than the estimate gives 0.
    """
    nu = np.maximum(sweep.frames - 1, 0).astype(np.float64)
    usable = (nu > 0) & (floor > 0)
    if not usable.any():
        raise NotMeasurableError("one frame per angle tells nothing of the scatter between frames")
    nu, raw, noise = nu[usable], variance[usable], floor[usable]
    weight = nu / noise**2
    excess = float((weight * (raw - noise)).sum() / weight.sum())
    expected = max(excess, 0.0) + noise
    u = math.sqrt(float((weight**2 * 2.0 * expected**2 / nu).sum())) / float(weight.sum())
    sigma = math.sqrt(max(excess, 0.0))
    return Quantity.of(sigma, unit, Contribution("repeatability", math.sqrt(max(excess, 0.0) + u) - sigma))


def _pooled(step: StepData, channel: ScatterChannel, target: str) -> Pooled:
    sweep, index = step.require(channel.name), sightings_of(step, target).index
    variance, returns = channel.variance(sweep).ravel()[index], channel.returns(sweep).ravel()[index]
    return pool(variance, returns, channel.step_size(step.dut))


def _changed(step: StepData, channel: ScatterChannel, target: str, now: Pooled) -> Measurement:
    name = f"{channel.name}_scatter_change"
    try:
        kept = step.need_reference().array(f"{channel.name}_scatter.{target}").tolist()
    except NotMeasurableError as reason:
        return step.unmeasured(name, str(reason), scope=target, attempted=str(reason) != NO_REFERENCE)
    variance, dof, u, remainder = kept
    then = Pooled(variance=variance, dof=dof, u=u, remainder=remainder)
    if then.variance <= 0.0:
        return step.unmeasured(name, f"the reference shows no scatter on {target}", scope=target)
    change = now.quantity(channel.unit).relative_to(then.quantity(channel.unit)).to("%")
    return step.measured(name, change, scope=target, relative=True)


def _per_pixel(step: StepData, channel: ScatterChannel, target: str) -> tuple[Float64Array, Float64Array]:
    """Variance pooled over angles and its degrees of freedom, (H, W) each; 0 and 0 where nothing was seen."""
    sweep, sightings = step.require(channel.name), sightings_of(step, target)
    variance = channel.variance(sweep).ravel()[sightings.index]
    returns = channel.returns(sweep).ravel()[sightings.index]
    usable = (returns >= FEWEST_RETURNS) & np.isfinite(variance)
    nu = np.where(usable, returns.astype(np.float64) - 1.0, 0.0)
    size = sweep.shape[0] * sweep.shape[1]
    dof: Float64Array = np.bincount(sightings.pixel, weights=nu, minlength=size).astype(np.float64)
    total = np.bincount(sightings.pixel, weights=nu * np.where(usable, variance, 0.0), minlength=size)
    return (total / np.maximum(dof, 1.0)).reshape(sweep.shape), dof.reshape(sweep.shape)


def _noisy_pixels(step: StepData, channel: ScatterChannel, target: str) -> Quantity:
    """Pixels that scatter much more than the median of the image rows and columns around them."""
    s2, nu = _per_pixel(step, channel, target)
    decided = nu >= FEWEST_DOF
    sigma = np.where(decided, np.sqrt(s2), np.nan)
    noisy = 0
    # the level of σ follows the beam over the image: compare within strips of it
    for start in range(0, sigma.shape[1], STRIP_COLUMNS):
        strip = sigma[:, start : start + STRIP_COLUMNS]
        strip = strip[np.isfinite(strip)]
        if strip.size:
            noisy += int(np.count_nonzero(strip > NOISY_FACTOR * np.median(strip)))
    return Quantity(float(noisy), "1")
