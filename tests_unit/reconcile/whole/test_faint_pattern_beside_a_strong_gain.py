"""What all pixels share, however strong, is no pattern of theirs: rows that are missing make their means differ."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

ASKED = ("electronics.rail_coupling", "detector.pixel_response", "detector.gain_temperature", "laser.power_decay")


def supply_and_pixels(seed, spread):
    """A supply wanders from step to step and takes the light along; pixels are a little unlike; a sixth lacks."""
    rng = np.random.default_rng(seed)
    axes = np.arange(24), np.arange(-10.0, 11.0, 10.0), np.arange(0, 16, 4), np.arange(0, 64, 4)
    step, stage, v, u = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    wander = np.cumsum(rng.normal(size=24))
    rail = (1.0 + 0.006 * (wander - wander.mean()) / wander.std())[step]
    pixels = spread * rng.normal(size=(4, 16))
    unlike = np.exp(pixels)[v // 4, u // 4]
    light = 900.0 * np.cos(np.radians(stage)) * (1.0 + 0.2 * np.cos(0.11 * u + 0.3 * v))
    measured = light * (1.0 + 15.0 * (rail - 1.0)) * unlike
    scatter = np.sqrt(100.0 + light)
    frames = 400.0
    table = {
        "step": step.astype(float), "stage_angle_deg": stage, "pixel_u": u.astype(float), "pixel_v": v.astype(float),
        "rail_1v8_v": 1.8 * rail * (1.0 + 2e-5 * rng.normal(size=24)[step]), "n_frames": np.full(step.size, frames),
        "tof_temperature_c": (30.0 + 10.0 * np.sin(0.3 * np.arange(24)))[step],
        "sim_intensity_counts": light, "sim_intensity_counts_std": scatter,
        "intensity_counts": measured + scatter / np.sqrt(frames) * rng.normal(size=step.size),
    }  # fmt: skip
    kept = rng.random(step.size) > 1.0 / 6.0
    return columns_of(pa.table({name: values[kept] for name, values in table.items()})), float(pixels.std())


@pytest.mark.parametrize(("seed", "spread"), [(1, 8e-4), (3, 0.0)])
def test_pixels_that_are_a_little_unlike_are_told_beside_a_supply_that_wanders(seed, spread):
    columns, size = supply_and_pixels(seed, spread)
    findings = diagnose(columns, effects=[library()[name] for name in ASKED])[0].findings
    named = ["electronics.rail_coupling", "detector.pixel_response"] if spread else ["electronics.rail_coupling"]
    assert [f.effect for f in findings] == named
    if spread:
        assert findings[1].parameters[0].value == pytest.approx(size, rel=0.2)
