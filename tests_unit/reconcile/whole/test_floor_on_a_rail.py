"""A rangefinder before a target on a rail: light by way of the floor, and a clock, after an offset was fitted."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

FLOOR_M, MIRROR = 3.0, 0.06
"""Height of the beam above the floor, and what the floor sends on of the light that falls on it."""


def echoes(far):
    """Light and centroid of the pulse that comes back: what went out by the beam returns straight or by the floor."""
    bounced = np.hypot(far, 2.0 * FLOOR_M)  # from the sensor's image below the floor
    time = np.arange(-3.0, 5.0, 0.05)  # metres of path
    straight = np.exp(-0.5 * (time / 0.6) ** 2)[None, :] / far[:, None] ** 2
    late = 0.5 * (bounced - far)[:, None]
    late_light = MIRROR * np.exp(-0.5 * ((time - late) / 0.6) ** 2) / bounced[:, None] ** 2
    whole = straight + late_light
    return whole.sum(axis=1) / straight.sum(axis=1), far + whole @ time / whole.sum(axis=1)


@pytest.mark.parametrize("seed", [1, 2])
def test_light_by_the_floor_and_a_clock_are_told_apart_by_even_strides(seed):
    """A wave a little longer than the stride would look like both, and a clock takes back what the floor does."""
    rng = np.random.default_rng(seed)
    strides = rng.choice(24, 19, replace=False)
    far = np.repeat(9.2 + 6.1 * strides, 60)
    white = np.tile([0.1, 0.4, 0.9], far.size // 3)
    share, seen_at = echoes(far)
    seen_at = seen_at * 1.00058
    light = 8e5 * white / far**2
    sigma_m, sigma = 0.002 * (1.0 + (far / 35.0) ** 2), light * (0.004 + (far / 400.0) ** 2)
    offset = np.average(seen_at - far, weights=1.0 / sigma_m**2)
    gain = np.average(share, weights=(light / sigma) ** 2)
    made = {
        "true_range_m": far, "reflectance": white, "temperature_c": 20.0 + rng.normal(0.0, 3.0, far.size),
        "n_frames": np.full(far.size, 1),
        "sim_distance_m": far + offset, "sim_distance_m_std": sigma_m, "sim_intensity_counts": light * gain,
        "sim_intensity_counts_std": sigma, "distance_m": seen_at + sigma_m * rng.normal(size=far.size),
        "intensity_counts": light * share + sigma * rng.normal(size=far.size),
    }  # fmt: skip
    diagnosis, _, _ = diagnose(columns_of(pa.table(made)))
    assert {f.effect for f in diagnosis.findings} == {"timing.clock_scale", "air.multipath"}
