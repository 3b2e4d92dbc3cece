"""How high pixels look where a table says only how far aside: told by planes of a room that is traced elsewhere."""

import numpy as np
from rendered_bench import corrected, variant_of
from test_borders_in_pixels import F_PX, HEIGHT, WIDTH, left_at_borders, seen, strewn

from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.derived_rays import derive_rays
from arl_fixtures.reconcile.effects_room import room_of
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.view import View


def without_heights(turn_deg=0.0):
    """The strewn pixels of the traced room; elevations apart."""
    columns = strewn(lambda u, v, stage, _: seen(u, v, stage, turn_deg=turn_deg)[:2], steps=2)
    return columns, columns.numbers.pop("elevation_deg")


def test_planes_tell_how_high_pixels_look():
    columns, elevation = without_heights()
    assert derive_rays(columns)
    pixel_deg = np.degrees(1.0 / F_PX)
    assert np.max(np.abs(columns.derived["elevation_deg"] - elevation)) < 0.05 * pixel_deg


def test_planes_tell_where_pixels_look_that_no_sweep_shows():
    """One stop of the stage: which way its pixels look is in the ranges of a wall, a floor and boards."""
    columns, elevation = without_heights()
    azimuth, stop = columns.numbers.pop("azimuth_deg"), columns.numbers["stage_angle_deg"] == 0.0
    numbers = {name: values[stop] for name, values in columns.numbers.items() if name != "stage_angle_deg"}
    labels = {name: (code[stop], kinds) for name, (code, kinds) in columns.categories.items()}
    picture = Columns(n=int(stop.sum()), numbers=numbers, categories=labels, channels=columns.channels)
    assert derive_rays(picture)
    pixel_deg = np.degrees(1.0 / F_PX)
    for name, angle in {"azimuth_deg": azimuth, "elevation_deg": elevation}.items():
        off = picture.derived[name] - angle[stop]  # the middle of the strewn pixels lies half a pixel aside
        assert np.max(np.abs(off)) < 0.55 * pixel_deg
        assert np.std(off) < 0.1 * pixel_deg


def test_a_picture_of_one_sphere_shows_no_pixel_size():
    columns, _ = without_heights()
    del columns.numbers["azimuth_deg"]
    columns.numbers["stage_angle_deg"] = np.zeros(columns.n)
    columns.numbers["sim_distance_m"] = np.full(columns.n, 4.0)
    assert not derive_rays(columns)


def test_a_log_among_the_images_has_no_rays():
    columns, elevation = without_heights()
    numbers = {name: np.r_[values, np.full(9, np.nan)] for name, values in columns.numbers.items()}
    labels = {name: (np.r_[code, np.full(9, -1)], kinds) for name, (code, kinds) in columns.categories.items()}
    logged = Columns(n=columns.n + 9, numbers=numbers, categories=labels, channels=columns.channels)
    assert derive_rays(logged)
    assert np.max(np.abs(logged.derived["elevation_deg"][:-9] - elevation)) < 0.05 * np.degrees(1.0 / F_PX)


def test_pixels_need_not_be_square():
    columns, elevation = without_heights()
    columns.numbers["pixel_v"] = 0.7 * columns.numbers["pixel_v"] + 3.0
    assert derive_rays(columns)
    assert np.max(np.abs(columns.derived["elevation_deg"] - elevation)) < 0.05 * np.degrees(1.0 / F_PX)


def test_a_room_without_planes_tells_nothing():
    columns, _ = without_heights()
    u, v = columns.numbers["pixel_u"] / WIDTH, columns.numbers["pixel_v"] / HEIGHT
    columns.numbers["sim_distance_m"] = 4.0 + np.sin(7.0 * u) * np.cos(9.0 * v)
    assert not derive_rays(columns)


def test_a_stage_off_its_zero_moves_borders_where_planes_told_the_heights():
    columns, _ = without_heights(turn_deg=0.15)
    assert derive_rays(columns)
    view = View(columns)
    state = corrected(view, variant_of(view, "stage.zero_offset", kind="constant"), zero=0.15)
    assert left_at_borders(view, state, "intensity_counts") < 0.25


def test_pixels_of_an_unknown_height_have_no_borders():
    """Rows in an order of chance, azimuths of no pinhole: nothing tells heights, and nothing is made of that."""
    columns, _ = without_heights()
    columns.numbers["azimuth_deg"] = 1.3 * (columns.numbers["pixel_u"] - (WIDTH - 1) / 2)
    order = np.random.default_rng(3).permutation(columns.n)
    for name, values in columns.numbers.items():
        columns.numbers[name] = values[order]
    for name, (codes, labels) in columns.categories.items():
        columns.categories[name] = (codes[order], labels)
    assert not derive_rays(columns)
    view = View(columns)
    assert room_of(view, scene(view).sign).borders is None
