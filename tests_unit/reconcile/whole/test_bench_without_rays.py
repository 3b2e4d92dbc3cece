"""A simulation that a user has calibrated is still the nominal bench, also without its rays' directions."""

import numpy as np
import pytest
from traced_bench import FIFTEENTHS, LIGHT, RANGE, seen_as_measured, table, with_surfaces

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.columns import Columns, find_channels
from arl_fixtures.reconcile.derived_rays import as_the_table_says, derive_rays
from arl_fixtures.reconcile.effects_bench import bench_of, is_sharp
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.effects_render import as_simulated, rendered
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View


def calibrated(columns, *, gain=1.03, pedestal=4.0, offset_m=0.0066, scale=1.0):
    """As after a user's fit: simulation and recording share a gain, a pedestal, an offset."""
    for name in (f"sim_{LIGHT}", LIGHT):
        columns.numbers[name] = gain * columns.numbers[name] + pedestal
    for name in (f"sim_{RANGE}", RANGE):
        columns.numbers[name] = scale * columns.numbers[name] + offset_m
    return columns


def without_rays(columns):
    for name in ("azimuth_deg", "elevation_deg"):
        del columns.numbers[name]
    columns.channels = find_channels(set(columns.numbers))
    return columns


@pytest.mark.parametrize(
    "fitted", [{}, {"pedestal": -3.0, "offset_m": -0.02}, {"gain": 0.5, "pedestal": 0.0}, {"scale": 1.004}]
)
def test_a_calibrated_bench_is_seen_as_the_bench(fitted):
    assert is_sharp(View(calibrated(table(), **fitted)))


@pytest.mark.parametrize("missing", [LIGHT, RANGE])
def test_one_channel_is_enough_to_see_the_bench(missing):
    def without(columns):
        for name in (f"sim_{missing}", f"sim_{missing}_std", missing):
            del columns.numbers[name]
        columns.channels = find_channels(set(columns.numbers))
        return columns

    assert is_sharp(View(without(table())))
    assert bench_of(View(without(table(panels=False)))) is None


def test_a_log_of_temperatures_among_the_images_does_not_hide_the_bench():
    columns, rows = table(turn_deg=0.3, noise=False), 40
    numbers = {name: np.r_[np.full(rows, np.nan), values] for name, values in columns.numbers.items()}
    labels = {name: (np.r_[np.full(rows, -1), code], kinds) for name, (code, kinds) in columns.categories.items()}
    logged = Columns(n=columns.n + rows, numbers=numbers, categories=labels, channels=columns.channels)
    assert is_sharp(View(logged))
    of_images = columns.n / (columns.n + rows)
    assert seen_as_measured(logged, Pose(turn_deg=0.3)) > 0.99 * of_images


def test_a_bench_with_its_panels_elsewhere_is_seen_and_moves_like_it():
    rebuilt = {"arc_m": 1.27, "wall_m": 1.85}
    assert is_sharp(View(table(**rebuilt)))  # where a ray looks says enough of what it meets
    columns = with_surfaces(table(turn_deg=0.3, noise=False, **rebuilt), **rebuilt)
    assert is_sharp(View(columns))
    assert seen_as_measured(columns, Pose(turn_deg=0.3)) > 0.99


def test_a_calibrated_bench_with_its_panels_elsewhere_before_a_brighter_wall_is_seen():
    columns = table(arc_m=1.27, wall_m=1.85, paint=0.11)
    assert is_sharp(View(calibrated(columns, pedestal=0.0, offset_m=0.0066)))


def test_soft_edges_of_a_bench_that_was_rebuilt_move_as_its_pixels_areas_do():
    rebuilt = {"arc_m": 1.27, "wall_m": 1.85, "places": FIFTEENTHS}
    columns = table(turn_deg=0.1, noise=False, angles=31, **rebuilt)
    view = View(columns)
    assert bench_of(view) is not None
    there, here = rendered(view, Pose(turn_deg=0.1)), rendered(view)
    light = view.sim[LIGHT] * (there[LIGHT] / here[LIGHT] - 1.0)
    moved = view.number(LIGHT) - view.sim[LIGHT]
    assert np.sum((light - moved) ** 2) < 0.05 * np.sum(moved**2)


@pytest.mark.parametrize("tall", [0.30, 0.24])
def test_stripes_that_are_cut_shorter_are_left_out_of_a_rebuilt_bench(tall):
    """Half their height is 0.4 m on the nominal bench. What is known is shown, what is cut off is not foretold."""
    rebuilt = {"arc_m": 1.27, "wall_m": 1.85, "places": FIFTEENTHS}
    columns, uncut = (
        with_surfaces(table(turn_deg=0.1, noise=False, angles=31, tall=t, **rebuilt), arc_m=1.27, wall_m=1.85)
        for t in (tall, 0.40)
    )
    view = View(columns)
    assert bench_of(view) is not None
    known, cut = as_simulated(view), np.abs(view.sim[LIGHT] / View(uncut).sim[LIGHT] - 1.0) > 0.2
    assert cut.any()
    assert not known[cut].any()
    assert np.mean(known) > 0.9
    there, here = rendered(view, Pose(turn_deg=0.1)), rendered(view)
    light = view.sim[LIGHT] * (there[LIGHT] / here[LIGHT] - 1.0)
    moved = view.number(LIGHT) - view.sim[LIGHT]
    assert np.sum((light - moved)[known] ** 2) < 0.15 * np.sum(moved[known] ** 2)


def test_another_scene_is_not_calibrated_into_the_bench():
    assert bench_of(View(calibrated(table(panels=False)))) is None


def test_rays_that_a_table_lacks_are_those_of_its_bench():
    given_rays, bare = table(), without_rays(calibrated(table()))
    assert derive_rays(bare)
    for name, values in bare.derived.items():
        np.testing.assert_allclose(values, given_rays.numbers[name], atol=1e-6)
    assert not derive_rays(given_rays)
    assert not derive_rays(without_rays(table(panels=False)))


@pytest.mark.parametrize("lost", ["azimuth_deg", "elevation_deg"])
def test_one_angle_of_the_nominal_camera_tells_the_other_whatever_the_scene(lost):
    given_rays, bare = table(panels=False), table(panels=False)
    del bare.numbers[lost]
    assert derive_rays(bare)
    assert list(bare.derived) == [lost]
    np.testing.assert_allclose(bare.derived[lost], given_rays.numbers[lost], atol=1e-6)
    another = table(panels=False, fx=59.0)
    del another.numbers[lost]
    assert not derive_rays(another)


def test_drivers_are_columns_of_the_table():
    bare = without_rays(table())
    derive_rays(bare)
    view = View(bare)
    variants = [as_the_table_says(v, view) for v in library()["mount.tilt"].variants(view)]
    assert variants
    assert all(set(v.drivers) <= {"pixel_u", "pixel_v"} for v in variants)


def test_a_tilt_is_found_in_a_calibrated_table_without_rays():
    columns = without_rays(calibrated(table(tilt_deg=(0.0, -0.4, 0.8), angles=13, pixels=20)))
    found, model, _ = diagnose(columns, effects=[library()[n] for n in ("mount.tilt", "stage.zero_offset")])
    assert [f.effect for f in found.findings] == ["mount.tilt"]
    assert set(found.findings[0].drivers) <= {"pixel_u", "pixel_v"}
    assert model.rays_derived
    values = found.findings[0].term.values
    assert values["roll"] == pytest.approx(0.8, abs=0.15)
