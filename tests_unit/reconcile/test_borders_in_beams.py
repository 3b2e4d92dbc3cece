"""Beams in one line of which some see two surfaces, when their rays turn: against a hall that is traced here."""

import numpy as np
import pytest
from rendered_bench import corrected, make_columns, variant_of

from arl_fixtures.reconcile.effects_room_beams import borders_in_line
from arl_fixtures.reconcile.view import View

GAP_DEG, ACROSS, FAR, BESIDE = 0.62, 201, 4.5, 2.6
BEAMS = (np.arange(72.0) - 35.5) * GAP_DEG * (1.0 + 4e-4 * np.abs(np.arange(72.0) - 35.5))
BOARDS = {"grey": (3.4, -1.9, -1.1, 0.45), "white": (2.9, 0.2, 0.9, 0.85), "black": (3.8, 1.6, 2.2, 0.08)}
"""Range ahead, from and to across, metres; reflectance."""
NAMES = ("wall", "side", *BOARDS)
STAGE = np.array([-23.0, -11.0, 0.0, 7.0, 19.0])


def seen(azimuth_deg, stage_deg, *, wide=0.95, forward=0.0, right=0.0):
    """Light, range by light and surface in the middle, of beams `wide` gaps wide, from off the axis (metres)."""
    stage = np.radians(stage_deg)
    c, s = np.cos(stage), np.sin(stage)
    here = forward * c - right * s, forward * s + right * c
    light, moment, middle = np.zeros(azimuth_deg.size), np.zeros(azimuth_deg.size), None
    for part in (np.arange(ACROSS) - (ACROSS - 1) / 2) / ACROSS:
        angle = np.radians(azimuth_deg + stage_deg + part * wide * GAP_DEG)
        x, y = np.cos(angle), np.sin(angle)
        best, which, facing = (FAR - here[0]) / x, np.zeros(x.size, dtype=int), x
        side = np.where(y > 0.0, (BESIDE - here[1]) / np.maximum(y, 1e-9), np.inf)
        on = side < best
        best, which, facing = np.where(on, side, best), np.where(on, 1, which), np.where(on, y, facing)
        for number, (ahead, left, end, _) in enumerate(BOARDS.values(), start=2):
            there = (ahead - here[0]) / x
            across = here[1] + there * y
            on = (there < best) & (across > left) & (across < end)
            best, which, facing = np.where(on, there, best), np.where(on, number, which), np.where(on, x, facing)
        paint = np.array([0.35, 0.5, *(board[-1] for board in BOARDS.values())])[which]
        one = 6e3 * paint * facing / best**2 / ACROSS
        light, moment = light + one, moment + one * best
        middle = which if part == 0.0 else middle
    return light, moment / light, middle


def hall(real, *, named=True, **simulated):
    """A sweep of the stage in both directions."""
    azimuth, stage = (axis.ravel() for axis in np.meshgrid(BEAMS, STAGE))
    light, far, surface = seen(azimuth, stage, **simulated)
    twice = {
        "stage_angle_deg": stage, "azimuth_deg": azimuth, "n_frames": np.full(stage.size, 20.0),
        "sim_intensity_counts": light, "sim_distance_m": far,
        "sim_intensity_counts_std": 0.01 * light, "sim_distance_m_std": np.full(stage.size, 0.01),
    }  # fmt: skip
    measured = [real(azimuth, stage, way) for way in (-1.0, 1.0)]
    numbers = {name: np.tile(values, 2) for name, values in twice.items()} | {
        "travel_direction": np.repeat([-1.0, 1.0], stage.size),
        "intensity_counts": np.concatenate([one[0] for one in measured]),
        "distance_m": np.concatenate([one[1] for one in measured]),
    }
    labels = {"surface": np.tile(np.array(NAMES)[surface], 2)} if named else {}
    return View(make_columns(numbers, labels)[0])


def error_at_borders(view, state, channel):
    """Median relative error of what changes most: in beams at borders."""
    real, told = view.number(channel) - view.sim[channel], state[channel] - view.sim[channel]
    most = np.abs(real) > 0.1 * np.abs(real).max()
    return float(np.median(np.abs(told - real)[most] / np.abs(real)[most]))


@pytest.mark.parametrize("named", [True, False], ids=["named", "by ranges"])
@pytest.mark.parametrize("channel", ["intensity_counts", "distance_m"])
def test_a_backlash_moves_borders_within_beams(channel, named):
    view = hall(lambda azimuth, stage, way: seen(azimuth, stage + 0.02 * way)[:2], named=named)
    state = corrected(view, variant_of(view, "stage.zero_offset", kind="backlash"), backlash=0.04)
    assert error_at_borders(view, state, channel) < 0.25


@pytest.mark.parametrize("wide", [0.5, 0.95])
def test_how_wide_beams_are_is_told_by_how_many_borders_lie_in_one(wide):
    """The intensity at borders of beams half as wide changes twice as much."""
    view = hall(lambda azimuth, stage, way: seen(azimuth, stage + 0.02 * way, wide=wide)[:2], wide=wide)
    found = borders_in_line(view, np.zeros(view.n, dtype=np.int64))
    told = 1.0 / np.abs(found.across[found.known, 0]) / GAP_DEG
    assert told == pytest.approx(wide, abs=0.2)


@pytest.mark.parametrize("channel", ["intensity_counts", "distance_m"])
def test_a_sensor_off_the_axis_sees_borders_of_near_boards_elsewhere(channel):
    view = hall(lambda azimuth, stage, way: seen(azimuth, stage, right=2e-3)[:2])
    state = corrected(view, variant_of(view, "stage.eccentricity", frame="sensor"), right=2e-3, forward=0.0)
    assert error_at_borders(view, state, channel) < 0.25


def test_thin_beams_tell_no_shares():
    view = hall(lambda azimuth, stage, way: seen(azimuth, stage, wide=0.05)[:2], wide=0.05)
    assert borders_in_line(view, np.zeros(view.n, dtype=np.int64)) is None


def test_beams_that_do_not_lie_side_by_side_tell_no_borders():
    """A table of every fourth beam: what lies between two of them is not in it."""
    view = hall(lambda azimuth, stage, way: seen(azimuth, stage + 0.02 * way)[:2])
    held = np.isin(view.number("azimuth_deg"), BEAMS[::4])
    few = {name: values[held] for name, values in view.columns.numbers.items()}
    few["pixel_u"] = np.searchsorted(BEAMS, few["azimuth_deg"]).astype(float)
    surface = view.columns.categories["surface"]
    kept = np.array(surface[1])[surface[0]][held]
    thinned = View(make_columns(few, {"surface": kept})[0])
    assert borders_in_line(thinned, np.zeros(thinned.n, dtype=np.int64)) is None
