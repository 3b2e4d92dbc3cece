"""A line of zones before a wall: range and cosine go with the angle, and so does the beam that points elsewhere."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

AZIMUTH = np.linspace(-31.0, 31.0, 12)
WALL_M, STEPS = 1.5, 24


def flood(azimuth):
    """Far field of emitters behind a diffuser that spreads each over 68 degrees: a sum over emitters."""
    emitters = np.arange(-12.0, 12.01, 0.25)
    weight = np.cos(np.pi * emitters / 26.0) ** 2
    fans = np.abs(azimuth[..., None] - emitters) < 34.0
    return fans @ weight / weight.sum()


def zones(seed, deg_per_k):
    """Light of zones 2.6 degrees wide, over steps of housing temperature."""
    rng = np.random.default_rng(seed)
    celsius = rng.permutation(np.linspace(-15.0, 75.0, STEPS))
    step, zone = (x.ravel() for x in np.meshgrid(np.arange(STEPS), np.arange(AZIMUTH.size), indexing="ij"))
    within = np.linspace(-1.3, 1.3, 27)

    def light(shift):
        rays = AZIMUTH[zone][:, None] + within
        far = WALL_M / np.cos(np.radians(rays))
        lit = flood(rays - shift[:, None]) * np.cos(np.radians(rays))
        return 4000.0 * (lit / far**2).mean(axis=1)

    sim, true = light(np.zeros(step.size)), light(deg_per_k * (celsius[step] - 25.0))
    noise = np.sqrt(40.0 + 0.4 * sim)
    frames = 25.0
    return columns_of(pa.table({
        "step": step.astype(float), "azimuth_deg": AZIMUTH[zone],
        "true_range_m": WALL_M / np.cos(np.radians(AZIMUTH[zone])),
        "housing_temperature_c": celsius[step] + 0.05 * rng.normal(size=step.size),
        "n_frames": np.full(step.size, frames),
        "sim_intensity_counts": sim, "sim_intensity_counts_std": noise,
        "intensity_counts": true + noise / np.sqrt(frames) * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_flood_that_turns_with_the_housing_is_named_before_a_wall(seed):
    findings = diagnose(zones(seed, 0.02))[0].findings
    assert [f.effect for f in findings] == ["beam.profile_shift"]
    assert findings[0].drivers[:1] == ["housing_temperature_c"]


def test_a_flood_that_stays_is_no_mismatch():
    assert diagnose(zones(3, 0.0))[0].findings == []
