"""Sixteen pixels, no two of them as far from the middle: the radius tells which pixel it is, and nothing else."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def strewn_pixels(seed):
    """Gains of pixels differ by 0.15 %; 24 steps that scatter by 0.3 %, which nobody states, of six angles each."""
    rng = np.random.default_rng(seed)
    step, angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(24), np.arange(6), np.arange(16), indexing="ij"))
    azimuth, elevation = 3.0 * np.sqrt(np.arange(16.0)) * np.array([[1.0], [0.4]]) * np.array([[1.0], [-1.0]])
    light = 300.0 + 2400.0 * ((5 * pixel + 7 * angle) % 16) / 16.0
    sigma = np.sqrt(36.0 + 0.25 * light + (0.004 * light) ** 2)
    gain = 0.0015 * rng.normal(size=16)
    return columns_of(pa.table({
        "step": step, "stage_angle_deg": 9.0 * angle, "pixel_u": 64 + pixel * 3 % 16, "pixel_v": pixel % 11,
        "azimuth_deg": azimuth[pixel], "elevation_deg": elevation[pixel],
        "housing_temperature_c": -10.0 + 4.0 * step, "n_frames": np.full(step.size, 10),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": light * (1.0 + gain[pixel]) * (1.0 + 0.003 * rng.normal(size=24)[step])
        + sigma / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_pattern_of_pixels_is_not_taken_for_one_of_their_radius(seed):
    found = diagnose(strewn_pixels(seed))[0].findings
    assert [f.effect for f in found] == ["detector.pixel_response"]
