from __future__ import annotations

import pytest

from arl_fixtures.errors import DeviceError, DeviceTimeoutError, LocalProtocolError
from arl_fixtures.protocols.tmcl import Axis
from tests_unit.line_bench import LineBench


def homed(**settings: object) -> LineBench:
    bench = LineBench(**settings)
    bench.stage.home(60.0)
    return bench


@pytest.mark.parametrize("sign", [1, -1])
def test_after_homing_the_angle_is_true_in_either_sense_of_rotation(sign: int):
    reference_deg = -75.0 * sign
    bench = homed(
        stage={"clockwise_sign": sign, "reference_angle_deg": reference_deg},
        stage_emulator={"clockwise_sign": sign},
        plant={"stage_start_deg": 31.0},
    )
    for angle_deg in (-60.0, -59.1, 12.3, 70.0):
        bench.stage.move_to_deg(angle_deg)
        bench.stage.wait_until_reached(30.0)
        assert bench.stage.position_deg() == pytest.approx(angle_deg, abs=1e-4)
        assert bench.plant.stage_angle_deg(bench.clock.now_s) == pytest.approx(angle_deg, abs=1e-4)


@pytest.mark.parametrize(("mode", "reference_deg"), [(1, -75.0), (2, -75.0), (5, 0.0)])
@pytest.mark.parametrize("start_deg", [-75.0, -10.0, 60.0])
def test_every_search_mode_finds_its_reference(mode: int, reference_deg: float, start_deg: float):
    bench = homed(
        stage={"search_mode": mode, "reference_angle_deg": reference_deg}, plant={"stage_start_deg": start_deg}
    )
    bench.stage.move_to_deg(10.0)
    bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_angle_deg(bench.clock.now_s) == pytest.approx(10.0, abs=1e-3)


def test_a_step_of_the_sweep_takes_what_physics_takes():
    """0.9° at 100°/s² never reaches 20°/s: 2·√(0.9/100) s, and the driver adds less than 20 ms."""
    bench = homed()
    bench.stage.move_to_deg(0.0)
    bench.stage.wait_until_reached(30.0)
    start_s = bench.clock.now_s
    bench.stage.move_to_deg(0.9)
    stands_since_s = bench.stage.wait_until_reached(30.0)
    assert 0.1897 < bench.clock.now_s - start_s < 0.1897 + 0.02
    assert bench.plant.stage_at_rest(stands_since_s, bench.clock.now_s)


@pytest.mark.parametrize("way_deg", [0.003, 0.9, 1.0, 7.3, 60.0])
@pytest.mark.parametrize("slower", [1.0, 0.6])
def test_it_never_says_that_it_stands_while_it_turns(way_deg: float, slower: float):
    """Not even where the mechanics are slower than the driver believes when it foretells the arrival."""
    bench = homed()
    bench.stage.move_to_deg(0.0)
    bench.stage.wait_until_reached(30.0)
    if slower < 1.0:
        module = bench.stage._module
        module.set_axis(Axis.ACCELERATION, round(slower * module.axis(Axis.ACCELERATION)))
    bench.stage.move_to_deg(way_deg)
    stands_since_s = bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_at_rest(stands_since_s, bench.clock.now_s)
    assert not bench.plant.stage_at_rest(stands_since_s - 0.02, stands_since_s)


def test_it_moves_nowhere_before_it_is_homed_or_beyond_its_limits():
    with pytest.raises(DeviceError, match="not homed"):
        LineBench().stage.move_to_deg(0.0)
    with pytest.raises(LocalProtocolError, match=r"71° is outside -70° … 70°"):
        homed().stage.move_to_deg(71.0)


def test_a_limit_switch_is_named_and_reached_never_comes():
    bench = homed(stage_emulator={"high_switch_deg": 40.0})
    bench.stage.move_to_deg(60.0)
    with pytest.raises(DeviceError, match=r"stands at 40\.000°, stopped by the right limit switch"):
        bench.stage.wait_until_reached(30.0)


def test_a_switch_pressed_on_the_way_stops_at_once():
    bench = homed()
    bench.stage.move_to_deg(60.0)
    bench.clock.sleep(2.0)
    bench.inject("stage", "limit_switch", value=1)
    with pytest.raises(DeviceError, match="stopped by the right limit switch"):
        bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_angle_deg(bench.clock.now_s) < 0.0
    bench.stage.move_to_deg(-65.0)
    bench.stage.wait_until_reached(30.0)


def test_a_stuck_switch_does_not_pass_for_the_reference():
    bench = LineBench()
    bench.inject("stage", "limit_switch", value=-1)
    with pytest.raises(DeviceError, match="left limit switch is pressed at"):
        bench.stage.home(60.0)
    with pytest.raises(DeviceError, match="not homed"):
        bench.stage.move_to_deg(0.0)


@pytest.mark.parametrize("way_deg", [0.9, 30.0])
def test_a_stall_is_noticed_in_short_and_long_moves(way_deg: float):
    bench = homed()
    bench.inject("stage", "stage_stall")
    bench.stage.move_to_deg(-70.0 + way_deg)
    with pytest.raises(DeviceError, match="encoder"):
        bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_angle_deg(bench.clock.now_s) == pytest.approx(-70.0, abs=1e-3)


def test_a_stall_keeps_its_flag_though_reading_clears_it():
    bench = homed()
    bench.inject("stage", "stage_stall")
    bench.stage.move_to_deg(0.0)
    bench.clock.sleep(10.0)
    assert "stalled" in bench.stage.fault()
    assert "stalled" in bench.stage.fault()
    bench.clear()
    bench.stage.home(60.0)
    assert bench.stage.fault() == ""


def test_missed_steps_are_seen_by_the_encoder():
    bench = homed()
    bench.inject("stage", "missed_steps", value=0.3)
    bench.stage.move_to_deg(-60.0)
    with pytest.raises(DeviceError, match=r"missed steps: counter says -60\.000°, encoder -60\.300°"):
        bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_angle_deg(bench.clock.now_s) == pytest.approx(-60.3, abs=1e-3)


def test_homing_again_recovers_lost_steps_of_any_size():
    bench = homed()
    bench.inject("stage", "stage_stall", duration_s=3.0)
    bench.stage.move_to_deg(0.0)
    with pytest.raises(DeviceError, match="stalled"):
        bench.stage.wait_until_reached(30.0)
    bench.clock.sleep(3.0)
    bench.stage.move_to_deg(-40.0)
    with pytest.raises(DeviceError):
        bench.stage.wait_until_reached(30.0)
    bench.stage.home(60.0)
    bench.stage.move_to_deg(-40.0)
    bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_angle_deg(bench.clock.now_s) == pytest.approx(-40.0, abs=1e-3)


def test_without_encoder_missed_steps_go_unseen_until_the_next_homing():
    bench = homed(stage={"encoder": False})
    bench.inject("stage", "missed_steps", value=0.3)
    bench.stage.move_to_deg(-60.0)
    bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_angle_deg(bench.clock.now_s) == pytest.approx(-60.3, abs=1e-3)
    bench.clear()
    bench.stage.home(60.0)
    bench.stage.move_to_deg(-60.0)
    bench.stage.wait_until_reached(30.0)
    assert bench.plant.stage_angle_deg(bench.clock.now_s) == pytest.approx(-60.0, abs=1e-3)


@pytest.mark.parametrize("moment", ["before the move", "during the move"])
def test_a_restart_loses_the_position_and_is_noticed(moment: str):
    bench = homed()
    if moment == "before the move":
        bench.inject("stage", "reset")
        bench.clock.sleep(1.0)
        with pytest.raises(DeviceError, match="it restarted and lost its position"):
            bench.stage.move_to_deg(0.0)
    else:
        bench.stage.move_to_deg(0.0)
        bench.inject("stage", "reset", start_s=bench.clock.now_s + 0.5)
        with pytest.raises(DeviceError, match="it restarted and lost its position"):
            bench.stage.wait_until_reached(30.0)
    with pytest.raises(DeviceError, match="not homed"):
        bench.stage.move_to_deg(0.0)
    bench.stage.home(60.0)
    bench.stage.move_to_deg(0.0)
    bench.stage.wait_until_reached(30.0)


def test_stop_stands_before_it_returns():
    bench = homed()
    bench.stage.move_to_deg(60.0)
    bench.clock.sleep(1.0)
    assert bench.stage.moving()
    bench.stage.stop()
    assert not bench.stage.moving()
    now_s = bench.clock.now_s
    assert bench.plant.stage_at_rest(now_s, now_s + 100.0)


def test_a_wait_that_is_too_short_says_where_it_is():
    bench = homed()
    bench.stage.move_to_deg(60.0)
    with pytest.raises(DeviceTimeoutError, match=r"still moves after 1 s, at -5"):
        bench.stage.wait_until_reached(1.0)


def test_a_search_that_ends_nowhere_is_stopped():
    bench = LineBench(stage={"encoder": False})
    bench.inject("stage", "stage_stall")
    with pytest.raises(DeviceTimeoutError, match="reference not found within 30 s"):
        bench.stage.home(30.0)
    assert not bench.stage.moving()


def test_a_search_mode_the_module_does_not_know_is_refused():
    with pytest.raises(DeviceError, match=r"refused set axis search mode: invalid value \(status 4\)"):
        LineBench(stage={"search_mode": 77}).stage.home(60.0)


def test_a_late_position_is_not_the_current_one():
    bench = homed()
    bench.stage.move_to_deg(60.0)
    bench.inject("stage", "late_reply", duration_s=0.1, value=1.0)
    with pytest.raises(DeviceTimeoutError, match=r"no answer to 'get axis actual' within 0\.25 s"):
        bench.stage.position_deg()
    bench.stage.wait_until_reached(30.0)
    assert bench.stage.position_deg() == pytest.approx(60.0, abs=1e-3)


def test_without_a_nonce_it_waits_until_nothing_can_come_any_more():
    bench = homed(stage={"nonce_variable": None})
    bench.stage.move_to_deg(60.0)
    start_s = bench.clock.now_s
    bench.inject("stage", "late_reply", duration_s=0.1, value=1.0)
    position_deg = bench.stage.position_deg()
    assert bench.clock.now_s - start_s > 3.0
    assert position_deg == pytest.approx(bench.plant.stage_angle_deg(bench.clock.now_s), abs=0.2)


@pytest.mark.parametrize("version_text", [True, False])
def test_identity_in_both_forms(version_text: bool):
    identity = LineBench(stage={"version_text": version_text}).stage.identify()
    assert identity.name == "TMCM-1240"
    assert identity.firmware in {"1.05", "105"}
