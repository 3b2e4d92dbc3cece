from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from arl_fixtures.emulators.motion import Piece, Track, plan_move, plan_stop

degrees = st.floats(-150.0, 150.0)
speeds = st.floats(-40.0, 40.0)
limits = st.floats(1.0, 40.0)
accelerations = st.floats(10.0, 500.0)


def plan(x: float, v: float, target: float, speed: float, a: float, *, start_s: float = 5.0) -> list[Piece]:
    return plan_move(
        start_s=start_s, position_deg=x, velocity_deg_s=v, target_deg=target, speed_deg_s=speed, acceleration_deg_s2=a
    )


@given(degrees, speeds, degrees, limits, accelerations)
def test_a_move_is_smooth_within_its_limits_and_ends_at_the_target(x, v, target, speed, a):
    pieces = plan(x, v, target, speed, a)
    assert pieces[0].start_s == 5.0
    assert pieces[0].position_deg == pytest.approx(x, abs=1e-9)
    assert pieces[-1].stands
    assert pieces[-1].position_deg == target
    for piece, following in itertools.pairwise(pieces):
        position_deg, velocity_deg_s = piece.at(following.start_s)
        assert position_deg == pytest.approx(following.position_deg, abs=1e-6)
        assert velocity_deg_s == pytest.approx(following.velocity_deg_s, abs=1e-6)
        assert abs(piece.acceleration_deg_s2) <= a * (1 + 1e-12)
        assert max(abs(piece.velocity_deg_s), abs(velocity_deg_s)) <= max(abs(v), speed) + 1e-9


@given(degrees, degrees, limits, accelerations)
def test_from_rest_to_rest_it_takes_the_shortest_possible_time(x, target, speed, a):
    way = abs(target - x)
    assume(way > 1e-6)
    shortest_s = 2.0 * math.sqrt(way / a) if way <= speed**2 / a else way / speed + speed / a
    assert plan(x, 0.0, target, speed, a)[-1].start_s - 5.0 == pytest.approx(shortest_s, rel=1e-9)


@given(degrees, speeds, accelerations)
def test_braking_takes_the_braking_distance(x, v, a):
    pieces = plan_stop(start_s=0.0, position_deg=x, velocity_deg_s=v, acceleration_deg_s2=a)
    assert pieces[-1].stands
    assert pieces[-1].position_deg == pytest.approx(x + v * abs(v) / (2.0 * a), abs=1e-9)


@given(degrees, speeds, degrees, limits, accelerations, degrees, st.sampled_from([1, -1]))
def test_the_first_time_beyond_a_level_is_what_sampling_finds(x, v, target, speed, a, level, direction):
    track = Track(x)
    track.replace(5.0, plan(x, v, target, speed, a))
    assume(abs(level - x) > 1e-3)
    found_s = track.first_time_beyond(level, direction, 5.0)
    samples = [5.0 + (track.end_s - 5.0) * n / 300.0 for n in range(301)]
    beyond = [
        time_s
        for time_s in samples
        if (track.at(time_s)[0] - level) * direction > 1e-6 and track.at(time_s)[1] * direction > 1e-6
    ]
    if found_s == math.inf:
        assert not beyond
        return
    position_deg, _ = track.at(found_s)
    assert (position_deg - level) * direction >= -1e-6
    assert all(time_s >= found_s - 1e-9 for time_s in beyond)


def test_the_past_is_kept_and_the_plan_is_replaced():
    track = Track(0.0)
    track.replace(10.0, plan(0.0, 0.0, 100.0, 10.0, 10.0, start_s=10.0))
    position_deg, velocity_deg_s = track.at(13.0)
    assert (position_deg, velocity_deg_s) == (25.0, 10.0)
    track.halt(13.0)
    assert track.at(12.0) == (15.0, 10.0)
    assert track.at(99.0) == (25.0, 0.0)
    assert track.at(-99.0) == (0.0, 0.0)
    assert track.at_rest(0.0, 9.0)
    assert not track.at_rest(0.0, 10.5)
    assert not track.at_rest(12.9, 13.1)
    assert track.at_rest(13.0, 1000.0)


def test_positions_can_be_relabelled_in_the_middle_of_a_move():
    track = Track(0.0)
    track.replace(0.0, plan(0.0, 0.0, 100.0, 10.0, 10.0, start_s=0.0))
    track.shift(5.0, -45.0)
    assert track.at(5.0) == (pytest.approx(0.0), pytest.approx(10.0))
    assert track.end_deg == pytest.approx(55.0)
    assert track.at(4.0)[0] == pytest.approx(35.0)


def test_many_moves_do_not_grow_without_bound():
    track, end_s = Track(0.0), 0.0
    for n in range(2000):
        track.replace(end_s, plan(track.end_deg, 0.0, float(n % 100), 20.0, 100.0, start_s=end_s))
        end_s = track.end_s + 1.0
    assert len(track._pieces) < 100
    assert track.at(end_s)[0] == 99.0
