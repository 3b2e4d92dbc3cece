"""Frost of needles, mostly air: a ray goes through the more of it the more aslant it leaves the window."""

import numpy as np

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View
from tests_unit.reconcile.whole.test_frost_of_unrecorded_moisture import iced
from tests_unit.reconcile.whole.test_seldom_names import columns_of, grid

AIRY = 1.08
"""Index of frost of a fifth of ice's density."""


def cycle_of_a_wide_field(depth, seed=5):
    rng = np.random.default_rng(seed)
    temperatures = np.array([40.0, 20.0, 5.0, -8.0, -20.0, -30.0, -20.0, -8.0, 2.0, 10.0, 20.0, 40.0])
    ramps = np.array([-1.0] * 6 + [1.0] * 6)
    ice = iced([-6.0], temperatures, 1500.0)[0]
    step, stop, pixel = grid(np.arange(12), np.arange(5), np.arange(40))
    azimuth, elevation = rng.uniform(-62.0, 62.0, 40)[pixel], rng.uniform(-13.0, 13.0, 40)[pixel]
    axis = np.cos(np.radians(azimuth)) * np.cos(np.radians(elevation))
    path = 1.0 / np.sqrt(1.0 - (1.0 - axis**2) / AIRY**2)  # refracted at the outer face
    light = 900.0 * np.array([0.2, 0.5, 0.8, 0.5, 0.2])[stop] * axis
    noise = np.sqrt(light + 16.0)
    clear = np.exp(-depth * (ice / ice.max())[step] * path)
    return columns_of(
        {
            "cycle": np.ones(step.size), "step": step, "ramp": ramps[step], "set_temperature_c": temperatures[step],
            "housing_temperature_c": temperatures[step] + rng.normal(0.0, 0.1, 12)[step],
            "time_s": 1500.0 * step + 20.0 * stop + 1400.0, "stage_angle_deg": 10.0 * (stop - 2.0),
            "azimuth_deg": azimuth, "elevation_deg": elevation, "pixel_u": pixel,
            "n_frames": np.full(step.size, 20.0),
            "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
            "sim_intensity_counts_repeat_std": 0.003 * light,
            "intensity_counts": light * clear * (1.0 + 0.003 * rng.normal(size=12))[step]
            + rng.normal(0.0, noise / np.sqrt(20.0)),
        },
    )  # fmt: skip


def test_frost_is_thicker_aslant():
    (found,) = diagnose(cycle_of_a_wide_field(0.03))[0].findings
    assert found.effect == "optics.window_frost"
    (slant,) = [p for p in found.parameters if p.name == "slant"]
    assert 0.4 < slant.value < 1.3


def test_every_way_of_a_film_has_a_label_of_its_own():
    """Candidates are kept by their labels: of two alike the search would forget one."""
    ways = library()["optics.window_frost"].variants(View(cycle_of_a_wide_field(0.03)))
    labels = [way.label for way in ways]
    assert len(set(labels)) == len(labels)
