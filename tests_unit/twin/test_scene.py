"""Surfaces: single rays whose hits can be computed by hand."""

import numpy as np
import pytest
from pydantic import ValidationError

from arl_fixtures.twin.scene import CircleGrid, Panel, SceneSettings, Wall, hit_panel, hit_wall

BOARD = Panel(name="board", azimuth_deg=0, width_m=0.56, height_m=0.56, reflectance=0.05, circles=CircleGrid())
AXIS = np.zeros(3)


def ray_through(y, z, x=1.1):
    ray = np.array([x, y, z], dtype=float)
    return (ray / np.linalg.norm(ray)).reshape(3, 1)


def test_a_perpendicular_ray_meets_the_panel_at_its_radius():
    hits = hit_panel(BOARD, 0.0, ray_through(0, 0), AXIS)
    assert hits.range_m[0] == pytest.approx(1.1)
    assert hits.cos_incidence[0] == pytest.approx(1.0)
    assert hits.reflectance[0] == 0.85


@pytest.mark.parametrize(
    ("y", "z", "reflectance"),
    [(0.055, 0, 0.05), (0.11, 0.22, 0.85), (0.11 + 0.034, 0, 0.85), (0.11 + 0.036, 0, 0.05), (0.27, 0.27, 0.05)],
)
def test_circles_lie_at_their_pitch(y, z, reflectance):
    assert hit_panel(BOARD, 0.0, ray_through(y, z), AXIS).reflectance[0] == reflectance


def test_beyond_the_outermost_circle_there_is_no_further_one():
    wide = BOARD.model_copy(update={"width_m": 1.2})
    assert hit_panel(wide, 0.0, ray_through(0.33, 0), AXIS).reflectance[0] == 0.05


def test_rays_miss_beside_above_and_behind():
    for ray in (ray_through(0.281, 0), ray_through(0, -0.281), ray_through(0, 0, x=-1.1)):
        assert hit_panel(BOARD, 0.0, ray, AXIS).range_m[0] == np.inf


def test_the_origin_may_lie_off_the_axis():
    hits = hit_panel(BOARD, 0.0, ray_through(0, 0), np.array([0.1, 0.05, 0.2]))
    assert hits.range_m[0] == pytest.approx(1.0)
    wall = hit_wall(Wall(), ray_through(0, 0), np.array([0.1, 0.8, 0.0]))
    assert wall.range_m[0] == pytest.approx(np.sqrt(1.6**2 - 0.8**2) - 0.1)
    assert wall.cos_incidence[0] == pytest.approx(np.sqrt(1.6**2 - 0.8**2) / 1.6)


def test_the_wall_is_seen_under_the_rays_elevation():
    hits = hit_wall(Wall(), ray_through(0, 1.1), AXIS)
    assert hits.range_m[0] == pytest.approx(1.6 * np.sqrt(2))
    assert hits.cos_incidence[0] == pytest.approx(np.sqrt(0.5))


def test_surface_names_follow_the_numbers():
    assert SceneSettings().surface_names == (
        "wall",
        "stripe_18",
        "stripe_50",
        "stripe_80",
        "intrinsic_left",
        "intrinsic_right",
    )


def test_panels_need_different_names():
    with pytest.raises(ValidationError, match="two panels are called 'board'"):
        SceneSettings(panels=(BOARD, BOARD))
