"""Five percent of a passband's bell over a wide field: no flank and no index can be told, and none needs to be."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[name] for name in ("optics.filter_shift", "optics.window_contamination", "optics.vignetting",
         "beam.profile_change", "detector.pixel_response")]  # fmt: skip
LINE_NM, REFLECTING, STRENGTH, OFF_NM = 1.2, 0.7, 0.28, -1.5


def stack(angle_deg, off_nm):
    """Light of a laser line through two spaced resonators one after the other, of index 2.05, by Airy's sum."""
    inside = np.sqrt(1.0 - (np.sin(np.radians(angle_deg)) / 2.05) ** 2)
    lines = 940.0 + off_nm + LINE_NM * np.linspace(-2.5, 2.5, 21)
    weight = np.exp(-0.5 * np.linspace(-2.5, 2.5, 21) ** 2)
    phase = np.pi * 6.0 * np.multiply.outer(inside, 940.0 / lines)
    finesse = 4.0 * REFLECTING / (1.0 - REFLECTING) ** 2
    return (weight / (1.0 + finesse * np.sin(phase) ** 2) ** 2).sum(axis=-1) / weight.sum()


def camera(seed):
    """Sixteen by ten pixels of a wide lens before boards of six greys at six steps and four angles."""
    rng = np.random.default_rng(seed)
    step, stop, u, v = (x.ravel() for x in np.meshgrid(np.arange(6), np.arange(4), np.arange(16), np.arange(10),
                        indexing="ij"))  # fmt: skip
    azimuth, elevation = 3.4 * (u - 7.5), 3.4 * (v - 4.5)
    field = np.degrees(np.arccos(np.cos(np.radians(azimuth)) * np.cos(np.radians(elevation))))
    paint = np.array([0.06, 0.12, 0.22, 0.4, 0.65, 0.9])[(u // 3 + 2 * (v // 3) + stop) % 6]
    light = 3200.0 * paint * np.exp(-((field / 38.0) ** 2))
    passed = stack(STRENGTH * field, OFF_NM) / stack(np.zeros(1), OFF_NM)[0]
    noise = np.sqrt(90.0 + 5.0 * light)
    return columns_of(pa.table({
        "step": step.astype(float), "set_temperature_c": 5.0 + 8.0 * step, "stage_angle_deg": 20.0 * stop,
        "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth, "elevation_deg": elevation, "reflectance": paint,
        "n_frames": np.full(step.size, 4.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "intensity_counts": light * passed + noise / 2.0 * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 4])
def test_the_top_of_a_passband_needs_no_more_than_its_place_and_its_tilt(seed):
    (found,) = diagnose(camera(seed), effects=KNOWN)[0].findings
    assert found.effect == "optics.filter_shift"
