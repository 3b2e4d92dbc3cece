"""Interference in an air gap before the lens: as it opens with the temperature, its rings run over the field."""

import numpy as np
import pytest

from arl_fixtures.reconcile.command import reconcile
from tests_unit.reconcile.foretold import share_told

REFLECTED, LINES_M = 0.0012, 905e-9 + np.linspace(-0.6e-9, 0.6e-9, 7)


def through(azimuth_deg, elevation_deg, gap_m):
    """Transmission of the gap: Airy's sum over the lines of a multimode laser."""
    cosine = np.cos(np.radians(azimuth_deg)) * np.cos(np.radians(elevation_deg))
    phase = 2.0 * np.pi * (gap_m * cosine)[:, None] / LINES_M
    finesse = 4.0 * REFLECTED / (1.0 - REFLECTED) ** 2
    return np.mean(1.0 / (1.0 + finesse * np.sin(phase) ** 2), axis=1)


def bench(seed, setpoints_c, gap_um, opens_nm_per_k):
    """A table of pixels at temperatures, and what it would measure without noise."""
    rng = np.random.default_rng(seed)
    u, v = (a.ravel() for a in np.meshgrid(np.arange(4, 124, 6), np.arange(3, 30, 4), indexing="ij"))
    steps, angles = np.arange(len(setpoints_c)), np.arange(-24.0, 25.0, 12.0)
    step, angle, pixel = (a.ravel() for a in np.meshgrid(steps, angles, np.arange(u.size), indexing="ij"))
    azimuth, elevation = 0.9 * (u[pixel] - 63.5), 0.8 * (15.5 - v[pixel])
    housing = (np.asarray(setpoints_c) + rng.normal(0.0, 0.4, len(setpoints_c)))[step]
    gap = 1e-6 * gap_um + 1e-9 * opens_nm_per_k * (housing - 25.0)
    light = 1200.0 * np.exp(-((azimuth / 80.0) ** 4) - (elevation / 20.0) ** 4) * (0.6 + 0.3 * np.cos(angle / 20.0))
    sigma = np.sqrt(36.0 + 0.25 * light)
    true = light * through(azimuth, elevation, gap)
    shared = 1e-3 * rng.normal(size=len(setpoints_c))[step]
    return {
        "step": step, "set_temperature_c": np.asarray(setpoints_c)[step], "housing_temperature_c": housing,
        "stage_angle_deg": angle, "pixel_u": u[pixel], "pixel_v": v[pixel], "azimuth_deg": azimuth,
        "elevation_deg": elevation, "n_frames": np.full(step.size, 40),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 1e-3 * light,
        "intensity_counts": true * (1.0 + shared) + sigma * rng.normal(size=step.size) / np.sqrt(40.0),
    }, true  # fmt: skip


@pytest.mark.parametrize(("seed", "gap_um", "opens_nm_per_k"), [(1, 6.0, 4.0), (2, 9.0, -7.0)])
def test_rings_that_run_are_foretold_at_other_temperatures(tmp_path, save, foretell, seed, gap_um, opens_nm_per_k):
    recorded, _ = bench(seed, np.arange(-30.0, 71.0, 10.0), gap_um, opens_nm_per_k)
    diagnosis = reconcile(save(tmp_path / "table.parquet", recorded), tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["unknown"]
    assert {"azimuth_deg", "elevation_deg", "housing_temperature_c"} <= set(diagnosis.findings[0].drivers)
    unseen, true = bench(seed + 50, np.array([-15.0, 24.0, 46.0]), gap_um, opens_nm_per_k)
    foretold = foretell(unseen, "intensity_counts")
    light = unseen["sim_intensity_counts"]
    gain = float(light @ true) / float(light @ light)  # a calibration takes the mean
    off, left = true / light - gain, foretold / light - true / light
    assert share_told(off, left - left.mean()) > 0.85
