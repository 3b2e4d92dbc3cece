"""A camera before grey boards at two distances: each pixel is seen twice, and its gain is the same both times."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [
    library()[n]
    for n in ("detector.pixel_response", "detector.crosstalk", "optics.vignetting", "detector.dead_pixels")
]  # fmt: skip


def boards(seed, spread):
    rng = np.random.default_rng(seed)
    away, v, u = (a.ravel() for a in np.meshgrid((1.0, 2.8), np.arange(24.0), np.arange(32.0), indexing="ij"))
    gain = 1.0 + spread * rng.normal(size=24 * 32)
    paint = np.array([0.1, 0.3, 0.6, 0.9])[((u // 8 + v // 6) % 4).astype(int)]
    light = 1500.0 * paint / away**2
    sigma = np.hypot(6.0, np.sqrt(light))
    return columns_of(pa.table({
        "true_range_m": away, "pixel_u": u, "pixel_v": v, "reflectance": paint, "n_frames": np.full(u.size, 4.0),
        "sim_amplitude_counts": light, "sim_amplitude_counts_std": sigma,
        "amplitude_counts": light * np.tile(gain, 2) + sigma / 2.0 * rng.normal(size=u.size),
    }))  # fmt: skip


def test_gains_of_pixels_are_found_where_each_is_seen_twice():
    (found,) = diagnose(boards(1, 0.04), effects=KNOWN)[0].findings
    assert found.effect == "detector.pixel_response"
    assert found.parameters[0].value == pytest.approx(0.04, rel=0.35)


def test_equal_pixels_seen_twice_are_no_finding():
    assert not diagnose(boards(2, 0.0), effects=KNOWN)[0].findings
