"""A beam before boards whose light the table's columns tell to a few percent only, and one that leaves the image."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_illumination import illumination
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

NAMES = (
    "beam.profile_shift", "beam.profile_change", "optics.filter_shift", "optics.vignetting", "optics.window_frost",
    "laser.thermal_rolloff",
)  # fmt: skip


def beam(azimuth, elevation):
    return np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)


def heated(seed, *, rough, shift_deg, noise):
    """Means of blocks of pixels before boards at nine temperatures; the beam walks by `shift_deg` per 50 K."""
    rng = np.random.default_rng(seed)
    step, place, angle = (a.ravel() for a in np.meshgrid(np.arange(9), np.arange(60), np.arange(3), indexing="ij"))
    azimuth = rng.uniform(-53.0, 53.0, 60)[place]
    elevation = rng.uniform(-6.5, 12.5, 60)[place]
    board = rng.integers(0, 4, (60, 3))[place, angle]
    far = rng.uniform(1.0, 1.3, (60, 3))[place, angle]
    uneven = np.exp(rough * rng.normal(size=(60, 3)))[place, angle]
    paint = np.array([0.06, 0.18, 0.5, 0.8])[board]
    light = 3000.0 * paint / far**2 * uneven * beam(azimuth, elevation)
    warm = (15.0 * step - 40.0 - 25.0) / 50.0
    moved = beam(azimuth - shift_deg[0] * warm, elevation - shift_deg[1] * warm) / beam(azimuth, elevation)
    error = noise * light
    return columns_of(pa.table({
        "step": step.astype(float), "housing_temperature_c": 15.0 * step - 40.0, "stage_angle_deg": 30.0 * angle,
        "pixel_u": np.round(64.0 + azimuth), "pixel_v": np.round(16.0 - elevation), "azimuth_deg": azimuth,
        "elevation_deg": elevation, "reflectance": paint, "true_range_m": far,
        "surface": np.array(["black", "dark", "grey", "white"])[board], "n_frames": np.full(light.size, 5.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": error,
        "intensity_counts": light * moved + error / np.sqrt(5.0) * rng.normal(size=light.size),
    }))  # fmt: skip


@pytest.mark.parametrize("noise", [0.01, 0.003])
def test_a_beam_that_walks_is_that_alone_and_by_as_much_as_it_does(noise):
    columns = heated(3, rough=0.1, shift_deg=(0.22, 0.22), noise=noise)
    (found,) = diagnose(columns, effects=[library()[name] for name in NAMES])[0].findings
    assert found.effect == "beam.profile_shift"
    told = {p.name: p.value for p in found.parameters}
    assert told["shift_az"] == pytest.approx(0.22 / 50.0, rel=0.2)
    assert told["shift_el"] == pytest.approx(0.22 / 50.0, rel=0.2)


def test_a_beam_that_is_known_exactly_is_known_beyond_the_image():
    view = View(heated(3, rough=0.0, shift_deg=(0.0, 0.0), noise=0.01))
    found = illumination(view, "intensity_counts")
    azimuth, elevation = np.array([0.0, 0.0, 60.0, 70.0]), np.array([0.0, 16.0, 0.0, 15.0])
    told = found.log(azimuth, elevation)
    assert told - told[0] == pytest.approx(np.log(beam(azimuth, elevation)), abs=0.01)
