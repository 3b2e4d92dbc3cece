"""Interference between the faces of a thin film on the window: rings over the field, which pixels' gains imitate."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

INDEX, THICK_M, WAVE_M, REFLECTED = 1.5, 11e-6, 1064e-9, 0.0018


def through(azimuth, elevation, celsius):
    """Transmission of the film: Airy's sum over the lines of a multimode laser."""
    cosine = np.cos(np.radians(azimuth)) * np.cos(np.radians(elevation))
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / INDEX**2)
    thick, finesse = THICK_M * (1.0 + 3e-5 * (celsius - 25.0)), 4.0 * REFLECTED / (1.0 - REFLECTED) ** 2
    lines = WAVE_M + np.linspace(-1.2e-9, 1.2e-9, 7)
    phase = 2.0 * np.pi * INDEX * (thick * inside)[:, None] / lines
    return np.mean(1.0 / (1.0 + finesse * np.sin(phase) ** 2), axis=1)


def table(seed, filmed):
    """A hundred strewn pixels in ten steps, each of them with a gain of its own that was calibrated to a permille."""
    rng = np.random.default_rng(seed)
    u, v = rng.integers(2, 126, 100), rng.integers(1, 31, 100)
    step, angle, which = (a.ravel() for a in np.meshgrid(np.arange(10), np.arange(-30.0, 31.0, 15.0), np.arange(100)))
    azimuth, elevation = 0.9 * (u[which] - 63.5), 0.8 * (15.5 - v[which])
    celsius = 12.0 * step - 35.0
    light = rng.uniform(150.0, 1500.0, 100)[which] * np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)
    sigma = np.sqrt(36.0 + 0.25 * light)
    real = light * (through(azimuth, elevation, celsius) if filmed else 1.0)
    real *= 1.0 + 4e-3 * rng.normal(size=10)[step] + 3e-4 * rng.normal(size=100)[which]
    return columns_of(pa.table({
        "step": 1.0 * step, "set_temperature_c": celsius, "fpga_temperature_c": celsius + 12.0,
        "stage_angle_deg": angle, "pixel_u": 1.0 * u[which], "pixel_v": 1.0 * v[which],
        "azimuth_deg": azimuth, "elevation_deg": elevation, "n_frames": np.full(step.size, 40.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 4e-3 * light,
        "intensity_counts": real + sigma * rng.normal(size=step.size) / np.sqrt(40.0),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_rings_over_the_field_are_a_law_and_neither_a_pattern_nor_a_spot(seed):
    (found,) = diagnose(table(seed, filmed=True))[0].findings
    assert found.effect == "unknown"
    assert {"azimuth_deg", "elevation_deg"} <= set(found.drivers)
    assert not any(f.effect == "unknown" for f in diagnose(table(seed, filmed=False))[0].findings)
