"""Expected frames against golden ones, and against a ray tracer that works differently.

The tracer below turns the DUT in the chamber (the package turns the scene), finds rays by solving OpenCV's forward
projection, and traces them one by one.
"""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.optimize
from processor_time import processor_s

from arl_fixtures.twin.beam import PowerPatch
from arl_fixtures.twin.frame import Renderer, to_stage
from arl_fixtures.twin.projection import Intrinsics
from arl_fixtures.twin.scene import CircleGrid, Panel, SceneSettings, Wall
from arl_fixtures.twin.settings import DutSettings, Mount

GOLDEN = Path(__file__).parents[3] / "shared" / "golden" / "nominal_v1.npz"
DUT = DutSettings(serial="T-1")


def ray_by_opencv(intrinsics, u, v):
    """The direction that OpenCV's forward projection puts at (u, v)."""

    def miss(xy):
        point = np.array([[xy[0], xy[1], 1.0]])
        pixel, _ = cv2.projectPoints(point, np.zeros(3), np.zeros(3), intrinsics.matrix, intrinsics.distortion)
        return pixel[0, 0] - (u, v)

    guess = ((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy)
    found = scipy.optimize.root(miss, guess, tol=1e-12)
    assert np.abs(miss(found.x)).max() < 1e-9
    ray = np.array([*found.x, 1.0])
    return ray / np.linalg.norm(ray)


def rotation_z(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def trace(scene, origin, ray):
    """Nearest surface: (range, cosine of incidence, reflectance, number)."""
    a = ray[0] ** 2 + ray[1] ** 2
    b = 2 * (origin[0] * ray[0] + origin[1] * ray[1])
    c = origin[0] ** 2 + origin[1] ** 2 - scene.wall.radius_m**2
    distance = (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)
    hit = origin + distance * ray
    normal = np.array([hit[0], hit[1], 0]) / scene.wall.radius_m
    best = (distance, float(normal @ ray), scene.wall.reflectance, 0)
    for number, panel in enumerate(scene.panels, start=1):
        azimuth = math.radians(panel.azimuth_deg)
        normal = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        across = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        centre = panel.radius_m * normal + np.array([0, 0, panel.centre_z_m])
        cosine = float(ray @ normal)
        if cosine <= 0:
            continue
        distance = float((centre - origin) @ normal) / cosine
        offset = origin + distance * ray - centre
        s, z = float(offset @ across), float(offset[2])
        if abs(s) > panel.width_m / 2 or abs(z) > panel.height_m / 2 or distance >= best[0]:
            continue
        reflectance = panel.reflectance
        if panel.circles:
            grid = panel.circles
            for i in range(grid.columns):
                for j in range(grid.rows):
                    ci = (i - (grid.columns - 1) / 2) * grid.pitch_m
                    cj = (j - (grid.rows - 1) / 2) * grid.pitch_m
                    if (s - ci) ** 2 + (z - cj) ** 2 <= grid.radius_m**2:
                        reflectance = grid.reflectance
        best = (distance, cosine, reflectance, number)
    return best


def brute_force(dut, scene, stage_angle_deg, u, v):
    """One pixel: (intensity, distance, surface, mixed)."""
    turn = rotation_z(-math.radians(stage_angle_deg))
    mount = dut.mount
    origin = turn @ np.array([mount.forward_m, mount.left_m, dut.height_m])
    to_chamber = turn @ to_stage(mount)
    weights, ranges, surfaces = [], [], []
    for du in (-1 / 3, 0, 1 / 3):
        for dv in (-1 / 3, 0, 1 / 3):
            ray = to_chamber @ ray_by_opencv(dut.intrinsics, u + du, v + dv)
            distance, cosine, reflectance, number = trace(scene, origin, ray)
            weights.append(reflectance * cosine * (dut.reference_range_m / distance) ** 2)
            ranges.append(distance)
            surfaces.append(number)
    x, y, z = ray_by_opencv(dut.intrinsics, u, v)
    alpha, beta = math.degrees(math.atan2(x, z)), -math.degrees(math.asin(y))
    beam = dut.beam
    power = math.exp(
        -(abs((alpha - beam.azimuth_shift_deg) / beam.azimuth_half_width_deg) ** beam.exponent)
        - abs((beta - beam.elevation_shift_deg) / beam.elevation_half_width_deg) ** beam.exponent
    )
    total = sum(weights)
    intensity = dut.full_scale_counts * dut.gain * power * total / 9 + dut.offset_counts
    return (
        intensity,
        sum(w * r for w, r in zip(weights, ranges, strict=True)) / total,
        surfaces[4],
        len(set(surfaces)) > 1,
    )


ODD_DUT = DutSettings(
    serial="T-2",
    height_m=0.07,
    gain=0.9,
    offset_counts=12.0,
    mount=Mount(yaw_deg=1.3, pitch_deg=-2.0, roll_deg=4.0, forward_m=0.03, left_m=-0.02),
    intrinsics=Intrinsics(fx=57.0, fy=65.0, cx=62.8, cy=15.9, k1=0.02, p1=0.002, p2=-0.001, k4=0.2),
)
ODD_SCENE = SceneSettings(
    panels=(
        Panel(name="far", azimuth_deg=10, radius_m=1.4, width_m=0.8, height_m=0.5, reflectance=0.3, centre_z_m=0.1),
        Panel(name="near", azimuth_deg=14, radius_m=0.9, width_m=0.2, height_m=0.2, reflectance=0.7),
        Panel(
            name="even",
            azimuth_deg=-50,
            width_m=0.6,
            height_m=0.4,
            reflectance=0.1,
            circles=CircleGrid(columns=4, rows=2, pitch_m=0.15, radius_m=0.05, reflectance=0.9),
        ),
    ),
    wall=Wall(radius_m=2.0, reflectance=0.1),
)


@pytest.mark.parametrize(
    ("dut", "scene", "stage_angle_deg"),
    [
        (DUT, SceneSettings(), 3.7),
        (DUT, SceneSettings(), -44.9),
        (ODD_DUT, ODD_SCENE, -11.3),
        (ODD_DUT, ODD_SCENE, 48.2),
    ],
)
def test_agrees_with_a_brute_force_ray_tracer(dut, scene, stage_angle_deg):
    expected = Renderer(dut, scene).expected(stage_angle_deg)
    rng = np.random.default_rng(5)
    pixels = [(int(u), int(v)) for u, v in zip(rng.integers(2, 126, 90), rng.integers(1, 31, 90), strict=True)]
    surfaces = set()
    for u, v in pixels:
        intensity, distance, surface, mixed = brute_force(dut, scene, stage_angle_deg, u, v)
        surfaces.add(surface)
        assert expected.surface[v, u] == surface, (u, v)
        assert expected.mixed[v, u] == mixed, (u, v)
        assert expected.intensity_counts[v, u] == pytest.approx(intensity, abs=0.02), (u, v)
        assert expected.distance_m[v, u] == pytest.approx(distance, abs=1e-5), (u, v)
    assert len(surfaces) > 1


@pytest.mark.skipif(not GOLDEN.exists(), reason="the golden frames are not beside this checkout")
def test_agrees_with_the_golden_frames():
    golden = np.load(GOLDEN)
    same_surface, near_mixed, mixed_pixels = [], [], 0
    for d, height_m in enumerate(golden["dut_height_m"]):
        renderer = Renderer(DutSettings(serial="G", height_m=float(height_m)))
        for a, angle_deg in enumerate(golden["stage_angle_deg"]):
            frame = renderer.expected(float(angle_deg))
            plain = ~golden["mixed"][d, a]
            intensity_error = np.abs(frame.intensity_counts - golden["intensity_counts"][d, a])
            distance_error = np.abs(frame.distance_m - golden["distance_m"][d, a])
            assert intensity_error[plain].max() < 0.05
            assert distance_error[plain].max() < 0.05e-3
            same_surface.append(np.mean(frame.surface == golden["surface"][d, a]))
            near_mixed.append(np.sum(intensity_error[~plain] < 40))
            mixed_pixels += int(np.sum(~plain))
    assert min(same_surface) >= 0.999
    assert sum(near_mixed) >= 0.99 * mixed_pixels
    azimuth, elevation = frame.azimuth_deg, frame.elevation_deg
    assert np.max(np.abs(azimuth - golden["azimuth_deg"])) < 1e-4
    assert np.max(np.abs(elevation - golden["elevation_deg"])) < 1e-4


def test_a_white_wall_ahead_has_the_full_scale_intensity():
    target = Panel(name="white", azimuth_deg=0, width_m=2.0, height_m=2.0, reflectance=1.0)
    on_axis = DUT.model_copy(update={"intrinsics": Intrinsics(cx=63.0, cy=15.0)})
    frame = Renderer(on_axis, SceneSettings(panels=(target,))).expected(0.0)
    assert frame.intensity_counts[15, 63] == pytest.approx(4000, rel=3e-4)
    assert frame.true_range_m[15, 63] == pytest.approx(1.1, abs=1e-6)
    assert frame.incidence_deg[15, 63] == pytest.approx(0.0, abs=0.1)
    assert frame.reflectance[15, 63] == 1.0


def test_a_target_is_ahead_when_the_stage_has_turned_by_minus_its_azimuth():
    renderer = Renderer(DUT)
    names = renderer.scene.surface_names
    for name, angle_deg in (("stripe_18", -7.5), ("stripe_80", 7.5), ("intrinsic_left", -45.0)):
        assert names[renderer.expected(angle_deg).surface[15, 63]] == name


def test_gain_scales_and_offset_shifts_the_intensity():
    base = Renderer(DUT).expected(3.0)
    other = Renderer(DUT.model_copy(update={"gain": 0.97, "offset_counts": 5.0})).expected(3.0)
    assert np.allclose(other.intensity_counts, 0.97 * base.intensity_counts + 5.0, rtol=1e-5)
    assert np.array_equal(other.distance_m, base.distance_m)


def test_patches_and_dead_pixels_stay_where_they_are_put():
    dut = DUT.model_copy(
        update={"patches": (PowerPatch(u=(10, 12), v=(4, 5), factor=0.95),), "dead_pixels": ((3, 7),)}
    )
    base, other = Renderer(DUT).expected(0.0), Renderer(dut).expected(0.0)
    ratio = other.intensity_counts / base.intensity_counts
    assert np.allclose(ratio[4:6, 10:13], 0.95, rtol=1e-5)
    ratio[4:6, 10:13] = 1.0
    assert np.allclose(ratio, 1.0)
    assert np.argwhere(other.dead).tolist() == [[7, 3]]


def test_a_small_turn_of_the_stage_is_a_turn_of_the_mount():
    turned = DUT.model_copy(update={"mount": Mount(yaw_deg=-2.0)})
    a, b = Renderer(DUT).expected(12.0), Renderer(turned).expected(10.0)
    assert np.allclose(a.intensity_counts, b.intensity_counts, atol=0.01)
    assert np.array_equal(a.surface, b.surface)


def test_angles_are_remembered_within_bounds():
    renderer = Renderer(DUT, remembered_angles=2)
    first = renderer.expected(1.0)
    assert renderer.expected(1.0) is first
    renderer.expected(2.0)
    renderer.expected(3.0)
    again = renderer.expected(1.0)
    assert again is not first
    assert np.array_equal(again.intensity_counts, first.intensity_counts)


def test_frames_cannot_be_changed_by_accident():
    with pytest.raises(ValueError, match="read-only"):
        Renderer(DUT).expected(0.0).intensity_counts[0, 0] = 1.0


def test_an_angle_is_cheap():
    renderer = Renderer(DUT)
    renderer.expected(0.0)
    places = iter(range(1000))

    def render() -> None:
        # no place twice: it may be known then
        place = next(places)
        for angle in range(40):
            renderer.expected(-60.0 + 3 * angle + 0.01 * place)

    assert processor_s(render) / 40 < 10e-3
