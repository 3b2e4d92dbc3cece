"""A worm turns round within three stops of a sweep: it shows as long as its period is more than two of them."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[f"stage.{name}"] for name in ("eccentricity", "periodic_error", "zero_offset")]
STOP_DEG = 4.5


def shade(bearing_deg):
    """Light of a wall with soft stains, over the bearing."""
    places = np.random.default_rng(1).uniform(-110.0, 110.0, 40)
    return 400.0 + sum(250.0 * np.exp(-(((bearing_deg - place) / 5.0) ** 2)) for place in places)


def swept(seed, period_deg, swing_deg):
    rng = np.random.default_rng(seed)
    axes = np.meshgrid(range(5), np.arange(-54.0, 54.1, STOP_DEG), range(16), indexing="ij")
    step, stop, u = (axis.ravel() for axis in axes)
    azimuth = 2.0 * (u - 7.5)
    true = stop + swing_deg * np.sin(2.0 * np.pi * stop / period_deg + 0.8)
    light, seen = shade(stop + azimuth), shade(true + azimuth)
    sigma = np.sqrt(36.0 + 0.3 * light)
    own = 0.002 * rng.normal(size=5)[step]
    return columns_of(pa.table({
        "step": 1.0 * step, "set_temperature_c": 15.0 * step - 10.0, "stage_angle_deg": stop, "pixel_u": 1.0 * u,
        "azimuth_deg": azimuth, "n_frames": np.full(u.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.002 * light,
        "intensity_counts": seen * (1.0 + own) + sigma * rng.normal(size=u.size) / np.sqrt(10.0),
    }))  # fmt: skip


def test_a_swing_within_three_stops_is_named_with_its_period():
    (found,) = diagnose(swept(5, 12.1, 0.05), effects=KNOWN)[0].findings
    assert found.effect == "stage.periodic_error"
    (told,) = [p for p in found.parameters if p.name == "period"]
    assert told.low < 12.1 < told.high
    assert told.high - told.low < 0.5
