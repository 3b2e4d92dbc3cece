"""A scanner in a room: what it would see when it is tilted follows from the planes that it sees."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import corrected, left_over, variant_of

from arl_fixtures.reconcile.effects_room import room_of
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

LOW, HIGH = np.array([-3.0, -2.5, -1.2]), np.array([4.0, 2.8, 1.6])
"""Corners of the room about the scanner, metres."""


def ways(ray):
    """Range to the box about the origin along unit rays (3, n), and the cosine of incidence there: slab by slab."""
    ray = np.where(np.abs(ray) < 1e-12, 1e-12, ray)
    reach = np.where(ray > 0.0, HIGH[:, None] / ray, LOW[:, None] / ray)
    wall = np.argmin(reach, axis=0)
    rows = np.arange(ray.shape[1])
    return reach[wall, rows], np.abs(ray[wall, rows])


def turned(ray, yaw, pitch, roll):
    """Ahead, right, up: rolled clockwise, then pitched up, then yawed to the right; matrices of Euler's angles."""
    c, s = np.cos(np.radians([yaw, pitch, roll])), np.sin(np.radians([yaw, pitch, roll]))
    rolled = np.array([[1, 0, 0], [0, c[2], s[2]], [0, -s[2], c[2]]])
    pitched = np.array([[c[1], 0, -s[1]], [0, 1, 0], [s[1], 0, c[1]]])
    yawed = np.array([[c[0], -s[0], 0], [s[0], c[0], 0], [0, 0, 1]])
    return yawed @ pitched @ rolled @ ray


def scanner(seed, tilt=(0.0, 0.0, 0.0), stages=(0.0,), scattered=False):
    """30 rings, 2° apart, with a ray every 2°, or rays anywhere; on a stage that turns the scanner."""
    rng = np.random.default_rng(seed)
    azimuth, elevation, stage, step = (
        a.ravel()
        for a in np.meshgrid(
            np.arange(-180.0, 180.0, 2.0), np.arange(-29.0, 30.0, 2.0), stages, range(2), indexing="ij"
        )
    )
    if scattered:
        azimuth, elevation = rng.uniform(-60.0, 60.0, azimuth.size), rng.uniform(-30.0, 30.0, azimuth.size)
    az, el = np.radians(azimuth), np.radians(elevation)
    ray = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    made = {"azimuth_deg": azimuth, "elevation_deg": elevation, "stage_angle_deg": stage, "step": step.astype(float)}
    on_stage = [np.cos(np.radians(stage)), np.sin(np.radians(stage))]
    for name, angles in (("sim_", (0.0, 0.0, 0.0)), ("", tilt)):
        x, y, z = turned(ray, *angles)
        far, cosine = ways(np.stack([x * on_stage[0] - y * on_stage[1], x * on_stage[1] + y * on_stage[0], z]))
        made[f"{name}distance_m"], made[f"{name}intensity_counts"] = far, 3000.0 * cosine / far**2
    return View(columns_of(pa.table(made)))


@pytest.mark.parametrize(
    ("stages", "scattered"), [((0.0,), False), ((0.0,), True), ((-20.0, 0.0, 30.0), False)],
    ids=["rings", "rays anywhere", "on a stage"],
)  # fmt: skip
def test_a_tilted_scanner_sees_its_planes_from_elsewhere(stages, scattered):
    tilt = {"yaw": 0.15, "pitch": -0.3, "roll": 0.2}
    view = scanner(1, tuple(tilt.values()), stages, scattered)
    state = corrected(view, variant_of(view, "mount.tilt"), **tilt)
    assert left_over(view, state, "distance_m") < 0.05
    assert left_over(view, state, "intensity_counts") < 0.4  # at corners it jumps from wall to wall
    change = np.abs(view.number("distance_m") - view.sim["distance_m"])
    off = np.abs(state["distance_m"] - view.number("distance_m"))
    assert np.mean(off < 0.02 * change + 1e-4) > 0.97


def test_a_camera_has_no_room_and_beams_all_around_have_one_with_numbers_or_without():
    view = scanner(1)
    assert room_of(view, 1.0) is not None
    view.columns.numbers["pixel_v"] = np.rint(view.number("elevation_deg"))
    view.columns.memo.clear()
    assert room_of(view, 1.0) is not None
    whole = view.number("azimuth_deg")
    view.columns.numbers["azimuth_deg"] = 0.4 * whole  # 143°, wider than any lens
    view.columns.memo.clear()
    assert room_of(View(view.columns), 1.0) is not None
    view.columns.numbers["azimuth_deg"] = 0.2 * whole
    assert room_of(View(view.columns), 1.0) is not None  # as remembered of the table
    view.columns.memo.clear()
    assert room_of(View(view.columns), 1.0) is None


def shelves(pitch, seed=4):
    """A room full of shelves: fronts parallel to the walls, each 4° by 6° of them at a depth of its own."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = rng.uniform(-180.0, 180.0, 3000), rng.uniform(-15.0, 15.0, 3000)
    depth = rng.uniform(0.9, 1.0, (90, 6))
    az, el = np.radians(azimuth), np.radians(elevation)
    ray = np.stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    made = {"azimuth_deg": azimuth, "elevation_deg": elevation}
    for name, raised in (("sim_", 0.0), ("", pitch)):
        there = turned(ray, 0.0, raised, 0.0)
        around, up = np.degrees(np.arctan2(there[1], there[0])), np.degrees(np.arcsin(there[2]))
        far, cosine = ways(there)
        front = depth[((around + 180.0) // 4.0).astype(int) % 90, ((up + 18.0) // 6.0).astype(int)]
        level = HIGH[2] / np.maximum(np.abs(np.sin(np.radians(up))), 1e-9) * 0.7 <= far  # floor and ceiling are bare
        made[f"{name}distance_m"] = far * np.where(level, 1.0, front)
        made[f"{name}intensity_counts"] = 3000.0 * cosine / made[f"{name}distance_m"] ** 2
        if name:
            made["incidence_deg"] = np.degrees(np.arccos(cosine))
    return View(columns_of(pa.table(made)))


def test_shelves_lean_no_more_than_their_fronts_are_met():
    """Neighbours on other shelves would have a front lean by what these stand back."""
    view = shelves(-0.02)
    state = corrected(view, variant_of(view, "mount.tilt"), pitch=-0.02)
    change = np.abs(view.number("distance_m") - view.sim["distance_m"])
    off = np.abs(state["distance_m"] - view.number("distance_m"))
    same = change < 0.02  # looks at the same front
    assert np.sqrt(np.mean(off[same] ** 2)) < 0.5 * np.sqrt(np.mean(change[same] ** 2))
