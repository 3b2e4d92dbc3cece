"""The twin as a reference: what relative metrics refer to until a step of the DUT itself has been recorded."""

from __future__ import annotations

from typing import Final

import numpy as np

from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import Geometry
from arl_fixtures.metrics.reference import Reference
from arl_fixtures.metrics.registry import remember
from arl_fixtures.metrics.statistics import SweepSummary
from arl_fixtures.metrics.step import StepData
from arl_fixtures.twin.expected import Expected
from arl_fixtures.twin.noise import predicted, scatter

AS_IF_FRAMES: Final = 255
"""The twin's mean has no noise; the frames behind it are given as the most that a summary can hold."""


def nominal_sweep(geometry: Geometry) -> SweepSummary:
    """A sweep as the twin expects it: noise-free means, and the noise model's variances.

    Args:
        geometry: of the DUT at the angles wanted.
    """
    noise = geometry.dut.noise
    spreads = [predicted(scatter(_expected(geometry, k), noise), noise) for k in range(len(geometry.stage_angle_deg))]
    count = len(spreads)
    shape = geometry.intensity_counts.shape
    returns = np.stack([spread.returns for spread in spreads]).astype(np.uint8) * np.uint8(AS_IF_FRAMES)
    return SweepSummary(
        dut=geometry.dut.serial,
        stage_angle_deg=geometry.stage_angle_deg,
        angle_index=np.arange(count, dtype=np.int64),
        time_ns=np.zeros(count, dtype=np.int64),
        frames=np.full(count, AS_IF_FRAMES, dtype=np.int64),
        arrived=np.full(shape, AS_IF_FRAMES, dtype=np.uint8),
        intensity_returns=returns,
        distance_returns=returns,
        constant=np.zeros(shape, dtype=np.bool_),
        intensity_counts=np.stack([spread.intensity_counts for spread in spreads]),
        distance_m=np.stack([spread.distance_m for spread in spreads]),
        intensity_variance=np.stack([spread.intensity_std_counts for spread in spreads]) ** 2,
        distance_variance=np.stack([spread.distance_std_m for spread in spreads]) ** 2,
        intensity_common_variance=np.zeros(count),
        intensity_common_floor=np.zeros(count),
        distance_common_variance=np.zeros(count),
        distance_common_floor=np.zeros(count),
        second_returns=0,
        operating={},
    )


def nominal_reference(geometry: Geometry) -> Reference:
    """A reference made from the DUT file alone.

    Changes against it hold whatever the file does not know of the unit (its pixels' response, its true K), so it
    serves until the DUT's own reference step has been recorded.
    """
    step = StepData(
        dut=geometry.dut,
        conditions=Conditions(set_temperature_c=25.0),
        sweep=nominal_sweep(geometry),
        geometry=geometry,
    )
    return remember(step, f"twin of {geometry.dut.serial}")


def _expected(geometry: Geometry, k: int) -> Expected:
    dead = np.zeros(geometry.intensity_counts.shape[1:], dtype=bool)
    for u, v in geometry.dut.dead_pixels:
        if u < geometry.dut.columns and v < geometry.dut.rows:
            dead[v, u] = True
    return Expected(
        stage_angle_deg=float(geometry.stage_angle_deg[k]),
        intensity_counts=geometry.intensity_counts[k],
        distance_m=geometry.distance_m[k],
        surface=geometry.surface[k],
        mixed=geometry.mixed[k],
        true_range_m=geometry.true_range_m[k],
        incidence_deg=np.degrees(np.arccos(geometry.cos_incidence[k])),
        reflectance=geometry.reflectance[k],
        azimuth_deg=geometry.azimuth_deg.astype(np.float32),
        elevation_deg=geometry.elevation_deg.astype(np.float32),
        dead=dead,
    )
