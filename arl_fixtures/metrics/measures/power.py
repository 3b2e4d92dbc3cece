"""Relative P_o: total power, agreement of the targets, and the map's change against the reference.

* ``power_level``: total power against the twin's, so against the DUT file. Type B: reflectance certificate,
  position of target and DUT (twice their relative error, the inverse square law).
* ``power_target_agreement``: how far a target's level lies from the mean of the targets.
* ``power_change``: total power against the reference, over the targets and pixels that both saw. Certificate and
  target position are the same for both and cancel.
* ``power_worst_3x3``: change of the map (relative to its mean) in the 3 × 3 neighbourhood that changed most. The
  largest of 4000 noisy values is not an unbiased one: the place is found in the map from the even angles and the
  change is read from the odd ones. (The mean with the same the other way round has less scatter, but not by √2: the
  one half's noise chooses where the other is read, so the two readings are correlated, by as much as the map allows.)

Propagation is linear throughout.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.metric import Metric
from arl_fixtures.metrics.power_map import HALVES, Correction, PowerMap, combined_map, power_map, target_map
from arl_fixtures.metrics.power_total import total_power
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.step import NO_REFERENCE, StepData
from arl_fixtures.quantity import Contribution, Kind, Quantity

Float64Array = npt.NDArray[np.float64]

DOUBT: Final = 2.0
"""Standard uncertainties by which a change must exceed another to be the worse one."""
FEWEST_NEIGHBOURS: Final = 6
"""Pixels of a 3 × 3 neighbourhood that must have a value."""


def evaluate(step: StepData) -> list[Measurement]:
    """Level, agreement of the targets, change, worst neighbourhood, and what the paper's correction would differ."""
    power = step.derive(power_map)
    measured = [step.measured("power_level", _level(step, power))]
    for target in step.geometry.stripes:
        measured.append(_agreement(step, power, target))
    measured.append(step.measured("power_paper_difference", _paper_difference(step, power)))
    try:
        reference = step.need_reference()
        measured.append(step.measured("power_change", _change(step, power, reference), relative=True))
        value, place = worst_neighbourhood(power, reference)
        measured.append(step.measured("power_worst_3x3", value, reason=place, relative=True))
    except NotMeasurableError as reason:
        attempted = str(reason) != NO_REFERENCE
        measured += [step.unmeasured(name, str(reason), attempted=attempted) for name in METRIC.names[-2:]]
    return measured


def remember(step: StepData) -> Mapping[str, npt.NDArray[Any]]:
    """The map, its halves, and each target's own map."""
    power = step.derive(power_map)
    kept: dict[str, npt.NDArray[Any]] = {
        "power": power.power,
        "power.variance": power.variance,
        "power.halves": power.halves,
        "power.halves_variance": power.halves_variance,
        "power.gain_variance": np.array(power.sharing.gain_variance),
    }
    for target in power.level:
        kept[f"power.{target}"], kept[f"power.{target}.variance"] = target_map(step, target).whole
    return kept


def change_map(power: PowerMap, reference: Reference) -> tuple[Float64Array, Float64Array]:
    """Change of P_o relative to the map's mean, per pixel, and its variance, (H, W) each.

    Both maps are brought to the same mean over the pixels they share.
    """
    return _change_of(power.power, power.variance, reference.array("power"), reference.array("power.variance"))


def worst_neighbourhood(power: PowerMap, reference: Reference) -> tuple[Quantity, str]:
    """Mean change in the 3 × 3 neighbourhood that changed most, and where it is.

    Raises:
        NotMeasurableError: no neighbourhood has enough pixels in both maps.
    """
    changes, variances = [], []
    for half in range(HALVES):
        change, variance = _change_of(
            power.halves[half],
            power.halves_variance[half],
            reference.array("power.halves")[half],
            reference.array("power.halves_variance")[half],
        )
        mean, mean_variance = _neighbourhoods(change, variance)
        changes.append(mean)
        variances.append(mean_variance)
    find, read = range(HALVES)
    known = np.isfinite(changes[find]) & np.isfinite(changes[read])
    if not known.any():
        raise NotMeasurableError("no 3 × 3 neighbourhood was measured now and in the reference")
    # the largest change that is beyond doubt: the rim's few sightings scatter more than anything else changes
    certain = np.where(known, np.abs(changes[find]) - DOUBT * np.sqrt(variances[find]), -np.inf)
    place = int(certain.argmax())
    gain = float(power.sharing.covariance(_box_at(place, power.power), read)[0, 0])
    v, u = divmod(place, power.power.shape[1])
    quantity = Quantity.of(
        100.0 * float(changes[read].flat[place]),
        "%",
        Contribution("repeatability", 100.0 * math.sqrt(float(variances[read].flat[place]))),
        Contribution("frame gain", 100.0 * math.sqrt(gain * _both_gains(power, reference))),
    )
    return quantity, f"around pixel ({u}, {v})"


def _level(step: StepData, power: PowerMap) -> Quantity:
    twin = step.dut.gain * step.geometry.power
    seen = np.isfinite(power.power)
    ratio = float(power.power[seen].mean() / twin[seen].mean())
    targets = len(power.level)
    maps = [target_map(step, target) for target in power.level]
    found, variances = (np.stack(part) for part in zip(*(single.whole for single in maps), strict=True))
    total = total_power(found, variances, np.stack([single.weight.sum(axis=0) for single in maps]))
    gain = power.sharing.variance(total.sensitivities) * power.sharing.gain_variance
    return Quantity.of(
        100.0 * (ratio - 1.0),
        "%",
        Contribution("repeatability", 100.0 * ratio * total.relative_u),
        Contribution("frame gain", 100.0 * ratio * math.sqrt(gain)),
        Contribution(
            "reflectance certificate", 100.0 * step.uncertainty.reflectance_relative / math.sqrt(targets), Kind.B
        ),
        Contribution("target position", 100.0 * _inverse_square(step) / math.sqrt(targets), Kind.B),
        Contribution(
            "mount position", 200.0 * step.uncertainty.mount_position_m / step.dut.reference_range_m, Kind.B
        ),
    )


def _both_gains(power: PowerMap, reference: Reference) -> float:
    """Variance of one angle's common gain, now plus then."""
    return power.sharing.gain_variance + float(reference.array("power.gain_variance"))


def _box_at(place: int, power: Float64Array) -> Float64Array:
    """Sensitivity of the mean over the 3 × 3 neighbourhood of a flat pixel index to each pixel, (1, H·W)."""
    v, u = divmod(place, power.shape[1])
    box = np.zeros(power.shape)
    box[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2] = 1.0
    box[~np.isfinite(power)] = 0.0
    return (box / max(float(box.sum()), 1.0)).reshape(1, -1)


def _inverse_square(step: StepData) -> float:
    """Relative standard uncertainty of a target's level from its position."""
    return 2.0 * step.uncertainty.target_position_m / step.dut.reference_range_m


def _agreement(step: StepData, power: PowerMap, target: str) -> Measurement:
    if target not in power.level:
        try:
            target_map(step, target)
        except NotMeasurableError as reason:
            return step.unmeasured("power_target_agreement", str(reason), scope=target)
    if len(power.level) == 1:
        return step.unmeasured("power_target_agreement", "no other target to agree with", scope=target)
    # a level against the mean of n, itself included: (1 − 1/n) of its own error and 1/n of each other's
    n = len(power.level)
    own = {name: 1.0 - 1.0 / n if name == target else 1.0 / n for name in power.level}
    share = math.sqrt(sum(part**2 for part in own.values()))
    repeat = math.sqrt(sum((own[name] * power.level_u[name]) ** 2 for name in own))
    quantity = Quantity.of(
        100.0 * power.level[target],
        "%",
        Contribution("repeatability", 100.0 * repeat),
        Contribution("reflectance certificate", 100.0 * share * step.uncertainty.reflectance_relative, Kind.B),
        Contribution("target position", 100.0 * share * _inverse_square(step), Kind.B),
    )
    remark = "" if abs(quantity.value) <= quantity.expanded() else "disagrees with the other targets"
    return step.measured("power_target_agreement", quantity, scope=target, reason=remark)


def _paper_difference(step: StepData, power: PowerMap) -> Quantity:
    """Largest difference between the relative maps with the paper's correction and with the true range."""
    paper = combined_map(step, Correction.PAPER).relative
    return Quantity(100.0 * float(np.nanmax(np.abs(paper - power.relative))), "%")


def _change(step: StepData, power: PowerMap, reference: Reference) -> Quantity:
    common = [k for k, target in enumerate(power.level) if f"power.{target}" in reference.arrays]
    if not common:
        raise NotMeasurableError("no reflectance target was seen now and in the reference")
    targets = [list(power.level)[k] for k in common]
    maps = [target_map(step, target) for target in targets]
    now, now_variance = (np.stack(part) for part in zip(*(single.whole for single in maps), strict=True))
    then = np.stack([reference.array(f"power.{target}") for target in targets])
    then_variance = np.stack([reference.array(f"power.{target}.variance") for target in targets])
    weight = np.stack([single.weight.sum(axis=0) for single in maps])
    both = np.isfinite(now) & np.isfinite(then)
    before = total_power(np.where(both, then, np.nan), then_variance, weight)
    after = total_power(np.where(both, now, np.nan), now_variance, weight)
    ratio = after.value / before.value
    sensitivities = np.zeros((len(power.level), power.power.size))
    sensitivities[common] = after.sensitivities
    gain = power.sharing.variance(sensitivities) * _both_gains(power, reference)
    return Quantity.of(
        100.0 * (ratio - 1.0),
        "%",
        Contribution("repeatability", 100.0 * ratio * math.hypot(after.relative_u, before.relative_u)),
        Contribution("frame gain", 100.0 * ratio * math.sqrt(gain)),
    )


def _change_of(
    now: Float64Array, now_variance: Float64Array, then: Float64Array, then_variance: Float64Array
) -> tuple[Float64Array, Float64Array]:
    both = np.isfinite(now) & np.isfinite(then) & (then > 0.0)
    if not both.any():
        raise NotMeasurableError("no pixel was measured now and in the reference")
    level = float(now[both].mean() / then[both].mean())
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(both, now / then / level, np.nan)
        variance = ratio**2 * (now_variance / now**2 + then_variance / then**2)
    return ratio - 1.0, variance


def _neighbourhoods(values: Float64Array, variance: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Mean over each pixel's 3 × 3 neighbourhood and its variance; NaN at the rim and where too few have a value."""
    seen = np.isfinite(values)
    counts = _box_sum(seen.astype(np.float64))
    with np.errstate(invalid="ignore", divide="ignore"):
        enough = counts >= FEWEST_NEIGHBOURS
        mean = np.where(enough, _box_sum(np.where(seen, values, 0.0)) / counts, np.nan)
        mean_variance = np.where(enough, _box_sum(np.where(seen, variance, 0.0)) / counts**2, np.nan)
    return mean, mean_variance


def _box_sum(values: Float64Array) -> Float64Array:
    windows = np.lib.stride_tricks.sliding_window_view(values, (3, 3)).sum(axis=(2, 3))
    padded: Float64Array = np.pad(windows, 1)
    return padded


METRIC = Metric(
    names=(
        "power_level",
        "power_target_agreement",
        "power_paper_difference",
        "power_change",
        "power_worst_3x3",
    ),
    evaluate=evaluate,
    remember=remember,
    units=dict.fromkeys(
        (
            "power_level",
            "power_target_agreement",
            "power_paper_difference",
            "power_change",
            "power_worst_3x3",
        ),
        "%",
    ),
)
