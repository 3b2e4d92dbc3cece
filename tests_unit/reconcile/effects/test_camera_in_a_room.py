"""A camera on a stage in a room with floor and ceiling: what it sees when it is tilted follows from the planes."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import corrected, left_over, variant_of

from arl_fixtures.reconcile.effects_pointing import changes_elsewhere
from arl_fixtures.reconcile.effects_room import room_of
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

WALLS = (
    ("front", (1.0, 0.0, 0.0), 3.4), ("left", (0.0, -1.0, 0.0), 2.2), ("right", (0.0, 1.0, 0.0), 2.6),
    ("floor", (0.0, 0.0, -1.0), 0.9), ("ceiling", (0.0, 0.0, 1.0), 1.3),
)  # fmt: skip
WIDTH, HEIGHT, FOCAL = 24, 14, 18.0


def lens(across, up):
    """Unit rays (n, 3) of points of the image plane in pixels from its middle: ahead, right, up."""
    ray = np.stack([np.full(across.shape, FOCAL), across, up], axis=-1)
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)


def spun(pitch, roll, stage):
    """The sensor's frame in the room, (n, 3, 3): it rolls, is raised, and is turned by the stage."""

    def about(axis, angle):
        skew = np.cross(np.eye(3), axis)
        rad = np.radians(np.broadcast_to(angle, stage.shape))[:, None, None]
        return np.eye(3) + np.sin(rad) * skew + (1.0 - np.cos(rad)) * (skew @ skew)

    return about((0.0, 0.0, 1.0), stage) @ about((0.0, -1.0, 0.0), pitch) @ about((-1.0, 0.0, 0.0), roll)


def camera(tilt, points, walls=WALLS):
    """Every pixel at nine angles: light and light-weighted range of `points`² rays over its area."""
    u, v, stage = (
        a.ravel().astype(float)
        for a in np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT), np.arange(-40.0, 41.0, 10.0), indexing="ij")
    )
    across, up = u - (WIDTH - 1) / 2, v - (HEIGHT - 1) / 2
    offsets = (np.arange(points) + 0.5) / points - 0.5
    inside = np.array([(a, b) for a in offsets for b in offsets])
    rays = lens(across[:, None] + inside[:, 0], up[:, None] + inside[:, 1])
    axis = lens(across, up)
    made = {
        "pixel_u": u, "pixel_v": v, "stage_angle_deg": stage,
        "azimuth_deg": np.degrees(np.arctan2(axis[:, 1], axis[:, 0])),
        "elevation_deg": np.degrees(np.arcsin(axis[:, 2])),
    }  # fmt: skip
    for name, (pitch, roll) in (("sim_", (0.0, 0.0)), ("", tilt)):
        there = np.einsum("nij,nkj->nki", spun(pitch, roll, stage), rays)
        with np.errstate(divide="ignore"):
            facing = np.stack([there @ np.array(normal) for _, normal, _ in walls], axis=-1)
            far = np.where(facing > 0.0, [away for _, _, away in walls] / facing, np.inf)
        wall = np.argmin(far, axis=-1)
        far, facing = (np.take_along_axis(x, wall[..., None], -1)[..., 0] for x in (far, facing))
        light = 900.0 * np.array([0.5, 0.8, 0.3, 0.15, 0.9])[wall] * facing / far**2
        made[f"{name}distance_m"] = (light * far).sum(axis=1) / light.sum(axis=1)
        made[f"{name}intensity_counts"] = light.mean(axis=1)
        if name:
            made["surface"] = np.array([name for name, _, _ in walls])[wall[:, points**2 // 2]]
    return View(columns_of(pa.table(made)))


@pytest.mark.parametrize(("points", "most"), [(1, 0.1), (5, 0.5)], ids=["sharp rays", "rays over the pixels' areas"])
def test_a_tilted_camera_sees_floor_and_ceiling_from_elsewhere(points, most):
    """Over whole pixels those at edges are left, which no plane tells."""
    view = camera((0.4, 0.13), points)
    state = corrected(view, variant_of(view, "mount.tilt"), yaw=0.0, pitch=0.4, roll=0.13)
    assert np.sqrt(left_over(view, state, "distance_m")) < most
    change = np.abs(view.number("distance_m") - view.sim["distance_m"])
    off = np.abs(state["distance_m"] - view.number("distance_m"))
    assert np.quantile(off, 0.9) < 0.1 * np.quantile(change, 0.9)


def test_what_a_sweep_cannot_tell_of_is_lifted_by_the_curves_beside():
    """Pixels that look the same way see floors of other elevations: their own sweep tells the turn, not the lift."""
    view = camera((0.4, 0.0), 1)
    lift = np.full(view.n, 0.4)
    around = changes_elsewhere(view, 0.0, lift, by_planes=False)["distance_m"]
    turned = changes_elsewhere(view, 1e-3, lift, by_planes=False)["distance_m"]
    assert np.nanmean((turned - around) ** 2) < 0.01 * np.nanmean(around**2)


def test_upright_walls_are_told_by_curves():
    view = camera((0.0, 0.0), 1, walls=WALLS[:3])
    assert room_of(view, 1.0) is None
    view = camera((0.0, 0.0), 1)
    assert room_of(view, 1.0) is not None
