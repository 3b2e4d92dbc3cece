"""A scanner with a field of view in a room: from beside the axis, at a turned stage, and above corners of a floor."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import corrected, left_over, variant_of

from arl_fixtures.reconcile.effects_room import room_of
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

SIDES = {
    "east": ((1.0, 0.0, 0.0), 3.9, 0.6), "west": ((-1.0, 0.0, 0.0), 3.2, 0.25), "left": ((0.0, 1.0, 0.0), 2.6, 0.7),
    "right": ((0.0, -1.0, 0.0), 3.1, 0.45), "floor": ((0.0, 0.0, -1.0), 1.05, 0.3),
}  # fmt: skip
"""Outward normal, distance from the axis in metres, reflectance."""
NORMALS = np.array([side[0] for side in SIDES.values()])
AWAY = np.array([side[1] for side in SIDES.values()])
SENT = np.array([side[2] for side in SIDES.values()])


def traced(start, ray):
    """Range, light without a profile, and side, of unit rays (n, 3) from points (n, 3): plane by plane."""
    speed = ray @ NORMALS.T
    with np.errstate(divide="ignore"):
        reach = np.where(speed > 1e-9, (AWAY - start @ NORMALS.T) / speed, np.inf)
    side = np.argmin(reach, axis=1)
    rows = np.arange(len(ray))
    far, cosine = reach[rows, side], speed[rows, side]
    return far, SENT[side] * cosine / far**2, side


def scanner(*, forward=0.0, right=0.0, zero=0.0, pitch=0.0, lowest=-12.0, rings=6):
    """Rays of a polygon mirror at 12 stage angles; its receiver sees less towards the ends of the facets."""
    azimuth, elevation, stage = (
        a.ravel()
        for a in np.meshgrid(
            np.arange(-57.0, 58.0, 3.0), np.linspace(lowest, 9.0, rings), np.arange(-165.0, 166.0, 30.0),
            indexing="ij",
        )
    )  # fmt: skip

    def look(offset, aside, raised):
        az, el, on = np.radians(azimuth), np.radians(elevation), np.radians(stage + offset)
        ahead, side, up = np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)
        c, s = np.cos(np.radians(raised)), np.sin(np.radians(raised))
        ahead, up = ahead * c - up * s, up * c + ahead * s
        turn = [np.cos(on), np.sin(on)]
        ray = np.stack([ahead * turn[0] - side * turn[1], ahead * turn[1] + side * turn[0], up], axis=1)
        start = np.stack([aside[0] * turn[0] - aside[1] * turn[1], aside[0] * turn[1] + aside[1] * turn[0],
                          np.zeros(az.size)], axis=1)  # fmt: skip
        return traced(start, ray)

    profile = 20_000.0 * np.exp(-((np.abs(azimuth) / 52.0) ** 4))
    (far, light, side), (seen_far, seen_light, _) = look(0.0, (0.0, 0.0), 0.0), look(zero, (forward, right), pitch)
    names = np.array(list(SIDES))
    return View(columns_of(pa.table({
        "azimuth_deg": azimuth, "elevation_deg": elevation, "stage_angle_deg": stage,
        "step": np.zeros(far.size), "surface": names[side], "reflectance": SENT[side], "true_range_m": far,
        "sim_distance_m": far, "sim_intensity_counts": profile * light,
        "distance_m": seen_far, "intensity_counts": profile * seen_light,
    })))  # fmt: skip


def test_a_scanner_beside_the_axis_sees_planes_from_there():
    view = scanner(forward=1.8e-3, right=-0.7e-3)
    state = corrected(view, variant_of(view, "stage.eccentricity", frame="sensor"), forward=1.8e-3, right=-0.7e-3)
    assert left_over(view, state, "distance_m") < 0.02
    assert left_over(view, state, "intensity_counts") < 0.05


def test_the_light_of_a_turned_stage_is_that_of_planes_under_the_sensors_own_profile():
    view = scanner(zero=0.02)
    state = corrected(view, variant_of(view, "stage.zero_offset", kind="constant"), zero=0.02)
    assert left_over(view, state, "distance_m") < 0.02
    assert left_over(view, state, "intensity_counts") < 0.05


def test_a_floor_of_which_corners_are_seen_lies_as_its_rays_in_other_corners_say():
    view = scanner(pitch=0.1, lowest=-13.8, rings=5)
    floor = view.codes("surface")[0] == view.labels("surface").index("floor")
    assert 0 < floor.sum() < 0.03 * view.n
    room = room_of(view, 1.0)
    assert room.slopes["distance_m"][floor] == pytest.approx(
        np.tile([0.0, 0.0, -1.0 / 1.05], (floor.sum(), 1)), abs=1e-3
    )
    state = corrected(view, variant_of(view, "mount.tilt"), pitch=0.1)
    left = (state["distance_m"] - view.number("distance_m"))[floor]
    change = (view.number("distance_m") - view.sim["distance_m"])[floor]
    assert np.median(np.abs(left / change)) < 0.05
