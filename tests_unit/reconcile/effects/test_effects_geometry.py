"""Errors of stage, mount, lens, beam and targets: operators against a scene rendered again, ray by ray."""

import numpy as np
import pytest
from rendered_bench import Camera, bench, corrected, left_over, render, variant_of

from arl_fixtures.reconcile import effects_render
from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.effects import optics_defocus
from arl_fixtures.reconcile.effects_pointing import turn_stage
from arl_fixtures.reconcile.view import View

LIGHT, RANGE = "intensity_counts", "distance_m"


def rendered(camera, **size):
    return View(bench(camera, **size))


def test_zero_offset_moves_light_and_range_as_a_turned_stage_does():
    index_shift = 0.12
    view = rendered(Camera(yaw_deg=index_shift))  # the camera turned by the same angle about the same axis
    state = corrected(view, variant_of(view, "stage.zero_offset"), zero=index_shift)
    assert left_over(view, state, LIGHT) < 0.02
    assert left_over(view, state, RANGE) < 0.05


def test_backlash_shifts_the_two_directions_of_travel_apart():
    columns = bench(steps=2, back_and_forth=True)
    stage = columns.numbers["stage_angle_deg"]
    came = np.where(columns.numbers["step"] == 1.0, -1.0, 1.0)
    turned_back = (columns.numbers["time_s"] % 1200.0) < 6.0  # first position of a sweep: came from nowhere
    came[turned_back] = 0.0
    real = render(columns.numbers["pixel_u"], columns.numbers["pixel_v"], stage + 0.1 * came)
    columns.numbers[LIGHT] = real[LIGHT]
    view = View(columns)
    state = corrected(view, variant_of(view, "stage.zero_offset", kind="backlash"), backlash=0.2)
    assert left_over(view, state, LIGHT) < 0.03


def test_a_logged_direction_holds_where_all_rows_come_from_one_side():
    """What a row is corrected by must not depend on which other rows stand in the table."""
    columns = bench(steps=2, back_and_forth=True)
    logged = np.where(columns.numbers["step"] == 1.0, -1.0, 1.0)
    columns.numbers["approach_direction"] = logged
    view = View(columns)
    variant = variant_of(view, "stage.zero_offset", kind="backlash")
    both = corrected(view, variant, backlash=0.2)
    back = columns.numbers["step"] == 1.0
    alone = bench(steps=2, back_and_forth=True)
    alone.numbers |= {"approach_direction": np.full(logged.size, -1.0)}
    from_one_side = corrected(View(alone), variant, backlash=0.2)
    np.testing.assert_allclose(from_one_side[RANGE][back], both[RANGE][back], atol=1e-9)


@pytest.mark.parametrize("frame", ["sensor", "bench"])
def test_eccentricity_reproduces_a_displaced_origin(frame):
    view = rendered(Camera(forward_m=0.003, right_m=-0.002, fixed_to_bench=frame == "bench"), angles=(-9.0, 9.0, 41))
    state = corrected(view, variant_of(view, "stage.eccentricity", frame=frame), forward=0.003, right=-0.002)
    assert left_over(view, state, LIGHT) < 0.05
    inner = np.abs(view.number("azimuth_deg") + view.number("stage_angle_deg")) < 10.5  # well sampled, no outer edge
    pure = inner & view.selects("mixed", "false")
    error = state[RANGE] - view.number(RANGE)
    assert np.abs(view.number(RANGE) - view.sim[RANGE])[pure].max() > 3.0e-3
    assert np.quantile(np.abs(error[pure]), 0.95) < 0.1e-3
    assert np.sum(error[inner] ** 2) < 0.05 * np.sum((view.number(RANGE) - view.sim[RANGE])[inner] ** 2)


def test_a_displaced_origin_leaves_pure_pixels_alone_where_mixed_ones_were_left_out(monkeypatch):
    monkeypatch.setattr(effects_render, "bench_of", lambda _view: None)  # as if another scene
    columns = bench(Camera(right_m=-0.004), angles=(-12.0, 12.0, 25), columns=(34, 94, 5), rows=(6, 24, 9), steps=1)
    where = [columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg")]
    turned = [render(*where[:2], where[2] + turn) for turn in (-0.4, 0.0, 0.4)]
    pure = ~np.any([one["mixed"] for one in turned], axis=0)
    codes, labels = columns.categories["surface"]
    columns = Columns(
        n=int(pure.sum()), numbers={name: values[pure] for name, values in columns.numbers.items()},
        categories={"surface": (codes[pure], labels)}, channels=columns.channels,
    )  # fmt: skip
    view = View(columns)
    state = corrected(view, variant_of(view, "stage.eccentricity", frame="sensor"), right=-0.004)
    assert left_over(view, state, RANGE) < 0.01
    assert left_over(view, state, LIGHT) < 0.05


def test_periodic_error_follows_the_stage_angle():
    columns = bench(angles=(-9.0, 9.0, 41), columns=(56, 72), steps=2)
    stage = columns.numbers["stage_angle_deg"]
    error = 0.1 * np.sin(2.0 * np.pi * stage / 7.0) + 0.05 * np.cos(2.0 * np.pi * stage / 7.0)
    real = render(columns.numbers["pixel_u"], columns.numbers["pixel_v"], stage + error)
    columns.numbers |= {LIGHT: real[LIGHT], RANGE: real[RANGE]}
    view = View(columns)
    state = corrected(view, variant_of(view, "stage.periodic_error"), sine=0.1, cosine=0.05, period=7.0)
    assert left_over(view, state, LIGHT) < 0.03


def test_tilt_reproduces_a_rotated_camera():
    turns = {"yaw": 0.10, "pitch": 0.20, "roll": -0.5}
    view = rendered(Camera(yaw_deg=0.10, pitch_deg=0.20, roll_deg=-0.5), rows=(4, 28), columns=(58, 70))
    state = corrected(view, variant_of(view, "mount.tilt"), **turns)
    assert left_over(view, state, LIGHT) < 0.06
    assert left_over(view, state, RANGE) < 0.10


def test_focal_drift_moves_edges_outwards_with_the_temperature():
    drift = 4e-4
    columns = bench(columns=(84, 100), angles=(-30.0, -12.0, 21), rows=(10, 14), steps=4)
    warm = columns.numbers["housing_temperature_c"] - 25.0
    where = columns.numbers["pixel_u"], columns.numbers["pixel_v"], columns.numbers["stage_angle_deg"]
    real = render(*where, Camera(zoom=1.0 + drift * warm))
    columns.numbers |= {LIGHT: real[LIGHT], RANGE: real[RANGE]}
    view = View(columns)
    state = corrected(view, variant_of(view, "optics.focal_drift", temperature="housing_temperature_c"), drift=drift)
    assert left_over(view, state, LIGHT) < 0.05
    assert left_over(view, state, RANGE) < 0.05


@pytest.mark.parametrize("pulse_m", [0.05, 0.15])
def test_two_echoes_in_a_pixel_merge_or_one_of_them_wins(pulse_m):
    """The strongest point of the summed Gaussian echoes of all rays, on a grid of 2 mm."""
    columns = bench(columns=(52, 76), rows=(12, 16))
    seen = render(*(columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg")))
    mixed = np.flatnonzero(np.ptp(seen["ray_range_m"], axis=0) > 0.05)
    grid = np.arange(1.0, 1.8, 0.002)
    ranges, weights = seen["ray_range_m"][:, mixed], seen["ray_weight"][:, mixed]
    echo = sum(w * np.exp(-0.5 * ((grid[:, None] - r) / pulse_m) ** 2) for w, r in zip(weights, ranges, strict=True))
    columns.numbers[RANGE] = columns.numbers[RANGE].copy()
    columns.numbers[RANGE][mixed] = grid[np.argmax(echo, axis=0)]
    view = View(columns)
    state = corrected(view, variant_of(view, "target.edge_mixing", kind="echo"), share=1.0, pulse=pulse_m)
    assert left_over(view, state, RANGE) < 0.3


def test_a_blur_finer_than_a_pixel_spreads_the_rays_over_the_scene_that_the_sweep_shows(monkeypatch):
    """Every pixel as the mean of renderings about it, weighted by a Gaussian of a seventh of a pixel."""
    monkeypatch.setattr(optics_defocus, "bench_of", lambda _view: None)  # as if another simulator's
    width_px = 0.15
    columns = bench(columns=(52, 76), rows=(12, 16))
    u, v, stage = (columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    light, moment, total = np.zeros(u.size), np.zeros(u.size), 0.0
    for x in np.linspace(-3.0, 3.0, 13):
        for y in (-1.0, 0.0, 1.0):
            weight = np.exp(-0.5 * (x**2 + 1.5 * y**2))
            seen = render(u + width_px * x, v + width_px * y, stage)
            light += weight * seen[LIGHT]
            moment += weight * seen[LIGHT] * seen[RANGE]
            total += weight
    columns.numbers |= {LIGHT: light / total, RANGE: moment / light}
    view = View(columns)
    left = {}
    for kind in ("scene", "image"):
        state = corrected(view, variant_of(view, "optics.defocus", temperature="", kind=kind), width=width_px)
        left[kind] = left_over(view, state, LIGHT), left_over(view, state, RANGE)
    assert max(left["scene"]) < 0.2
    assert min(left["image"]) > 2.0 * max(left["scene"])


def test_frame_lag_mixes_in_the_position_before_in_time_not_in_angle():
    columns = bench(steps=2, back_and_forth=True)
    u, v, stage = (columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    pitch = 0.9 * np.where(columns.numbers["step"] == 1.0, -1.0, 1.0)
    first = (columns.numbers["time_s"] % 1200.0) < 6.0
    stale = render(u, v, np.where(first, stage, stage - pitch))
    columns.numbers[LIGHT] = 0.7 * columns.numbers["sim_intensity_counts"] + 0.3 * stale[LIGHT]
    view = View(columns)
    variant = variant_of(view, "acquisition.frame_lag", frames=1)
    state = corrected(view, variant, share=0.3)
    assert left_over(view, state, LIGHT) < 1e-6
    apart = np.abs(stale[LIGHT] - columns.numbers["sim_intensity_counts"])
    mixture = np.hypot(view.sim[f"{LIGHT}_std"], np.sqrt(0.3 * 0.7) * apart)  # variance of a two-point mixture
    np.testing.assert_allclose(state[f"{LIGHT}_std"], mixture, rtol=1e-6)


def test_frames_of_a_stage_that_settles_are_those_rendered_on_its_way():
    columns = bench(steps=2, back_and_forth=True)
    u, v, stage = (columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    pitch = 0.9 * np.where(columns.numbers["step"] == 1.0, -1.0, 1.0)
    pitch[(columns.numbers["time_s"] % 1200.0) < 6.0] = 0.0
    frames = [render(u, v, stage - pitch * 0.7 * np.exp(-k / 3.0)) for k in range(10)]
    for name in (LIGHT, RANGE):
        columns.numbers[name] = np.mean([frame[name] for frame in frames], axis=0)
    view = View(columns)
    state = corrected(view, variant_of(view, "acquisition.frame_lag", kind="settling"), creep=0.7, decay=3.0)
    mixed = corrected(view, variant_of(view, "acquisition.frame_lag", frames=1), share=0.2)
    assert left_over(view, state, LIGHT) < 0.03
    assert left_over(view, state, RANGE) < 0.06
    assert left_over(view, state, LIGHT) < 0.2 * left_over(view, mixed, LIGHT)
    edge = np.abs(columns.numbers[LIGHT] / columns.numbers["sim_intensity_counts"] - 1.0) > 0.05
    spread = np.std([frame[LIGHT] for frame in frames], axis=0)
    own = 36.0 + 0.25 * state[LIGHT] + (0.004 * state[LIGHT]) ** 2
    ratio = state[f"{LIGHT}_std"][edge] / np.sqrt(own + spread**2)[edge]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
    assert np.mean(np.abs(ratio - 1.0) < 0.1) > 0.8


def test_a_stage_that_has_all_but_arrived_after_a_wide_move_lags_by_what_is_left_of_it():
    """Half a per cent of 4.5 degrees: nothing that lies farther back on the way tells of what these frames show."""
    columns = bench(angles=(-9.0, 9.0, 21), steps=1)
    u, v, stage = (columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    place = np.rint((stage + 9.0) / 0.9).astype(int)
    visited = np.concatenate([np.arange(first, 21, 5) for first in range(5)])
    came = np.diff(0.9 * visited, prepend=0.9 * visited[0])[np.argsort(visited)[place]]
    columns.numbers["time_s"] = 5.0 * np.argsort(visited)[place]
    frames = [render(u, v, stage - came * 0.005 * np.exp(-k / 3.0)) for k in range(10)]
    for name in (LIGHT, RANGE):
        columns.numbers[name] = np.mean([frame[name] for frame in frames], axis=0)
    view = View(columns)
    state = corrected(view, variant_of(view, "acquisition.frame_lag", kind="settling"), creep=0.005, decay=3.0)
    turned = dict(view.sim)
    turn_stage(view, turned, -0.005 * came * np.mean(np.exp(-np.arange(10) / 3.0)))
    assert left_over(view, state, LIGHT) < 1.1 * left_over(view, turned, LIGHT)
    assert left_over(view, state, RANGE) < 1.1 * left_over(view, turned, RANGE)


def test_single_frames_of_a_stage_that_settles_show_each_a_place_on_its_way():
    """Four frames an angle, a row each: 0, 1, 2 and 3 s after the stage says that it has arrived."""
    columns = bench(columns=(58, 70), rows=(14, 17), angles=(-9.0, 9.0, 19), steps=4)
    u, v, stage = (columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    frame = columns.numbers["step"].copy()  # what was a step is a frame: the same places once more, a second later
    columns.numbers["time_s"] = columns.numbers["time_s"] - 1199.0 * frame
    columns.numbers |= {"n_frames": np.ones(u.size), "step": np.zeros(u.size)}
    came = np.where(stage > stage.min(), 1.0, 0.0)
    real = render(u, v, stage - came * 0.8 * np.exp(-frame / 1.5))
    columns.numbers |= {LIGHT: real[LIGHT], RANGE: real[RANGE]}
    view = View(columns)
    state = corrected(view, variant_of(view, "acquisition.frame_lag", kind="on the way"), creep=0.8, decay=1.5)
    assert left_over(view, state, LIGHT) < 0.03
    assert left_over(view, state, RANGE) < 0.06


def test_a_stage_that_has_not_arrived_lags_by_a_share_of_uneven_steps():
    """One frame an angle; the stage, a first-order follower, has done seven tenths of each move when it is taken."""
    columns = bench(columns=(58, 70), rows=(14, 17), angles=(-9.0, 9.0, 37), steps=1)
    place = np.rint((columns.numbers["stage_angle_deg"] + 9.0) / 0.5).astype(int)
    route = np.array([k for k in range(37) if k % 5 != 2])
    keep = np.isin(place, route)
    numbers = {name: values[keep] for name, values in columns.numbers.items()}
    labels = {name: (codes[keep], names) for name, (codes, names) in columns.categories.items()}
    where = np.searchsorted(route, place[keep])
    numbers |= {"time_s": 10.0 * where, "n_frames": np.ones(where.size)}
    asked = -9.0 + 0.5 * route
    stood = asked.copy()
    for k in range(1, route.size):
        stood[k] = asked[k] - 0.3 * (asked[k] - asked[k - 1])
    real = render(numbers["pixel_u"], numbers["pixel_v"], stood[where])
    numbers |= {LIGHT: real[LIGHT], RANGE: real[RANGE]}
    view = View(Columns(where.size, numbers, labels, columns.channels))
    state = corrected(view, variant_of(view, "acquisition.frame_lag", kind="on the way"), creep=0.3)
    mixed = corrected(view, variant_of(view, "acquisition.frame_lag", frames=1), share=0.3)
    assert left_over(view, state, LIGHT) < 0.03
    assert left_over(view, state, LIGHT) < 0.3 * left_over(view, mixed, LIGHT)
    even = View(bench(columns=(58, 62), rows=(14, 16), steps=1))
    del even.columns.numbers["n_frames"]
    with pytest.raises(LookupError):  # an even sweep that lags by a constant is a stage's zero
        variant_of(even, "acquisition.frame_lag", kind="on the way")


def test_beam_shift_reproduces_a_beam_that_points_elsewhere():
    view = rendered(Camera(beam=(75.0, 18.0, 2.0, -0.5)), columns=(20, 108), rows=(2, 30), angles=(-2.7, 2.7, 4))
    state = corrected(view, variant_of(view, "beam.profile_shift", driver=""), shift_az=2.0, shift_el=-0.5)
    assert left_over(view, state, LIGHT) < 0.01


@pytest.mark.parametrize("lost", [("azimuth_deg", "elevation_deg"), ("azimuth_deg",), ("elevation_deg",)])
def test_a_beam_that_moves_or_widens_is_told_by_pixels_where_rays_are_not_given(lost):
    """A pinhole of 58 by 66 pixels: 2° are 2.03 pixels of its middle, and 2.6 where the beam falls off."""

    def without_rays(beam):
        columns = bench(Camera(beam=beam), columns=(30, 98), rows=(2, 30), angles=(0.0, 0.9, 2), steps=1)
        kept = {name: values for name, values in columns.numbers.items() if name not in lost}
        return View(Columns(columns.n, kept, columns.categories, columns.channels))

    view = without_rays((75.0, 18.0, 2.0, -0.5))
    shifts = {"shift_u": 2.6} if "azimuth_deg" in lost else {"shift_az": 2.0}
    shifts |= {"shift_v": 0.58} if "elevation_deg" in lost else {"shift_el": -0.5}
    moved = corrected(view, variant_of(view, "beam.profile_shift", driver=""), **shifts)
    assert left_over(view, moved, LIGHT) < 0.05
    view = without_rays((75.0 * 1.1, 18.0 * 1.05, 0.0, 0.0))
    variant = variant_of(view, "beam.profile_change", kind="width", driver="")
    names = [parameter.name for parameter in variant.parameters]
    wider = corrected(view, variant, **dict(zip(names, (0.1, 0.05), strict=True)))
    np.testing.assert_allclose(wider[LIGHT] / view.number(LIGHT), 1.0, atol=1e-2)


def test_beam_change_reproduces_a_wider_beam():
    view = rendered(
        Camera(beam=(75.0 * 1.1, 18.0 * 1.05, 0.0, 0.0)), columns=(20, 108), rows=(2, 30), angles=(0.0, 0.9, 2)
    )
    variant = variant_of(view, "beam.profile_change", kind="width", driver="")
    state = corrected(view, variant, width_az=0.1, width_el=0.05)
    spread = state[LIGHT] / view.number(LIGHT)
    np.testing.assert_allclose(spread, 1.0, atol=4e-3)


def test_a_brighter_surface_is_brighter_also_in_pixels_that_see_half_of_it():
    view = rendered(Camera(reflectance={"stripe_50": 0.50 * 1.04}))
    variant = variant_of(view, "target.reflectance_error", surface="stripe_50")
    assert left_over(view, corrected(view, variant, error=0.04), LIGHT) < 0.01
    mixed = view.selects("mixed", "true") & (np.abs(view.number(LIGHT) / view.sim[LIGHT] - 1.0) > 1e-6)
    state = corrected(view, variant, error=0.04)
    at_edges = state[LIGHT][mixed] / view.number(LIGHT)[mixed]
    assert np.abs(at_edges - 1.0).max() < 0.012
    assert left_over(view, state, RANGE) < 0.2  # and nearer, as more of their light comes from the panel


def test_rows_that_see_other_surfaces_only_are_left_as_they_are():
    variant = variant_of(View(bench(columns=(52, 76))), "target.reflectance_error", surface="stripe_18")
    columns = bench(columns=(52, 76))
    codes, labels = columns.categories["surface"]
    columns.categories["surface"] = codes, tuple("another" if label == "stripe_18" else label for label in labels)
    view = View(columns)
    state = corrected(view, variant, error=0.1)
    assert all(np.array_equal(state[name], view.sim[name]) for name in (LIGHT, RANGE))


def test_surfaces_of_another_sign_of_rotation_are_found_from_the_table_itself():
    columns = bench(Camera(yaw_deg=0.1))
    columns.numbers["stage_angle_deg"] = -columns.numbers["stage_angle_deg"]  # counter-clockwise positive
    view = View(columns)
    state = corrected(view, variant_of(view, "stage.zero_offset"), zero=-0.1)
    assert left_over(view, state, LIGHT) < 0.02


def test_a_sweep_of_few_angles_has_a_scene():
    """One pixel that a stage turns to seven bearings: fewer samples than the scene is smoothed over."""
    view = rendered(Camera(yaw_deg=0.3), columns=(63, 64), rows=(15, 16), angles=(-9.0, 9.0, 7), steps=1)
    state = corrected(view, variant_of(view, "stage.zero_offset"), zero=0.3)
    assert left_over(view, state, LIGHT) < 1.0
    assert np.isfinite(state[RANGE]).all()
