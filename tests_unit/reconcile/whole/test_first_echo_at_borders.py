"""A stage that swings before panels, of which the first echo is ranged: what borders tell of light, not of range."""

import numpy as np
import pytest

from arl_fixtures.reconcile.command import reconcile

COLUMNS, PITCH_DEG, SUBRAYS = 16, 2.5, 400
STOPS_DEG = np.arange(-23.0, 23.1, 2.0)
PANELS = ((-22.0, -13.0, 1.30, 0.5), (-5.0, 2.5, 1.25, 0.2), (9.0, 15.5, 1.40, 0.75), (24.0, 33.0, 1.35, 0.3))
"""First and last bearing in degrees, range in metres, reflectance; a wall of a tenth stands 2.6 m away."""


def seen(turned_deg):
    """Light and range of all pixels at stage positions, (stops, pixels) each: rays in a pixel are cast and summed.

    The range is the nearer one's where it gives a twentieth of the light or more: its pulse comes first.
    """
    centres = (np.arange(COLUMNS) - (COLUMNS - 1) / 2) * PITCH_DEG
    across = ((np.arange(SUBRAYS) + 0.5) / SUBRAYS - 0.5) * PITCH_DEG
    bearing = turned_deg[:, None, None] + centres[:, None] + across
    range_m, white = np.full(bearing.shape, 2.6), np.full(bearing.shape, 0.1)
    for first, last, near_m, reflectance in PANELS:
        on = (bearing > first) & (bearing < last)
        range_m[on], white[on] = near_m, reflectance
    light = 1.2e4 * white / range_m**2
    near = np.where(range_m < 2.0, light, 0.0).sum(axis=-1) / light.max(axis=-1) / SUBRAYS
    mean = np.where(range_m < 2.0, range_m, 9.0).min(axis=-1)
    return light.mean(axis=-1), np.where(near > 0.05, mean, 2.6)


def table_of(seed, swing_deg, delay_m_per_k):
    rng = np.random.default_rng(seed)
    steps = 8
    nominal = seen(STOPS_DEG)
    off = swing_deg * np.sin(2.0 * np.pi * STOPS_DEG / 30.0 + 0.7)
    light, range_m = seen(STOPS_DEG + off)
    shape = (steps, len(STOPS_DEG), COLUMNS)
    step, stop, column = (a.ravel() for a in np.indices(shape))
    warm = 10.0 + 6.0 * step + 0.3 * rng.normal(size=steps * len(STOPS_DEG))[step * len(STOPS_DEG) + stop]
    sim_light, sim_range = (np.broadcast_to(a, shape).ravel() for a in nominal)
    sigma, jitter = 1.0 + 0.012 * sim_light, np.full(len(step), 0.004)
    delay = delay_m_per_k * (warm - 30.0)
    return {
        "step": step, "stage_angle_deg": STOPS_DEG[stop], "pixel_u": column, "tof_temperature_c": warm,
        "azimuth_deg": (column - (COLUMNS - 1) / 2) * PITCH_DEG, "n_frames": np.ones(len(step), dtype=int),
        "sim_intensity_counts": sim_light, "sim_intensity_counts_std": sigma,
        "intensity_counts": np.broadcast_to(light, shape).ravel() + sigma * rng.normal(size=len(step)),
        "sim_distance_m": sim_range, "sim_distance_m_std": jitter,
        "sim_distance_m_repeat_std": np.full(len(step), 1e-4),
        "distance_m": np.broadcast_to(range_m, shape).ravel() + delay + jitter * rng.normal(size=len(step)),
    }  # fmt: skip


@pytest.mark.parametrize(("swing_deg", "seed"), [(0.04, 1), (0.08, 2)])
def test_a_swing_and_a_delay_are_both_named(tmp_path, save, swing_deg, seed):
    table = save(tmp_path / "table.parquet", table_of(seed, swing_deg, 6e-5))
    diagnosis = reconcile(table, tmp_path / "out")
    assert {f.effect for f in diagnosis.findings} == {"stage.periodic_error", "timing.temperature_offset"}


def test_a_delay_stands_before_panels_that_stand_still(tmp_path, save):
    table = save(tmp_path / "table.parquet", table_of(3, 0.0, 6e-5))
    assert [f.effect for f in reconcile(table, tmp_path / "out").findings] == ["timing.temperature_offset"]
