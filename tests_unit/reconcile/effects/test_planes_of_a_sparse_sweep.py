"""Rays that start beside the axis, traced to the surfaces, against what the tool makes of a sweep of few pixels."""

import numpy as np
import pytest
from rendered_bench import make_columns, variant_of

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.view import View

BOARDS = ((0.0, 1.1, 0.42), (-45.0, 1.485, 0.30), (45.0, 1.485, 0.30))
"""Bearing of the normal in degrees, distance and half width in metres."""
WALL_M = 3.2


def trace(bearing, elevation, along=0.0, across=0.0):
    """Range and surface (−1 the round wall about the axis) of rays, degrees, from a point in the room, metres."""
    b, e = np.radians(bearing), np.radians(elevation)
    far = np.sqrt(WALL_M**2 - (along * np.sin(b) - across * np.cos(b)) ** 2) - along * np.cos(b) - across * np.sin(b)
    level, seen = far, np.full(b.shape, -1)
    for k, (normal, distance, half) in enumerate(BOARDS):
        n = np.radians(normal)
        cosine = np.cos(b - n)
        with np.errstate(divide="ignore"):
            reach = (distance - along * np.cos(n) - across * np.sin(n)) / cosine
        x, y = along + reach * np.cos(b), across + reach * np.sin(b)
        hit = (cosine > 0.0) & (np.abs(y * np.cos(n) - x * np.sin(n)) < half) & (reach < level)
        level, seen = np.where(hit, reach, level), np.where(hit, k, seen)
    return level / np.cos(e), seen


@pytest.fixture
def bench():
    """Twelve pixels five degrees apart in each of four rows, on a stage that goes in steps of three degrees."""
    stage, u, v = (
        a.ravel() for a in np.meshgrid(np.arange(-30.0, 31.0, 3.0), np.arange(12), np.arange(4), indexing="ij")
    )
    azimuth, elevation = 4.7 * (u - 5.5), 4.0 * (v - 1.5)
    half = 0.235
    distance, seen = trace(azimuth + stage, elevation)
    mixed = np.any([trace(azimuth + stage + way * half, elevation)[1] != seen for way in (-1.0, 1.0)], axis=0)
    numbers = {
        "stage_angle_deg": stage, "pixel_u": 10.0 * u, "pixel_v": 9.0 * v, "azimuth_deg": azimuth,
        "elevation_deg": elevation, "sim_distance_m": distance, "true_range_m": distance,
    }  # fmt: skip
    numbers["distance_m"] = distance.copy()
    names = {
        "surface": [("wall", "middle", "left", "right")[k + 1] for k in seen],
        "mixed": [str(m).lower() for m in mixed],
    }
    return View(make_columns(numbers, names, shuffle=None)[0]), mixed, azimuth, elevation, stage


@pytest.mark.parametrize(("forward_mm", "right_mm"), [(0.7, 1.6), (-2.0, 0.5)])
def test_an_eccentric_sensor_ranges_the_surfaces_from_where_it_is(bench, forward_mm, right_mm):
    view, mixed, azimuth, elevation, stage = bench
    f, r, turned = 1e-3 * forward_mm, 1e-3 * right_mm, np.radians(stage)
    along, across = f * np.cos(turned) - r * np.sin(turned), f * np.sin(turned) + r * np.cos(turned)
    real, _ = trace(azimuth + stage, elevation, along, across)
    effect = library()["stage.eccentricity"]
    state = view.fresh_state()
    effect.apply(variant_of(view, effect.id, frame="sensor"), {"forward": f, "right": r}, state, view)
    error = np.abs(state["distance_m"] - real)[~mixed]
    assert np.quantile(error, 0.95) < 0.03 * np.hypot(f, r)
    assert np.max(error) < 0.15 * np.hypot(f, r)
