from __future__ import annotations

import itertools

import pytest

from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.emulators.stage import StageEmulator, StageEmulatorSettings
from arl_fixtures.protocols import tmcl
from arl_fixtures.protocols.tmcl import Axis, Command, MoveType, Request, SearchType, StatusCode
from tests_unit.line_bench import ask_raw

STEPS_PER_DEG = 10_240


def stage(**settings: object) -> tuple[StageEmulator, Plant]:
    plant = Plant()
    return StageEmulator(plant, settings=StageEmulatorSettings(**settings)), plant


def do(
    device: StageEmulator, command: int, kind: int = 0, value: int = 0, now_s: float = 0.0, *, status: int = 100
) -> int:
    answer = ask_raw(device, tmcl.encode_request(Request(1, command, kind, 0, value)), now_s)
    reply = tmcl.find_reply(answer, host=2, module=1, command=command)
    assert reply is not None
    assert reply.status == status
    return reply.value


def axis(device: StageEmulator, parameter: Axis, now_s: float) -> int:
    return do(device, Command.GET_AXIS, parameter, now_s=now_s)


def move(device: StageEmulator, angle_deg: float, now_s: float) -> None:
    do(device, Command.MOVE, MoveType.ABSOLUTE, round(angle_deg * STEPS_PER_DEG), now_s)


def test_the_published_bytes():
    device, _ = stage()
    assert ask_raw(device, bytes.fromhex("01 04 00 00 00 00 C8 00 CD")) == bytes.fromhex("02 01 64 04 00 00 C8 00 33")
    assert ask_raw(device, bytes.fromhex("01 04 00 00 00 00 C8 00 CE")) == bytes.fromhex("02 01 01 04 00 00 00 00 08")
    device, _ = stage()
    ask_raw(device, bytes.fromhex("01 05 01 00 FF FF FC 18 19"))
    assert ask_raw(device, bytes.fromhex("01 06 01 00 00 00 00 00 08")) == bytes.fromhex("02 01 64 06 FF FF FC 18 7F")


def test_the_reply_to_a_move_comes_at_its_start():
    device, _ = stage()
    (answer,) = device.receive(tmcl.encode_request(Request(1, Command.MOVE, 0, 0, 60 * STEPS_PER_DEG)), 0.0)
    assert answer.time_s < 0.01
    assert axis(device, Axis.REACHED, 1.0) == 0
    assert axis(device, Axis.ACTUAL_SPEED, 1.0) == 20 * STEPS_PER_DEG
    assert axis(device, Axis.REACHED, 3.1) == 0
    assert axis(device, Axis.REACHED, 3.3) == 1
    assert axis(device, Axis.ACTUAL, 3.3) == 60 * STEPS_PER_DEG


def test_speed_and_acceleration_are_what_was_set():
    device, plant = stage()
    do(device, Command.SET_AXIS, Axis.MAX_SPEED, 5 * STEPS_PER_DEG)
    do(device, Command.SET_AXIS, Axis.ACCELERATION, 10 * STEPS_PER_DEG)
    move(device, 20.0, 0.0)
    assert plant.stage_angle_deg(0.25) == pytest.approx(0.5 * 10 * 0.25**2)
    assert plant.stage_angle_deg(2.0) == pytest.approx(1.25 + 5 * 1.5)
    assert plant.stage_angle_deg(4.5) == pytest.approx(20.0)
    assert not plant.stage_at_rest(4.4, 4.6)
    assert plant.stage_at_rest(4.5, 9.0)


def test_a_new_target_in_the_middle_of_a_move_turns_it_round_smoothly():
    device, plant = stage()
    move(device, 60.0, 0.0)
    move(device, -10.0, 1.0)
    angles_deg = [plant.stage_angle_deg(n / 100.0) for n in range(600)]
    speeds_deg_s = [(b - a) * 100.0 for a, b in itertools.pairwise(angles_deg)]
    assert max(abs(b - a) for a, b in itertools.pairwise(speeds_deg_s)) <= 100.0 / 100.0 + 1e-6
    assert axis(device, Axis.ACTUAL, 6.0) == -10 * STEPS_PER_DEG


def test_at_a_limit_switch_it_stops_and_reached_never_comes():
    device, plant = stage(high_switch_deg=30.0)
    move(device, 60.0, 0.0)
    assert axis(device, Axis.RIGHT_SWITCH, 1.0) == 0
    for now_s in (10.0, 1000.0):
        assert axis(device, Axis.REACHED, now_s) == 0
        assert axis(device, Axis.ACTUAL_SPEED, now_s) == 0
        assert axis(device, Axis.RIGHT_SWITCH, now_s) == 1
        assert axis(device, Axis.ACTUAL, now_s) == 30 * STEPS_PER_DEG
    move(device, 0.0, 1000.0)
    assert axis(device, Axis.REACHED, 1010.0) == 1
    assert axis(device, Axis.RIGHT_SWITCH, 1010.0) == 0
    assert plant.stage_angle_deg(1010.0) == pytest.approx(0.0)


def test_a_soft_stop_overruns_the_switch_by_the_braking_distance():
    device, plant = stage(high_switch_deg=30.0)
    do(device, Command.SET_AXIS, Axis.SOFT_STOP, 1)
    move(device, 60.0, 0.0)
    assert plant.stage_angle_deg(10.0) == pytest.approx(30.0 + 20.0**2 / (2 * 100.0))


def test_a_disabled_switch_does_not_stop():
    device, plant = stage(high_switch_deg=30.0)
    do(device, Command.SET_AXIS, Axis.RIGHT_DISABLE, 1)
    move(device, 60.0, 0.0)
    assert plant.stage_angle_deg(10.0) == pytest.approx(60.0)


@pytest.mark.parametrize(("mode", "zero_deg"), [(1, -75.0), (2, -75.0), (5, 0.0)])
def test_a_reference_search_sets_zero_at_its_switch(mode: int, zero_deg: float):
    device, plant = stage()
    move(device, 33.0, 0.0)
    do(device, Command.SET_AXIS, Axis.SEARCH_MODE, mode, 10.0)
    do(device, Command.REFERENCE_SEARCH, SearchType.START, now_s=10.0)
    assert do(device, Command.REFERENCE_SEARCH, SearchType.STATUS, now_s=10.1) == 1
    do(device, Command.MOVE, MoveType.ABSOLUTE, 7, 10.2, status=StatusCode.NOT_AVAILABLE)
    assert do(device, Command.REFERENCE_SEARCH, SearchType.STATUS, now_s=60.0) == 0
    assert axis(device, Axis.ACTUAL, 60.0) == 0
    assert axis(device, Axis.REACHED, 60.0) == 1
    assert plant.stage_angle_deg(60.0) == pytest.approx(zero_deg)


def test_a_stopped_search_sets_nothing():
    device, _ = stage()
    do(device, Command.REFERENCE_SEARCH, SearchType.START)
    do(device, Command.REFERENCE_SEARCH, SearchType.STOP, now_s=2.0)
    assert do(device, Command.REFERENCE_SEARCH, SearchType.STATUS, now_s=3.0) == 0
    assert axis(device, Axis.ACTUAL, 100.0) < -15 * STEPS_PER_DEG


def test_rotation_goes_on_until_stopped():
    device, plant = stage()
    do(device, Command.ROTATE_LEFT, value=10 * STEPS_PER_DEG)
    assert plant.stage_angle_deg(2.0) == pytest.approx(-19.5)
    do(device, Command.STOP, now_s=2.0)
    assert plant.stage_angle_deg(9.0) == pytest.approx(-20.0)
    assert axis(device, Axis.REACHED, 9.0) == 0


@pytest.mark.parametrize(("command", "kind", "value", "status"), [
    (77, 0, 0, StatusCode.INVALID_COMMAND),
    (Command.GET_AXIS, 99, 0, StatusCode.WRONG_TYPE),
    (Command.SET_AXIS, Axis.REACHED, 1, StatusCode.WRONG_TYPE),
    (Command.SET_AXIS, Axis.MAX_SPEED, -1, StatusCode.INVALID_VALUE),
    (Command.SET_AXIS, Axis.MICROSTEP_RESOLUTION, 9, StatusCode.INVALID_VALUE),
    (Command.MOVE, 9, 0, StatusCode.WRONG_TYPE),
    (Command.GET_VERSION, 9, 0, StatusCode.WRONG_TYPE),
    (Command.REFERENCE_SEARCH, 9, 0, StatusCode.WRONG_TYPE),
    (Command.NOTIFY_REACHED, 0, 1, StatusCode.NOT_AVAILABLE),
])  # fmt: skip
def test_refusals_have_their_status(command: int, kind: int, value: int, status: int):
    do(stage()[0], command, kind, value, status=status)


def test_frames_for_others_and_half_frames_are_forgotten():
    device, _ = stage()
    assert ask_raw(device, tmcl.encode_request(Request(7, Command.STOP))) == b""
    assert ask_raw(device, b"\x01\x06\x01", 1.0) == b""
    assert ask_raw(device, tmcl.encode_request(Request(1, Command.GET_AXIS, Axis.ACTUAL)), 2.0) != b""


def test_fewer_microsteps_make_fewer_counts():
    device, plant = stage()
    do(device, Command.SET_AXIS, Axis.MICROSTEP_RESOLUTION, 4)
    do(device, Command.SET_AXIS, Axis.MAX_SPEED, 20 * STEPS_PER_DEG // 16)
    do(device, Command.SET_AXIS, Axis.ACCELERATION, 100 * STEPS_PER_DEG // 16)
    do(device, Command.MOVE, MoveType.ABSOLUTE, 30 * STEPS_PER_DEG // 16)
    assert plant.stage_angle_deg(10.0) == pytest.approx(30.0)


def test_a_stall_stops_the_motor_where_the_encoder_says_so():
    device, plant = stage()
    do(device, Command.SET_AXIS, Axis.MAX_ENCODER_DEVIATION, STEPS_PER_DEG)
    move(device, 60.0, 0.0)
    plant.faults.inject(Fault(device="stage", kind="stage_stall", start_s=1.0))
    assert axis(device, Axis.ACTUAL_SPEED, 5.0) == 0
    stuck_deg = plant.stage_angle_deg(5.0)
    assert stuck_deg == pytest.approx(18.0, abs=0.01)
    assert axis(device, Axis.ACTUAL, 5.0) == pytest.approx((stuck_deg + 1.0) * STEPS_PER_DEG, abs=2)
    assert axis(device, Axis.ERROR_FLAGS, 5.0) == tmcl.ErrorFlag.DEVIATION
    assert axis(device, Axis.ERROR_FLAGS, 5.1) == 0, "cleared by reading"


def test_freed_in_the_middle_of_a_move_the_steps_stay_lost():
    device, plant = stage()
    plant.faults.inject(Fault(device="stage", kind="stage_stall", start_s=1.0, duration_s=0.5))
    move(device, 60.0, 0.0)
    plant.advance(0.9)
    plant.advance(20.0)
    assert axis(device, Axis.ACTUAL, 20.0) == 60 * STEPS_PER_DEG
    lost_deg = 60.0 - plant.stage_angle_deg(20.0)
    assert lost_deg == pytest.approx(10.0, abs=0.5)
    assert axis(device, Axis.ENCODER, 20.0) == pytest.approx((60.0 - lost_deg) * STEPS_PER_DEG, abs=2)


def test_a_reset_stands_still_and_forgets():
    device, plant = stage()
    do(device, Command.SET_AXIS, Axis.MAX_SPEED, 1234)
    move(device, 60.0, 0.0)
    device.reset(1.0)
    assert plant.stage_at_rest(1.0, 99.0)
    assert axis(device, Axis.ACTUAL, 2.0) == 0
    assert axis(device, Axis.MAX_SPEED, 2.0) == 20 * STEPS_PER_DEG
