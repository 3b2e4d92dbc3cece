"""A passband behind a lens whose rays meet it less steeply than the field: one cause of angle and temperature."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[name] for name in ("optics.filter_shift", "beam.profile_change", "optics.vignetting",
         "beam.profile_shift", "laser.thermal_rolloff")]  # fmt: skip


def passed(angle_deg, line_nm, warmer_k=0.0):
    """Light of a line of 1.6 nm through two cavities of 18 nm, chief rays at a quarter of the field angle.

    The cavities grow by 0.025 nm/K.
    """
    centre = 0.025 * warmer_k + 1066.0 * np.sqrt(1.0 - (np.sin(np.radians(angle_deg / 4.0)) / 1.85) ** 2)
    across = np.linspace(-2.0, 2.0, 17)
    weight = np.exp(-0.5 * (across / 0.7) ** 2)
    return sum(
        w / (1.0 + ((line_nm + x - centre) / 9.0) ** 4) for w, x in zip(weight, across, strict=True)
    ) / weight.sum()  # fmt: skip


def camera(seed):
    rng = np.random.default_rng(seed)
    step, place, angle = (x.ravel() for x in np.meshgrid(np.arange(9), np.arange(60), np.arange(4), indexing="ij"))
    pixels = np.random.default_rng(1).uniform([-50.0, -11.0], [50.0, 11.0], (60, 2))
    azimuth, elevation = pixels[place].T
    field = np.degrees(np.arccos(np.cos(np.radians(azimuth)) * np.cos(np.radians(elevation))))
    warm = np.linspace(23.0, 27.4, 9)[step]  # a cooled laser; its housing swings by twenty times as much
    paint = np.array([0.06, 0.2, 0.5, 0.8])[(place + angle) % 4]
    sim = 3600.0 * paint * np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)
    true = sim * passed(field, 1064.0 + 0.07 * (warm - 25.0), 20.0 * (warm - 25.0)) / passed(0.0, 1064.0)
    error = np.sqrt(30.0 + 0.3 * sim)
    return columns_of(pa.table({
        "step": step.astype(float), "stage_angle_deg": 7.0 * angle,
        "azimuth_deg": azimuth, "elevation_deg": elevation,
        "laser_temperature_c": warm, "reflectance": paint, "n_frames": np.full(step.size, 30.0),
        "sim_intensity_counts": sim, "sim_intensity_counts_std": error,
        "intensity_counts": true + error / np.sqrt(30.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_a_filter_that_drifts_where_rays_are_nearly_parallel_is_one_cause():
    (found,) = diagnose(camera(3), effects=KNOWN)[0].findings
    assert found.effect == "optics.filter_shift"
    assert {"laser_temperature_c", "azimuth_deg"} <= set(found.drivers)


def through(angle_deg, line_nm):
    """A line of 4 nm through a passband of 26 nm with flanks of the sixth power, turned by the ray's angle."""
    centre = 910.0 * np.sqrt(1.0 - (np.sin(np.radians(angle_deg)) / 1.8) ** 2)
    across = np.linspace(-5.0, 5.0, 21)
    weight = np.exp(-0.5 * (across / 1.7) ** 2)
    return sum(
        w * np.exp(-np.log(2.0) * ((line_nm + x - centre) / 13.0) ** 6)
        for w, x in zip(weight, across, strict=True)
    ) / weight.sum()  # fmt: skip


def line_camera(seed):
    """Five rows of 30 pixels without rays; the simulation turns the passband, for the line at 33 °C."""
    rng = np.random.default_rng(seed)
    step, v, u = (x.ravel() for x in np.meshgrid(np.arange(9), np.arange(5), np.arange(30), indexing="ij"))
    angle = np.degrees(np.hypot((u - 14.5) / 14.5, (v - 2.0) / 14.5) * 0.55)
    warm = np.linspace(-5.0, 75.0, 9)[step] + rng.normal(0.0, 0.3, 9)[step]
    paint = np.array([0.15, 0.5, 0.8])[(u + v + step) % 3]
    sim = 5000.0 * paint * np.cos(np.radians(angle)) ** 2 * through(angle, 905.0)
    true = sim * through(angle, 905.0 + 0.02 * (warm - 33.0)) / through(angle, 905.0)
    error = np.sqrt(100.0 + sim)
    return columns_of(pa.table({
        "step": step.astype(float), "pixel_u": u, "pixel_v": v, "laser_temperature_c": warm, "reflectance": paint,
        "n_frames": np.full(step.size, 50.0), "sim_intensity_counts": sim, "sim_intensity_counts_std": error,
        "intensity_counts": true + error / np.sqrt(50.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_a_line_that_drifts_behind_a_known_filter_is_told_by_a_few_rows_of_pixels():
    (found,) = diagnose(line_camera(6), effects=KNOWN)[0].findings
    assert found.effect == "optics.filter_shift"
    assert {"laser_temperature_c", "pixel_u"} <= set(found.drivers)
