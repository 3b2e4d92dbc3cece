"""A corner of two boards that light each other, its light summed patch by patch in three dimensions."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_strips import room
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

APEX_M, LONG_M, TALL_M, PAINT = 1.5, 0.9, 0.5, 0.5
KNOWN = (
    "air.multipath", "detector.compression", "detector.pile_up", "target.non_lambertian", "target.reflectance_error",
    "optics.veiling_glare", "timing.range_walk",
)  # fmt: skip
LEAN = np.sqrt(0.5)


def hit(azimuth, elevation, apex=APEX_M):
    """Point, normal and range of rays on the board of their side; boards lean 45 degrees, the corner is far away."""
    side = np.sign(azimuth + 1e-12)
    ray = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1)
    normal = np.stack([-LEAN * np.ones(side.size), -LEAN * side, np.zeros(side.size)], 1)
    far = -LEAN * apex / np.sum(ray * normal, axis=1)
    return far[:, None] * ray, normal, far


def bounced(point, normal, far, side, share, apex=APEX_M, long=LONG_M, tall=TALL_M):
    """Twice-bounced over direct light of points, and the mean extra one-way path of what they send back."""
    along, up = np.meshgrid((np.arange(45) + 0.5) * long / 45, np.linspace(-tall, tall, 41))
    patch = np.stack([apex - LEAN * along.ravel(), LEAN * along.ravel(), up.ravel()], axis=1)
    area = long / 45 * 2.0 * tall / 41
    ratio, longer = np.zeros(len(point)), np.zeros(len(point))
    for k in range(len(point)):
        other = patch * np.array([1.0, -side[k], 1.0])
        facing = np.array([-LEAN, LEAN * side[k], 0.0])
        there = np.linalg.norm(other, axis=1)
        lit = np.maximum(-other @ facing / there, 0.0) / there**2
        way = point[k] - other
        apart = np.linalg.norm(way, axis=1)
        gain = np.maximum(way @ facing / apart, 0.0) * np.maximum(-way @ normal[k] / apart, 0.0)
        gain = share * PAINT * lit * gain * area / (np.pi * (apart**2 + area / np.pi))
        direct = -point[k] @ normal[k] / far[k] ** 3
        ratio[k] = gain.sum() / direct
        longer[k] = np.sum(gain * 0.5 * (there + apart - far[k])) / max(gain.sum(), 1e-12)
    return ratio, longer


def corner(seed, share):
    rng = np.random.default_rng(seed)
    stage, u, v = (
        a.ravel().astype(float)
        for a in np.meshgrid(np.arange(-10.0, 11.0, 5.0), np.arange(0, 40, 2), np.arange(1, 8, 2), indexing="ij")
    )
    azimuth, elevation = (u - 19.3) * 1.3, (3.5 - v) * 1.3
    point, normal, far = hit(np.radians(azimuth + stage), np.radians(elevation))
    direct = -np.sum(point * normal, axis=1) / far**3
    light = 900.0 * direct * np.exp(-((azimuth / 60.0) ** 4))
    ratio, longer = bounced(point, normal, far, np.sign(azimuth + stage), share)
    sigma, blur = np.hypot(2.0, 0.01 * light), np.full(u.size, 0.004)
    noise = rng.normal(size=(2, u.size)) / np.sqrt(10.0)
    return columns_of(pa.table({
        "stage_angle_deg": stage, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth, "elevation_deg": elevation,
        "surface": np.where(azimuth + stage > 0.0, "board_a", "board_b"), "true_range_m": far,
        "incidence_deg": np.degrees(np.arccos(direct * far**2)), "n_frames": np.full(u.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_distance_m": far, "sim_distance_m_std": blur,
        "intensity_counts": light * (1.0 + ratio) + sigma * noise[0],
        "distance_m": far + ratio / (1.0 + ratio) * longer + blur * noise[1],
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [5, 8])
def test_boards_that_light_each_other_are_among_what_is_named(seed):
    """A glare of the image is much like it here: both are most where the boards are far away, and dark."""
    first = diagnose(corner(seed, 0.06), effects=[library()[n] for n in KNOWN])[0].findings[0]
    assert "air.multipath" in {first.effect, *first.equivalent_to}


def test_light_that_bounced_is_most_where_the_boards_meet():
    columns = corner(5, 0.06)
    view = View(columns)
    bearing = columns.numbers["azimuth_deg"] + columns.numbers["stage_angle_deg"]
    share, _ = room(view)
    near, far = np.abs(bearing) < 6.0, np.abs(bearing) > 24.0
    assert share[far].mean() < 0.3 * share[near].mean()


def test_boards_that_do_not_are_no_finding():
    assert not diagnose(corner(6, 0.0), effects=[library()[n] for n in KNOWN])[0].findings


def still(seed, share):
    """A camera that stands still before a corner which fills its image, at three distances."""
    rng, parts = np.random.default_rng(seed), []
    for step, apex in enumerate((1.1, 1.5, 2.0)):
        u, v = (a.ravel().astype(float) for a in np.meshgrid(np.arange(24), np.arange(16), indexing="ij"))
        azimuth, elevation = (u - 11.3) * 3.0, (7.5 - v) * 3.0
        point, normal, far = hit(np.radians(azimuth), np.radians(elevation), apex)
        direct = -np.sum(point * normal, axis=1) / far**3
        light = 2500.0 * direct
        ratio, longer = bounced(point, normal, far, np.sign(azimuth), share, apex, 0.58 * apex, 0.4 * apex)
        sigma, blur = np.hypot(2.0, 0.01 * light), np.full(u.size, 0.004)
        noise, one = rng.normal(size=(2, u.size)) / np.sqrt(10.0), np.ones(u.size)
        parts.append({
            "step": step * one, "stand_off_m": apex * one, "pixel_u": u, "pixel_v": v, "azimuth_deg": azimuth,
            "elevation_deg": elevation, "true_range_m": far, "n_frames": 10.0 * one,
            "incidence_deg": np.degrees(np.arccos(direct * far**2)),
            "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
            "sim_distance_m": far, "sim_distance_m_std": blur,
            "intensity_counts": light * (1.0 + ratio) + sigma * noise[0],
            "distance_m": far + ratio / (1.0 + ratio) * longer + blur * noise[1],
        })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([p[name] for p in parts]) for name in parts[0]}))


def test_a_camera_that_stands_still_sees_them_as_well():
    found = diagnose(still(5, 0.2), effects=[library()[n] for n in KNOWN])[0].findings
    assert [f.effect for f in found] == ["air.multipath"]
    assert found[0].held_out.explained > 0.9
