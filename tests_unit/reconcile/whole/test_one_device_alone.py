"""Another device's lamp that shines into one device, at some angles of its stage: the others never see it."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

DEVICES, STEPS, FRAMES = ("K1", "K2", "K3"), 2, 10
U, V = (a.ravel() for a in np.meshgrid(np.arange(32), np.arange(12), indexing="ij"))
AZIMUTH, ELEVATION = 1.2 * (U - 15.5), 1.2 * (V - 5.5)
STOPS = np.linspace(-24.0, 24.0, 13)
BOARDS = ((-28.0, 8.0, 0.7), (-6.0, 6.0, 0.2), (15.0, 7.0, 0.5), (34.0, 6.0, 0.9))
"""Bearing of the middle and half width in degrees, and reflectance."""


def paint(bearing):
    """Reflectance seen at a bearing, degrees."""
    white = np.full(bearing.shape, 0.3)
    for middle, half, value in BOARDS:
        white = np.where(np.abs(bearing - middle) < half, value, white)
    return white


def campaign(seed, stray):
    """Three devices; into the second a lamp shines that stands to its right, most as the stage turns it that way."""
    rng = np.random.default_rng(seed)
    parts = []
    for device in DEVICES:
        for step in range(STEPS):
            gain = 1.0 + 0.004 * rng.normal()
            current, rail, ambient = 90.0 + 0.1 * rng.normal(), 5.0 + 0.01 * rng.normal(), 23.0 + 0.3 * rng.normal()
            for stop in STOPS:
                light = 1800.0 * paint(AZIMUTH + stop) * np.exp(-((AZIMUTH / 24.0) ** 2) - (ELEVATION / 16.0) ** 2)
                off = np.hypot(AZIMUTH - 12.0, 0.5 * ELEVATION) / 7.0
                reached = np.clip(np.cos(np.radians(6.0 * (stop - 10.0))), 0.0, None) ** 8 / (1.0 + off**2) ** 2
                seen = gain * light + stray * reached * (device == "K2")
                noise = np.sqrt(40.0 + light)
                one = np.ones(U.size)
                parts.append({
                    "dut": np.full(U.size, device), "step": step * one, "time_s": (900.0 * step + stop) * one,
                    "stage_angle_deg": stop * one, "pixel_u": U, "pixel_v": V, "azimuth_deg": AZIMUTH,
                    "elevation_deg": ELEVATION, "n_frames": FRAMES * one, "set_temperature_c": 30.0 * step * one,
                    "laser_current_a": current * one, "rail_5v0_v": rail * one,
                    "ambient_temperature_c": ambient * one,
                    "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
                    "sim_intensity_counts_repeat_std": 0.004 * light,
                    "intensity_counts": seen + noise / np.sqrt(FRAMES) * rng.normal(size=U.size),
                })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([p[name] for p in parts]) for name in parts[0]}))


def test_what_one_device_sees_at_some_angles_is_found_though_all_together_hardly_show_it():
    (found,) = diagnose(campaign(5, stray=8.0), effects=[])[0].findings
    assert {"dut", "stage_angle_deg"} <= set(found.drivers)
    low, high = found.where["stage_angle_deg"]
    assert 4.0 <= low <= 10.0 <= high <= 20.0


def test_three_devices_that_differ_by_their_steps_alone_are_consistent():
    assert diagnose(campaign(5, stray=0.0), effects=[])[0].findings == []
