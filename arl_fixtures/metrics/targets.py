"""Which pixels at which angles saw a reflectance target, and whether the target was there at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.metrics.pixel_faults import pixel_faults
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.step import StepData

Int64Array = npt.NDArray[np.int64]

LEAST_COVERAGE: Final = 0.8
"""Share of the image that must have seen a target for the target's value to stand for the DUT."""
HIDDEN_M: Final = 0.05
"""A target whose median range is off by more than this is not what the DUT sees."""


@dataclass(frozen=True, slots=True)
class Sightings:
    """Where a target was seen in full by single pixels.

    Attributes:
        target: its name.
        index: (m,) flat indices into (n, H, W).
        pixel: (m,) flat indices into (H, W).
    """

    target: str
    index: Int64Array
    pixel: Int64Array


def all_sightings(step: StepData) -> dict[str, Sightings | str]:
    """Sightings of every reflectance target, or why it has none.

    Faulty pixels, pixels without a return and values at the end of the scale do not count; nor does what lies in
    front of a target or behind where it should be.

    Raises:
        NotMeasurableError: nothing was recorded, or there is no twin.
    """
    sweep, geometry = step.sweep, step.geometry
    size = sweep.shape[0] * sweep.shape[1]
    healthy = ~step.derive(pixel_faults).faulty.ravel() if not step.missing else np.ones(size, dtype=bool)
    shared_m = None if "distance" in step.missing else _shared_offset_m(step)
    found: dict[str, Sightings | str] = {}
    for target in geometry.stripes:
        index = geometry.seen(target)
        pixel = index % size
        level = sweep.intensity_counts.ravel()[index]
        answered = np.maximum(sweep.intensity_returns.ravel()[index], sweep.distance_returns.ravel()[index])
        # five σ below the end of the scale no frame behind the mean was clipped
        room = step.dut.noise.full_counts - 5.0 * np.sqrt(np.nan_to_num(sweep.intensity_variance.ravel()[index]))
        good = (answered > 0) & ~(level > room) & healthy[pixel]
        if shared_m is not None:
            distance_m = sweep.distance_m.ravel()[index]
            off_m = distance_m - geometry.true_range_m.ravel()[index] - np.float32(shared_m)
            there = ~(np.abs(off_m) > HIDDEN_M)
            if good.any() and there[good].mean() < LEAST_COVERAGE:
                away = good & ~there
                at_m, by_m = float(np.median(distance_m[away])), float(np.median(off_m[away]))
                found[target] = f"{target} is hidden or gone: at {at_m:.2f} m, off by {by_m:+.2f} m"
                continue
            good &= there
        found[target] = Sightings(target, index[good], pixel[good])
        share = np.count_nonzero(np.bincount(pixel[good], minlength=size)) / size
        if share < LEAST_COVERAGE:
            found[target] = f"only {share:.0%} of the pixels saw {target}{step.shortfall}"
    return found


def _shared_offset_m(step: StepData) -> float:
    """Distance error that all surfaces share: the DUT's own. The rest belongs to the surface that has it."""
    sweep, geometry = step.sweep, step.geometry
    offsets_m = []
    for surface in geometry.scene.surface_names:
        # every seventh sighting tells a median well enough
        index = geometry.seen(surface)[::7]
        off_m = sweep.distance_m.ravel()[index] - geometry.true_range_m.ravel()[index]
        off_m = off_m[np.isfinite(off_m)]
        if off_m.size:
            offsets_m.append(float(np.median(off_m)))
    return float(np.median(offsets_m)) if offsets_m else 0.0


def sightings_of(step: StepData, target: str) -> Sightings:
    """Sightings of one reflectance target.

    Raises:
        NotMeasurableError: too few, or the target is hidden.
    """
    found = step.derive(all_sightings)[target]
    if isinstance(found, str):
        raise NotMeasurableError(found)
    return found
