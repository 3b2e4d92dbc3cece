"""The nominal bench behind a calibration: what it shows beyond the table's few pixels, against rays traced here."""

import numpy as np
import pytest
from traced_bench import LIGHT, RANGE, one_ray, seen_as_measured, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.effects_bench import bench_of, is_sharp
from arl_fixtures.reconcile.effects_bounce import bounced, incidence_deg
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.view import View

STRIPES = {7.5: 0.18, 0.0: 0.50, -7.5: 0.80}


def calibrated(columns, *, gain=1.04, zero=-5.0, ahead_m=0.008, measured=True):
    """A table whose simulation was fitted to a device by a line, and its range by a constant."""
    for name in (LIGHT, f"sim_{LIGHT}") if measured else (f"sim_{LIGHT}",):
        columns.numbers[name] = gain * columns.numbers[name] + zero
    for name in (RANGE, f"sim_{RANGE}") if measured else (f"sim_{RANGE}",):
        columns.numbers[name] = columns.numbers[name] + ahead_m
    return columns


def beam_of(u, v):
    x, y = (u - 63.5) / 58.1, (v - 15.5) / 66.0
    grow = 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * 0.198 * (x * x + y * y)))
    azimuth = np.degrees(np.arctan(x * grow))
    elevation = np.degrees(np.arcsin(-y * grow / np.sqrt(1.0 + (x * grow) ** 2 + (y * grow) ** 2)))
    return np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4), azimuth, elevation


def centre_ray(u, v, stage_deg, height_m=0.10):
    _, azimuth, elevation = beam_of(u, v)
    return one_ray(
        np.radians(azimuth), np.sin(np.radians(elevation)), np.radians(stage_deg), height_m, 0.0, True
    )  # fmt: skip


def footprint(u, v, stage_deg, count=13):
    """Light and range of whole pixels, by many rays."""
    place = (np.arange(count) + 0.5) / count - 0.5
    light, moment = np.zeros(u.size), np.zeros(u.size)
    for du in place:
        for dv in place:
            one, far = centre_ray(u + du, v + dv, stage_deg)
            light += one / count**2
            moment += one * far / count**2
    return light, moment / light


def through_centre_rays(*, bins=1, angles=31, pixels=24, seed=5, rays=False):
    """A table of strewn pixels that a simulation sees through one ray each; measured through whole pixels."""
    rng = np.random.default_rng(seed)
    flat = rng.choice(60 * 14, size=pixels, replace=False)
    axes = np.meshgrid(np.arange(2), np.linspace(-15.0, 15.0, angles), np.arange(pixels), indexing="ij")
    step, stage, which = (axis.ravel() for axis in axes)
    own_u, own_v = (flat % 60 + 2.0)[which], (flat // 60 + 1.0)[which]
    u, v = (own * bins + 0.5 * (bins - 1) for own in (own_u, own_v))
    beam, azimuth, elevation = beam_of(u, v)
    sim, sim_far = centre_ray(u, v, stage)
    light, far = footprint(u, v, stage) if bins == 1 else (sim, sim_far)
    full = 4000.0 * 1.21 * beam
    numbers = {
        "step": step, "stage_angle_deg": stage, "pixel_u": own_u, "pixel_v": own_v, "n_frames": np.full(u.size, 10.0),
        "time_s": 1200.0 * step + 10.0 * stage, f"sim_{LIGHT}": full * sim, f"sim_{RANGE}": sim_far,
        f"sim_{LIGHT}_std": np.sqrt(36.0 + full * sim / 4.0), f"sim_{RANGE}_std": np.full(u.size, 0.01),
        LIGHT: full * light, RANGE: far,
    }  # fmt: skip
    if rays:
        numbers |= {"azimuth_deg": azimuth, "elevation_deg": elevation}
    numbers = {name: np.asarray(values, dtype=float) for name, values in numbers.items()}
    return Columns(
        n=u.size, numbers=numbers, categories={"dut": (np.zeros(u.size, dtype=np.int64), ("a",))},
        channels=find_channels(set(numbers)),
    )  # fmt: skip


def applied(columns, effect, wanted, values):
    """Signal and distance after an effect's variant whose options hold `wanted`."""
    view = View(columns)
    one = library()[effect]
    variant = next(v for v in one.variants(view) if wanted.items() <= v.options.items())
    state = view.fresh_state()
    one.apply(variant, values, state, view)
    return state[LIGHT], state[RANGE]


def test_a_calibration_does_not_hide_the_bench():
    columns = calibrated(table(noise=False, turn_deg=0.2))
    assert is_sharp(View(columns))
    assert seen_as_measured(columns, Pose(turn_deg=0.2)) > 0.998


def test_a_binned_image_is_the_nominal_camera_s():
    found = bench_of(View(through_centre_rays(bins=2)))
    assert found is not None
    assert found.optics.camera.fx == pytest.approx(29.05)
    assert found.optics.rays == 1


def test_a_ghost_comes_from_pixels_that_the_table_does_not_hold():
    columns = calibrated(table(noise=False, angles=15, pixels=30))
    numbers = columns.numbers
    u, v, stage = (numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    there_u, there_v = 129.0 - u, 30.0 - v
    light, far = trace(there_u, there_v, stage, 0.10)
    inside = (there_u <= 127.5) & (there_v >= -0.5)
    stray = np.where(inside, 0.02 * 1.04 * 4000.0 * 1.21 * beam_of(there_u, there_v)[0] * light, 0.0)
    own, own_far = numbers[f"sim_{LIGHT}"], numbers[f"sim_{RANGE}"]
    true = own + stray
    true_far = (own * own_far + stray * (far + 0.008)) / true
    seen, seen_far = applied(
        columns, "optics.ghost", {"flip": "point"}, {"share": 0.02, "centre_u": 64.5, "centre_v": 15.0, "pull": 1.0}
    )  # fmt: skip
    assert np.sum((seen - true) ** 2) < 0.02 * np.sum((own - true) ** 2)
    assert np.sum((seen_far - true_far) ** 2) < 0.05 * np.sum((own_far - true_far) ** 2)


def test_glare_pulls_to_the_range_of_the_whole_image():
    columns = calibrated(table(noise=False, angles=9, pixels=20))
    numbers = columns.numbers
    stage = numbers["stage_angle_deg"]
    image_u, image_v = (x.ravel() for x in np.meshgrid(np.arange(0.0, 128.0), np.arange(0.0, 32.0, 2.0) + 0.5))
    mean, far = np.zeros(stage.size), np.zeros(stage.size)
    for angle in np.unique(stage):
        light, away = centre_ray(image_u, image_v, np.full(image_u.size, angle))
        light = light * 1.04 * 4000.0 * 1.21 * beam_of(image_u, image_v)[0]
        mean[stage == angle] = np.mean(light)
        far[stage == angle] = np.sum(light * away) / np.sum(light) + 0.008
    own, own_far = numbers[f"sim_{LIGHT}"], numbers[f"sim_{RANGE}"]
    true_far = (0.98 * own * own_far + 0.02 * mean * far) / (0.98 * own + 0.02 * mean)
    seen_far = applied(columns, "optics.veiling_glare", {}, {"share": 0.02, "pull": 1.0})[1]
    assert np.sum((seen_far - true_far) ** 2) < 0.01 * np.sum((own_far - true_far) ** 2)


def test_a_pixel_s_area_is_what_one_ray_does_not_see():
    columns = calibrated(through_centre_rays(), measured=True)
    own = columns.numbers[f"sim_{LIGHT}"], columns.numbers[f"sim_{RANGE}"]
    seen = applied(columns, "target.edge_mixing", {"kind": "footprint"}, {"share": 1.0, "filled": 1.0})
    for before, after, true in zip(own, seen, (columns.numbers[LIGHT], columns.numbers[RANGE]), strict=True):
        assert np.sum((after - true) ** 2) < 0.02 * np.sum((before - true) ** 2)


def test_a_pixel_s_area_shows_in_ranges_alone():
    columns = calibrated(through_centre_rays(), measured=True)
    for name in (LIGHT, f"sim_{LIGHT}", f"sim_{LIGHT}_std"):
        del columns.numbers[name]
    columns.channels = find_channels(set(columns.numbers))
    view = View(columns)
    effect = library()["target.edge_mixing"]
    variant = next(v for v in effect.variants(view) if v.options["kind"] == "footprint")
    state = view.fresh_state()
    effect.apply(variant, {"share": 1.0, "filled": 1.0}, state, view)
    true, before = columns.numbers[RANGE], columns.numbers[f"sim_{RANGE}"]
    assert np.sum((state[RANGE] - true) ** 2) < 0.02 * np.sum((before - true) ** 2)


# ---- light that bounces ----------------------------------------------------------------------------------------


def surfaces(ray, height_m):
    """Where rays from the axis at a height end: place, normal and reflectance; x to the middle stripe, y left."""
    level = np.hypot(ray[:, 0], ray[:, 1])
    far = 1.6 / level
    normal = -np.column_stack([ray[:, :2] / level[:, None], np.zeros(len(ray))])
    rho = np.full(len(ray), 0.06)
    boards = dict.fromkeys((45.0, -45.0), 0.05 + 0.8 * 25.0 * np.pi * 0.035**2 / 0.56**2)  # circles as a mean
    for bearing, value in (STRIPES | boards).items():
        half, tall = (0.0675, 0.40) if bearing in STRIPES else (0.28, 0.28)
        n = np.array([np.cos(np.radians(bearing)), np.sin(np.radians(bearing)), 0.0])
        reach = 1.1 / np.maximum(ray @ n, 1e-6)
        aside = reach * (ray @ np.array([-n[1], n[0], 0.0]))
        on = (np.abs(aside) < half) & (np.abs(reach * ray[:, 2] + height_m) < tall) & (ray @ n > 0.1)
        far, rho = np.where(on, reach, far), np.where(on, value, rho)
        normal = np.where(on[:, None], -n, normal)
    return ray * far[:, None] + np.array([0.0, 0.0, height_m]), normal, rho


def rays_at(azimuth_deg, elevation_deg, stage_deg):
    bearing, up = np.radians(azimuth_deg + stage_deg), np.sin(np.radians(elevation_deg))
    level = np.sqrt(1.0 - up * up)
    return np.column_stack([level * np.cos(bearing), -level * np.sin(bearing), up])


def test_two_bounces_are_those_of_rays_that_the_sensor_throws():
    columns = table(noise=False, angles=7, pixels=12, seed=8)
    light, detour = bounced(View(columns))
    numbers, rng = columns.numbers, np.random.default_rng(1)
    az, el = rng.uniform(-60.2, 60.2, 60_000), np.degrees(np.arcsin(rng.uniform(-0.237, 0.237, 60_000)))
    power = np.exp(-((az / 75.0) ** 4) - (el / 18.0) ** 4)
    first = np.flatnonzero(numbers["step"] == 0)
    true, longer = np.zeros(first.size), np.zeros(first.size)
    for k, row in enumerate(first):
        stage = numbers["stage_angle_deg"][row]
        own = rays_at(np.array([numbers["azimuth_deg"][row]]), np.array([numbers["elevation_deg"][row]]), stage)
        target, normal, _ = (part[0] for part in surfaces(own, 0.10))
        place, facing, rho = surfaces(rays_at(az, el, stage), 0.10)
        way = target - place
        length = np.maximum(np.linalg.norm(way, axis=1), 0.08)
        leaving = np.maximum(np.sum(way * facing, axis=1) / length, 0.0)
        bounce = power * rho * leaving * np.maximum(-(way @ normal) / length, 0.0) / length**2
        start = np.array([0.0, 0.0, 0.10])
        away = np.linalg.norm(target - start)
        true[k] = bounce.sum() / (-(own[0] @ normal) / away**2)
        over = np.linalg.norm(place - start, axis=1) + length - away
        longer[k] = 0.5 * np.sum(bounce * over) / bounce.sum()
    assert np.corrcoef(light[first], true)[0, 1] > 0.97
    assert np.std(light[first] / light.mean() - true / true.mean()) < 0.15 * np.std(true / true.mean()) ** 0.5
    assert np.median(np.abs(detour[first] - longer)) < 0.05 * np.median(longer)


def test_the_angle_of_incidence_is_that_of_the_surfaces():
    columns = table(noise=False, angles=9, pixels=20)
    numbers = columns.numbers
    own = rays_at(numbers["azimuth_deg"], numbers["elevation_deg"], numbers["stage_angle_deg"])
    _, normal, _ = surfaces(own, 0.10)
    true = np.degrees(np.arccos(-np.sum(own * normal, axis=1)))
    assert np.quantile(np.abs(incidence_deg(View(columns)) - true), 0.99) < 0.01


# ---- what a calibration leaves ---------------------------------------------------------------------------------


def test_a_zero_beside_an_effect_carries_no_evidence():
    problem = Problem(table(noise=False))
    light, far = (next(d for d in problem.data if d.channel.name == name) for name in (LIGHT, RANGE))
    constant = np.full(light.use.size, 3.0)
    before = float(np.sum(light.whiten(constant) ** 2))
    for d in (light, far, light):
        d.free_zero()
        d.rebuild(d.tau)
    assert float(np.sum(light.whiten(constant) ** 2)) < 0.02 * before
    assert [level.name for level in light.levels].count("unit") == 1
    assert all(level.name != "unit" for level in far.levels)


def test_a_line_thrown_off_by_an_effect_is_no_second_one():
    columns = calibrated(table(turn_deg=0.06, angles=25), gain=1.01, zero=-4.0, ahead_m=0.0, measured=False)
    on_wall = (columns.numbers[f"sim_{RANGE}"] > 1.5).astype(np.int64)
    columns.categories["surface"] = (on_wall, ("panel", "wall"))
    names = ("stage.zero_offset", "readout.column_pattern", "optics.veiling_glare", "target.reflectance_error")
    found = Search(columns, [library()[name] for name in names]).run()
    assert [term.effect.id for term in found.best.terms] == ["stage.zero_offset"]


def test_a_wave_that_is_the_same_on_all_rows_of_the_table_is_no_pattern():
    columns = table(noise=False, pixels=40, angles=9)
    columns.numbers["pixel_v"] = np.array([1.0, 7.0, 13.0, 19.0, 25.0, 31.0])[
        (columns.numbers["pixel_v"] % 6.0).astype(int)
    ]
    for values in ({"cosine": 2.0, "sine": 0.0}, {"cosine": 0.0, "sine": -3.0}):
        zeros = {"gain_cosine": 0.0, "gain_sine": 0.0, "period": 6.0}
        seen = applied(
            columns, "readout.column_pattern", {"axis": "pixel_v", "kind": "periodic", "channel": LIGHT},
            values | zeros,
        )[0]  # fmt: skip
        assert np.max(np.abs(seen - columns.numbers[f"sim_{LIGHT}"])) < 1e-6


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_a_few_rays_tell_the_height_though_circles_repeat(seed):
    found = bench_of(View(through_centre_rays(angles=5, pixels=60, seed=seed)))
    assert found is not None
    assert set(found.spots.height_m) == {0.10}
