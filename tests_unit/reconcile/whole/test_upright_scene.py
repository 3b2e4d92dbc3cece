"""A device that is tilted before one flat board, seen by a few scattered pixels: no image row scans the board."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

BOARD_M = 2.0
KNOWN = ("mount.tilt", "timing.row_skew", "beam.profile_shift", "optics.window_contamination", "stage.zero_offset")


def directions(azimuth, elevation, pitch=0.0, roll=0.0):
    """Unit rays of a sensor that is rolled, then pitched up: ahead, right, up."""
    az, el = np.radians(azimuth), np.radians(elevation)
    ahead, right, up = np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    right, up = c * right + s * up, c * up - s * right
    c, s = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
    return c * ahead - s * up, right, c * up + s * ahead


def seen(rays, stage):
    """Range and Lambertian light of rays of a turned sensor on a board that stands ahead."""
    ahead, right, _ = rays
    c, s = np.cos(np.radians(stage)), np.sin(np.radians(stage))
    facing = c * ahead - s * right
    range_m = BOARD_M / facing
    return range_m, 3000.0 * facing / range_m**2


def board_table(seed, pitch, roll):
    rng = np.random.default_rng(seed)
    dut, angle, u, v = (
        a.ravel()
        for a in np.meshgrid(
            np.arange(2), np.arange(-24.0, 25.0, 8.0), np.arange(2, 64, 6), np.arange(0, 16, 2), indexing="ij"
        )
    )
    azimuth, elevation = (u - 31.5) * 1.2, (7.5 - v) * 1.4
    beam = np.exp(-((azimuth / 60.0) ** 4) - (elevation / 20.0) ** 4)
    far, light = seen(directions(azimuth, elevation), angle)
    real_far, real_light = seen(directions(azimuth, elevation, pitch, roll), angle)
    own, noise = dut == 1, rng.normal(size=(2, u.size)) / np.sqrt(20.0)
    sigma_i, sigma_d = np.hypot(4.0, 0.01 * light * beam), np.full(u.size, 0.002)
    return columns_of(pa.table({
        "dut": np.array(["A", "B"])[dut], "stage_angle_deg": angle, "step": np.zeros(u.size), "time_s": 9.0 * angle,
        "pixel_u": 1.0 * u, "pixel_v": 1.0 * v, "azimuth_deg": azimuth, "elevation_deg": elevation,
        "true_range_m": far, "incidence_deg": np.degrees(np.arccos(BOARD_M / far)),
        "n_frames": np.full(u.size, 20.0),
        "sim_intensity_counts": light * beam, "sim_intensity_counts_std": sigma_i,
        "sim_distance_m": far, "sim_distance_m_std": sigma_d,
        "intensity_counts": np.where(own, real_light, light) * beam + sigma_i * noise[0],
        "distance_m": np.where(own, real_far, far) + sigma_d * noise[1],
    }))  # fmt: skip


def test_a_tilt_is_found_where_only_upright_surfaces_are_seen():
    found = diagnose(board_table(3, 0.3, 0.2), effects=[library()[name] for name in KNOWN])[0].findings
    assert [f.effect for f in found] == ["mount.tilt"]
    turned = {p.name: p.value for p in found[0].parameters}
    assert turned["pitch"] == pytest.approx(0.3, abs=0.05)
    assert abs(turned["roll"]) == pytest.approx(0.2, abs=0.1)
