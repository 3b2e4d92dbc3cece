"""Names and rests of different rows: a gain of whole images beside a wall with stripes that no column tells."""

import numpy as np
from traced_bench import LIGHT

from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.reconcile import diagnose

RAIL_V = 1.8


def regions(*, striped, coupling, seed=3):
    """Regions of a wall, seen at eight angles in eight steps; the real one is striped, which no column tells."""
    rng = np.random.default_rng(seed)
    step, stage, v, u = (
        a.ravel().astype(float) for a in np.meshgrid(*(np.arange(n) for n in (8, 8, 4, 8)), indexing="ij")
    )
    image = (8 * step + stage).astype(int)
    rail = RAIL_V + 0.012 * rng.normal(size=64)[image]
    bearing = 5.0 * u - 17.5 + 4.0 * stage - 14.0
    sim = 600.0 * np.cos(np.radians(bearing)) ** 0.5
    error = np.sqrt(36.0 + 0.25 * sim)
    real = sim * (1.0 + striped * np.sin(2.0 * np.pi * bearing / 11.0)) * (rail / RAIL_V) ** coupling
    numbers = {
        "step": step, "stage_angle_deg": 4.0 * stage - 14.0, "pixel_u": u, "pixel_v": v,
        "azimuth_deg": 5.0 * u - 17.5,
        "elevation_deg": 4.0 * v - 6.0, "time_s": 900.0 * step + 40.0 * stage, "rail_1v8_v": rail,
        "housing_temperature_c": 10.0 * step, "n_frames": np.full(step.size, 10.0), f"sim_{LIGHT}": sim,
        f"sim_{LIGHT}_std": error, LIGHT: real + error / np.sqrt(10.0) * rng.normal(size=step.size),
    }  # fmt: skip
    return Columns(n=step.size, numbers=numbers, categories={}, channels=find_channels(set(numbers)))


def test_a_gain_of_whole_images_stands_beside_a_rest_within_them():
    names = [f.effect for f in diagnose(regions(striped=0.01, coupling=0.25))[0].findings]
    assert "electronics.rail_coupling" in names
    assert "unknown" in names
