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

    Faulty pixels, pixels without a return and values at the end of the scale do not count.

    Raises:
        NotMeasurableError: nothing was recorded, or there is no twin.
    """
    sweep, geometry = step.sweep, step.geometry
    size = sweep.shape[0] * sweep.shape[1]
    healthy = ~step.derive(pixel_faults).faulty.ravel() if not step.faults else np.ones(size, dtype=bool)
    hidden = {} if "distance" in step.faults else _hidden(step)
    found: dict[str, Sightings | str] = {}
    for target in geometry.stripes:
        index = geometry.seen(target)
        pixel = index % size
        level = sweep.intensity_counts.ravel()[index]
        answered = np.maximum(sweep.intensity_returns.ravel()[index], sweep.distance_returns.ravel()[index])
        # five σ below the end of the scale no frame behind the mean was clipped
        room = step.dut.noise.full_counts - 5.0 * np.sqrt(np.nan_to_num(sweep.intensity_variance.ravel()[index]))
        good = (answered > 0) & ~(level > room) & healthy[pixel]
        found[target] = Sightings(target, index[good], pixel[good])
        share = np.unique(pixel[good]).size / size
        if share < LEAST_COVERAGE:
            found[target] = f"only {share:.0%} of the pixels saw {target}{step.shortfall}"
        elif target in hidden:
            found[target] = hidden[target]
    return found


def _hidden(step: StepData) -> dict[str, str]:
    """Reflectance targets whose range is not where all other surfaces say that it should be."""
    sweep, geometry = step.sweep, step.geometry
    seen_m: dict[str, float] = {}
    off_m: dict[str, float] = {}
    for surface in geometry.scene.surface_names:
        index = geometry.seen(surface)
        distance_m = sweep.distance_m.ravel()[index]
        answered = np.isfinite(distance_m)
        if answered.any():
            seen_m[surface] = float(np.median(distance_m[answered]))
            off_m[surface] = float(np.median((distance_m - geometry.true_range_m.ravel()[index])[answered]))
    # an error of the DUT shifts all surfaces; what is left over belongs to the one
    shared_m = float(np.median(list(off_m.values()))) if off_m else 0.0
    return {
        target: f"{target} is hidden or gone: at {seen_m[target]:.2f} m, off by {off_m[target] - shared_m:+.2f} m"
        for target in geometry.stripes
        if target in off_m and abs(off_m[target] - shared_m) > HIDDEN_M
    }


def sightings_of(step: StepData, target: str) -> Sightings:
    """Sightings of one reflectance target.

    Raises:
        NotMeasurableError: too few, or the target is hidden.
    """
    found = step.derive(all_sightings)[target]
    if isinstance(found, str):
        raise NotMeasurableError(found)
    return found
