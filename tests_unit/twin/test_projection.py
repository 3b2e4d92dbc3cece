"""The rational model against OpenCV's forward projection, its analytic inverse, and itself."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.twin.projection import (
    Intrinsics,
    azimuth_elevation,
    distort,
    pixel_rays,
    project,
    undistort,
)

NOMINAL = Intrinsics()
GENERAL = Intrinsics(
    fx=63.0, fy=65.0, cx=62.8, cy=15.9, k1=0.05, k2=-0.01, p1=0.003, p2=-0.002, k3=0.001, k4=0.21, k5=0.01
)


def pixel_grid(columns=128, rows=32, margin=0.0):
    return np.meshgrid(np.linspace(-margin, columns - 1 + margin, 65), np.linspace(-margin, rows - 1 + margin, 33))


def test_inverse_is_the_analytic_one_for_k4_alone():
    u, v = pixel_grid()
    xd, yd = (u - NOMINAL.cx) / NOMINAL.fx, (v - NOMINAL.cy) / NOMINAL.fy
    rho2 = xd**2 + yd**2
    exact = 2 / (1 + np.sqrt(1 - 4 * NOMINAL.k4 * rho2))
    x, y = undistort(NOMINAL, xd, yd)
    assert np.max(np.abs(x - xd * exact)) < 1e-9
    assert np.max(np.abs(y - yd * exact)) < 1e-9


@pytest.mark.parametrize("intrinsics", [NOMINAL, GENERAL], ids=["nominal", "general"])
def test_projection_is_opencvs(intrinsics):
    rng = np.random.default_rng(1)
    directions = np.column_stack([rng.uniform(-1.5, 1.5, 500), rng.uniform(-0.3, 0.3, 500), np.ones(500)])
    theirs, _ = cv2.projectPoints(directions, np.zeros(3), np.zeros(3), intrinsics.matrix, intrinsics.distortion)
    assert np.max(np.abs(project(intrinsics, directions) - theirs[:, 0])) < 1e-9


@pytest.mark.parametrize("intrinsics", [NOMINAL, GENERAL], ids=["nominal", "general"])
def test_rays_project_back_onto_their_pixels_through_opencv(intrinsics):
    u, v = pixel_grid()
    rays = pixel_rays(intrinsics, u, v).reshape(-1, 3)
    pixels, _ = cv2.projectPoints(
        rays / rays[:, 2:], np.zeros(3), np.zeros(3), intrinsics.matrix, intrinsics.distortion
    )
    assert np.max(np.abs(pixels[:, 0] - np.column_stack([u.ravel(), v.ravel()]))) < 1e-6


def test_rays_hold_slightly_beyond_the_image():
    wide = NOMINAL.model_copy(update={"k4": 0.18})
    u, v = pixel_grid(margin=1.0)
    pixels = project(wide, pixel_rays(wide, u, v))
    assert np.max(np.abs(pixels - np.stack([u, v], axis=-1))) < 1e-6


def test_beyond_the_fold_the_ray_stays_at_the_fold():
    fold = 1 / np.sqrt(NOMINAL.k4)
    x, y = undistort(NOMINAL, np.array([1.3, 2.0]), np.array([0.3, -0.1]))
    assert np.hypot(x, y) == pytest.approx([fold, fold], rel=1e-6)
    assert y / x == pytest.approx([0.3 / 1.3, -0.05])


def test_beyond_the_fold_of_a_general_model_no_ray_wanders_off():
    folded = GENERAL.model_copy(update={"k4": 0.28})
    u, v = pixel_grid()
    wanted = np.stack([u - folded.cx, v - folded.cy], axis=-1)
    seen = project(folded, pixel_rays(folded, u, v)) - (folded.cx, folded.cy)
    beyond = np.linalg.norm(seen - wanted, axis=-1) > 1e-6
    assert 0.01 < beyond.mean() < 0.2
    bearing = np.arctan2(seen[..., 1], seen[..., 0]) - np.arctan2(wanted[..., 1], wanted[..., 0])
    assert np.max(np.abs(np.degrees(bearing[beyond]))) < 1.0
    assert np.all(np.linalg.norm(seen, axis=-1)[beyond] < np.linalg.norm(wanted, axis=-1)[beyond])


def test_the_nominal_field_of_view_is_the_sensors():
    azimuth, elevation = azimuth_elevation(pixel_rays(NOMINAL, np.array([127.0, 63.5]), np.array([15.5, 0.0])))
    assert np.degrees(azimuth[0]) == pytest.approx(60.59, abs=0.01)
    assert np.degrees(elevation[1]) == pytest.approx(13.36, abs=0.01)


@settings(max_examples=60, deadline=None)
@given(
    k1=st.floats(-0.05, 0.05),
    k2=st.floats(-0.01, 0.01),
    p1=st.floats(-0.005, 0.005),
    p2=st.floats(-0.005, 0.005),
    k4=st.floats(0.0, 0.19),
    x=st.floats(-1.4, 1.4),
    y=st.floats(-0.3, 0.3),
)
def test_undistort_inverts_distort(k1, k2, p1, p2, k4, x, y):
    intrinsics = Intrinsics(k1=k1, k2=k2, p1=p1, p2=p2, k4=k4)
    back = undistort(intrinsics, *distort(intrinsics, np.array([x]), np.array([y])))
    assert back[0][0] == pytest.approx(x, abs=1e-7)
    assert back[1][0] == pytest.approx(y, abs=1e-7)


def test_a_pole_of_the_model_ends_the_field():
    barrel = Intrinsics(k4=-0.5)
    x, y = undistort(barrel, np.array([0.5, 0.0]), np.array([0.0, 0.0]))
    assert distort(barrel, x, y)[0] == pytest.approx([0.5, 0.0], abs=1e-12)
