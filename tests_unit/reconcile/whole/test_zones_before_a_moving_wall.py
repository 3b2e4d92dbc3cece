"""Zones that stand still before a wall on a rail: each stand-off is a scene of its own."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def rays(yaw_deg, pitch_deg):
    """Unit vectors of 8 by 8 zones of 45 degrees, x forward, turned about the vertical, then raised."""
    v, u = (a.ravel() for a in np.meshgrid(np.arange(8), np.arange(8), indexing="ij"))
    az, el = np.radians((u - 3.5) * 5.5), np.radians((3.5 - v) * 5.5)
    x = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    yaw, pitch = np.radians(yaw_deg), np.radians(pitch_deg)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    rise = np.array([[np.cos(pitch), 0.0, -np.sin(pitch)], [0.0, 1.0, 0.0], [np.sin(pitch), 0.0, np.cos(pitch)]])
    return u, v, np.degrees(az), np.degrees(el), turn @ rise @ x


def before_the_wall(seed, *, yaw=0.0, pitch=0.0, skew_m=0.0):
    """Sixteen stand-offs, two looks each, ten frames a look; the wall leans by 4 degrees against the rail."""
    rng = np.random.default_rng(seed)
    normal = np.array([np.cos(np.radians(4.0)), np.sin(np.radians(4.0)), 0.0])
    u, v, az, el, straight = rays(0.0, 0.0)
    turned = rays(yaw, pitch)[-1]
    tables = []
    for look in range(32):
        away = 0.3 + 0.14 * (look // 2)
        sim = away * normal[0] / (normal @ straight)
        true = away * normal[0] / (normal @ turned) + skew_m * (v - 3.5)
        sigma = 0.002 + 0.003 * sim
        tables.append({
            "step": np.full(64, look // 2), "time_s": np.full(64, 45.0 * look), "stand_off_m": np.full(64, away),
            "pixel_u": u, "pixel_v": v, "azimuth_deg": az, "elevation_deg": el, "n_frames": np.full(64, 10),
            "sim_distance_m": sim, "sim_distance_m_std": sigma, "sim_distance_m_repeat_std": np.full(64, 0.0005),
            "distance_m": true + 0.0005 * rng.normal() + sigma / np.sqrt(10.0) * rng.normal(size=64),
        })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([t[name] for t in tables]) for name in tables[0]}))


def test_a_turned_module_is_told_by_an_error_that_grows_with_the_stand_off():
    (found,) = diagnose(before_the_wall(21, yaw=0.5))[0].findings
    assert found.effect == "mount.tilt"
    yaw = next(p for p in found.parameters if p.name == "yaw")
    assert abs(yaw.value) == pytest.approx(0.5, abs=0.1)


def test_a_turned_module_and_rows_that_are_late_are_told_apart():
    found = diagnose(before_the_wall(22, yaw=0.5, skew_m=0.0006))[0].findings
    assert sorted(f.effect for f in found) == ["mount.tilt", "timing.row_skew"]


def test_a_module_that_stands_straight_is_consistent():
    assert not diagnose(before_the_wall(23))[0].findings
