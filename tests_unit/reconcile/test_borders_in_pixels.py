"""Strewn pixels of a camera that see two surfaces each, when their rays turn: against a room that is traced here."""

import numpy as np
import pytest
from rendered_bench import corrected, make_columns, variant_of

from arl_fixtures.reconcile.effects_room import room_of
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.view import View

F_PX, WIDTH, HEIGHT, ACROSS = 40.0, 60, 44, 31
BOARDS = {
    "near": (3.2, -1.3, -0.3, -0.9, 0.8, 0.7),
    "far": (5.1, 0.5, 1.9, -0.7, 1.1, 0.25),
    "low": (4.2, 2.6, 3.5, -1.0, 0.1, 0.5),
}
"""Range ahead, from and to across, from and to upwards, metres; reflectance."""
NAMES = ("wall", "floor", *BOARDS)
DRIFT = 2e-4
"""Of the focal length, 1/K: up to a quarter of a pixel at the image's edge."""
FAR, FLOOR, WHITE = 9.0, -1.3, {"wall": 0.4, "floor": 0.2}


def seen(u, v, stage_deg, *, focal=1.0, turn_deg=0.0, right=0.0):
    """Light, range by light and what each surface fills of pixels; 961 rays each."""
    count = len(NAMES)
    light, moment, share = np.zeros(u.size), np.zeros(u.size), np.zeros((count, u.size))
    steps = (np.arange(ACROSS) - (ACROSS - 1) / 2) / ACROSS
    turned = np.radians(stage_deg)
    ahead_of, beside = -right * np.sin(turned), right * np.cos(turned)
    for du in steps:
        for dv in steps:
            x, z = (u + du - (WIDTH - 1) / 2) / (F_PX * focal), ((HEIGHT - 1) / 2 - v - dv) / (F_PX * focal)
            angle = np.arctan(x) + np.radians(stage_deg + turn_deg)
            level = np.hypot(1.0, x)
            rays = np.stack([np.cos(angle) * level, np.sin(angle) * level, z]) / np.sqrt(1.0 + x * x + z * z)
            best, which, facing = (FAR - ahead_of) / rays[0], np.zeros(u.size, dtype=int), rays[0]
            down = np.where(rays[2] < 0.0, FLOOR / np.minimum(rays[2], -1e-9), np.inf)
            on = down < best
            best, which, facing = np.where(on, down, best), np.where(on, 1, which), np.where(on, -rays[2], facing)
            for number, (ahead, left, right, low, high, _) in enumerate(BOARDS.values(), start=2):
                there = (ahead - ahead_of) / rays[0]
                y, up = beside + there * rays[1], there * rays[2]
                on = (there < best) & (y > left) & (y < right) & (up > low) & (up < high)
                best, which = np.where(on, there, best), np.where(on, number, which)
                facing = np.where(on, rays[0], facing)
            paint = np.array([WHITE["wall"], WHITE["floor"], *(board[-1] for board in BOARDS.values())])[which]
            one = 4e4 * paint * facing / best**2 / ACROSS**2
            light, moment = light + one, moment + one * best
            share[which, np.arange(u.size)] += 1.0 / ACROSS**2
    return light, moment / light, share


def strewn(real, steps=6):
    """Every seventh column and fifth row at five stage angles, at several temperatures."""
    places = np.linspace(-18.0, 18.0, 5), np.arange(1.0, WIDTH, 4.0), np.arange(1.0, HEIGHT, 5.0)
    stage, u, v = (axis.ravel() for axis in np.meshgrid(*places, indexing="ij"))
    light, far, share = seen(u, v, stage)
    heats = np.linspace(0.0, 60.0, steps)
    measured = np.concatenate([real(u, v, stage, celsius) for celsius in heats], axis=1)
    x, z = (u - (WIDTH - 1) / 2) / F_PX, ((HEIGHT - 1) / 2 - v) / F_PX
    once = {
        "stage_angle_deg": stage, "pixel_u": u, "pixel_v": v, "n_frames": np.full(u.size, 20.0),
        "azimuth_deg": np.degrees(np.arctan(x)), "elevation_deg": np.degrees(np.arctan2(z, np.hypot(1.0, x))),
        "sim_intensity_counts": light, "sim_distance_m": far,
        "sim_intensity_counts_std": 0.004 * light, "sim_distance_m_std": np.full(u.size, 0.004),
    }  # fmt: skip
    numbers = {name: np.tile(values, steps) for name, values in once.items()} | {
        "step": np.repeat(np.arange(float(steps)), u.size), "housing_temperature_c": np.repeat(heats, u.size),
        "intensity_counts": measured[0], "distance_m": measured[1],
    }  # fmt: skip
    labels = {
        "dut": np.full(u.size, "A"),
        "surface": np.array(NAMES)[np.argmax(share, axis=0)],
        "mixed": np.where(share.max(axis=0) < 1.0 - 1e-9, "true", "false"),
    }
    return make_columns(numbers, {name: np.tile(values, steps) for name, values in labels.items()})[0]


@pytest.fixture(scope="module")
def expanding():
    """A lens that grows with its temperature."""
    return View(strewn(lambda u, v, stage, celsius: seen(u, v, stage, focal=1.0 + DRIFT * (celsius - 25.0))[:2]))


def left_at_borders(view, state, channel):
    """Share of the squared mismatch that is left in pixels of two surfaces."""
    mixed = view.selects("mixed", "true")
    before, after = ((view.number(channel) - now[channel]) ** 2 for now in (view.sim, state))
    return float(after[mixed].sum() / before[mixed].sum())


@pytest.mark.parametrize("channel", ["intensity_counts", "distance_m"])
def test_a_lens_that_grows_moves_borders_within_pixels(expanding, channel):
    variant = variant_of(expanding, "optics.focal_drift", temperature="housing_temperature_c")
    assert left_at_borders(expanding, corrected(expanding, variant, drift=DRIFT), channel) < 0.25


@pytest.mark.parametrize("channel", ["intensity_counts", "distance_m"])
def test_a_stage_off_its_zero_moves_borders_within_pixels(channel):
    view = View(strewn(lambda u, v, stage, _: seen(u, v, stage, turn_deg=0.15)[:2], steps=2))
    variant = variant_of(view, "stage.zero_offset", kind="constant")
    assert left_at_borders(view, corrected(view, variant, zero=0.15), channel) < 0.25


@pytest.mark.parametrize("channel", ["intensity_counts", "distance_m"])
def test_a_camera_off_the_axis_sees_borders_elsewhere_in_its_pixels(channel):
    view = View(strewn(lambda u, v, stage, _: seen(u, v, stage, right=0.012)[:2], steps=2))
    state = corrected(view, variant_of(view, "stage.eccentricity", frame="sensor"), right=0.012, forward=0.0)
    assert left_at_borders(view, state, channel) < 0.25


def test_a_pixel_that_sees_one_surface_has_no_edge_in_it(expanding):
    variant = variant_of(expanding, "optics.focal_drift", temperature="housing_temperature_c")
    state = corrected(expanding, variant, drift=DRIFT)
    light = expanding.sim["intensity_counts"]
    pure = ~expanding.selects("mixed", "true")
    assert np.max(np.abs(state["intensity_counts"] / light - 1.0)[pure]) < 0.1


def test_of_a_border_light_and_range_must_both_tell(expanding):
    """A simulation that shows the nearest surface's range in mixed pixels is not taken for one of means."""
    assert room_of(expanding, scene(expanding).sign).borders.known.any()
    columns = strewn(lambda u, v, stage, _: seen(u, v, stage)[:2], steps=2)
    mixed = columns.categories["mixed"][0] == columns.categories["mixed"][1].index("true")
    columns.numbers["sim_distance_m"][mixed] *= 0.8
    view = View(columns)
    room = room_of(view, scene(view).sign)
    assert room.borders is None or room.borders.known.sum() < 0.1 * mixed.sum()
