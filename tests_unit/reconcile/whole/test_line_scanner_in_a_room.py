"""A scanner of one line on a turntable in a room: its beams are degrees apart, the walls between them are plain."""

import numpy as np
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.view import View
from tests_unit.reconcile.whole.test_seldom_names import columns_of, grid

WALLS = ((0.0, 2.4), (70.0, 1.7), (150.0, 2.9), (215.0, 1.9), (290.0, 3.3))
"""Bearing of each wall's normal, degrees, and its distance from the turntable's axis, metres."""
POST_M, POST_RADIUS_M = np.array([1.1, -0.6]), 0.16


def ranges_m(start, away, *, post=True):
    """Range of every ray in the room, which has five walls and a post or none."""
    far = np.full(len(start), np.inf)
    for bearing, distance in WALLS:
        normal = np.array([np.cos(np.radians(bearing)), np.sin(np.radians(bearing))])
        facing = away @ normal
        far = np.where(facing > 1e-9, np.minimum(far, (distance - start @ normal) / np.maximum(facing, 1e-9)), far)
    to = POST_M - start
    along = np.sum(to * away, axis=1)
    within = POST_RADIUS_M**2 - (np.sum(to**2, axis=1) - along**2)
    return np.where(post & (within > 0.0) & (along > 0.0), along - np.sqrt(np.maximum(within, 0.0)), far)


def turntable(forward_m, left_m, seed=4):
    rng = np.random.default_rng(seed)
    cycle, step, beam = grid(np.arange(5), np.arange(24), np.arange(-40, 41, 4))
    stage = 15.0 * step
    heading = np.radians(stage)
    bearing = heading + np.radians(beam)
    away = np.column_stack([np.cos(bearing), np.sin(bearing)])
    ahead = np.column_stack([np.cos(heading), np.sin(heading)])
    aside = np.column_stack([-np.sin(heading), np.cos(heading)])
    nominal = ranges_m(np.zeros(ahead.shape), away)
    real = ranges_m(forward_m * ahead + left_m * aside, away)
    kept = np.abs(ranges_m(4.0 * (forward_m * ahead + left_m * aside), away) - nominal) < 0.05  # no silhouettes
    measured = real + rng.normal(0.0, 0.006 / 5.0, real.size)
    return columns_of(
        {
            "cycle": cycle[kept], "step": step[kept], "stage_angle_deg": stage[kept],
            "azimuth_deg": beam[kept].astype(float), "n_frames": np.full(kept.sum(), 25.0),
            "sim_distance_m": nominal[kept], "sim_distance_m_std": np.full(kept.sum(), 0.006),
            "sim_distance_m_repeat_std": np.full(kept.sum(), 1e-6), "distance_m": measured[kept],
        },
    )  # fmt: skip


def test_an_optical_centre_off_the_axis_is_told_by_walls_between_sparse_beams():
    (found,) = diagnose(turntable(2e-4, 4e-4))[0].findings
    assert found.effect == "stage.eccentricity"
    told = {p.name: p for p in found.parameters}
    assert told["forward"].value == pytest.approx(2e-4, abs=1.5e-4)
    assert told["right"].value == pytest.approx(4e-4, abs=1.5e-4)


def single_beam(swing_deg, seed=9):
    """A beam that a turntable turns in steps of two degrees; its worm has eighteen turns in one of the table."""
    rng = np.random.default_rng(seed)
    step, place = grid(np.arange(10), np.arange(180))
    stage = 2.0 * place + 0.3
    swung = stage + swing_deg * (np.sin(np.radians(18.0 * stage)) + 0.3 * np.sin(np.radians(36.0 * stage)))

    def far(angle):
        away = np.column_stack([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        return ranges_m(np.zeros(away.shape), away)

    nominal, real = far(stage), far(swung)
    kept = np.maximum(np.abs(far(stage + 0.3) - nominal), np.abs(far(stage - 0.3) - nominal)) < 0.05  # no silhouettes
    measured = real + 4e-4 * rng.normal(size=10)[step] + rng.normal(0.0, 0.004 / 4.0, real.size)
    return columns_of(
        {
            "step": step[kept], "stage_angle_deg": stage[kept], "n_frames": np.full(kept.sum(), 16.0),
            "sim_distance_m": nominal[kept], "sim_distance_m_std": np.full(kept.sum(), 0.004),
            "sim_distance_m_repeat_std": np.full(kept.sum(), 4e-4), "distance_m": measured[kept],
        },
    )  # fmt: skip


def test_a_worm_is_told_by_the_slope_of_walls_between_two_stops():
    (found,) = diagnose(single_beam(0.012))[0].findings
    assert found.effect == "stage.periodic_error"
    told = {p.name: p.value for p in found.parameters}
    assert told["period"] == pytest.approx(20.0, rel=0.01)
    assert np.hypot(told["sine"], told["cosine"]) == pytest.approx(0.012, rel=0.25)


def carried_about(place, step, stop, row, left_m, seed=3):
    """A column of beams on a turntable that is put up at three places within every step."""
    rng = np.random.default_rng(seed)
    position = np.array([-0.4, 0.1, 0.5])[place]
    stage, up = 4.0 * stop, np.radians(3.0 * row - 10.5)
    away = np.column_stack([np.cos(np.radians(stage)), np.sin(np.radians(stage))])
    aside = np.column_stack([-away[:, 1], away[:, 0]])
    start = np.column_stack([position, np.zeros(position.size)])
    nominal, real, far = (
        ranges_m(start + m * aside, away, post=False) / np.cos(up) for m in (0.0, left_m, 8.0 * left_m)
    )
    kept = np.abs(far - nominal) < 0.05  # no silhouettes
    measured = real + 4e-4 * rng.normal(size=3)[step] + rng.normal(0.0, 0.004 / 3.0, real.size)
    return columns_of(
        {
            "step": step[kept], "position_m": position[kept], "stage_angle_deg": stage[kept],
            "azimuth_deg": np.zeros(kept.sum()), "elevation_deg": np.degrees(up[kept]),
            "pixel_v": 7.0 - row[kept], "n_frames": np.full(kept.sum(), 9.0),
            "sim_distance_m": nominal[kept], "sim_distance_m_std": np.full(kept.sum(), 0.004),
            "sim_distance_m_repeat_std": np.full(kept.sum(), 4e-4), "distance_m": measured[kept],
        },
    ), real[kept]  # fmt: skip


def test_beams_that_start_aside_of_the_axis_are_told_from_wherever_they_stand():
    step, place, stop, row = grid(np.arange(3), np.arange(3), np.arange(90), np.arange(6))
    (found,) = diagnose(carried_about(place, step, stop, row, 1e-3)[0])[0].findings
    assert found.effect == "stage.eccentricity"
    told = {p.name: p for p in found.parameters}
    assert told["right"].value == pytest.approx(1e-3, rel=0.25)


def test_walls_are_told_by_the_beams_about_a_beam_and_not_by_those_above_it_alone():
    """A third of the stops is seen from each place: the next beam beside lies four to twenty degrees away."""
    step, stop, row = grid(np.arange(3), np.arange(90), np.arange(8))
    place = np.random.default_rng(5).integers(0, 3, (3, 90))[step, stop]
    table, real = carried_about(place, step, stop, row, 1e-3)
    effect, view = library()["stage.eccentricity"], View(table)
    variant = next(v for v in effect.variants(view) if v.options["frame"] == "sensor")
    state = view.fresh_state()
    effect.apply(variant, {"forward": 0.0, "right": 1e-3}, state, view)
    assert np.mean(np.abs(state["distance_m"] - real) > 2e-4) < 0.03
