"""Repeatability of the bench: how much a repeated step scatters when nothing was changed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.statistics import SweepSummary
from arl_fixtures.recording.observe import SweptBag

FEWEST_REPEATS: Final = 3


def repeatability(bags: Sequence[SweptBag]) -> dict[str, float]:
    """Standard deviation that all values of one step share, beyond what frames and pixels explain.

    For each DUT and repeat the common deviation from the mean over all repeats is taken: relative for the
    intensity, in metres for the distance, as a robust mean over pixels and angles. What the frames' own scatter
    contributes to that mean is negligible (10⁵ pixels) and not subtracted.

    Args:
        bags: the same step, repeated.

    Returns:
        `intensity_counts` (relative) and `distance_m` (metres).

    Raises:
        DataError: fewer than three repeats of the same step.
    """
    sweeps: dict[str, list[SweepSummary]] = defaultdict(list)
    for swept in bags:
        for serial, sweep in swept.sweeps.items():
            sweeps[serial].append(sweep)
    if not sweeps or min(len(repeats) for repeats in sweeps.values()) < FEWEST_REPEATS:
        raise DataError(f"a gauge study needs at least {FEWEST_REPEATS} repeats of the same step")
    temperatures = {swept.bag.metadata.set_temperature_c for swept in bags}
    if len(temperatures) > 1:
        raise DataError(f"a gauge study repeats one step; these have set temperatures {sorted(temperatures)}")
    pairs = [
        (
            _common(np.stack([each.intensity_counts for each in repeats]), relative=True),
            _common(np.stack([each.distance_m for each in repeats]), relative=False),
        )
        for repeats in sweeps.values()
    ]
    intensity, distance = np.sqrt(np.mean(np.square(pairs), axis=0))
    return {"intensity_counts": float(intensity), "distance_m": float(distance)}


def _common(values: npt.NDArray[np.float32], *, relative: bool) -> float:
    """Standard deviation over repeats of the median deviation; `values` (repeats, n, H, W)."""
    mean = values.mean(axis=0)
    deviation = values - mean
    if relative:
        with np.errstate(divide="ignore", invalid="ignore"):
            deviation = deviation / mean
    shared = np.nanmedian(deviation.reshape(len(values), -1), axis=1)
    return float(np.std(shared, ddof=1))
