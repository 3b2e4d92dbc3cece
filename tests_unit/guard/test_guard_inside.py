"""The guard's conditions inside the test process, on the embedded bench."""

import pytest

from arl_fixtures.bench.build import Emulated, open_bench
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.guard_settings import Action, Condition, GuardSettings
from arl_fixtures.bench.sweep import sweep
from arl_fixtures.emulators.faults import parse_fault
from arl_fixtures.errors import HoldError, InterlockError
from arl_fixtures.guard.acknowledge import acknowledge
from arl_fixtures.guard.guarding import open_guard
from arl_fixtures.guard.inside import InsideGuard
from arl_fixtures.guard.runtime import Places, read_stop

ALARM = Condition(watch="chiller_alarm")
PAUSE = Condition(watch="level", floor=50.0, action=Action.HOLD)
COLD = Condition(watch="plate", ceiling=40.0, action=Action.SOAK_BACK)


@pytest.fixture
def world():
    return Emulated(load_bench("emulated"), VirtualClock())


def guarded(world, *conditions, places=None):
    config = load_bench("emulated").model_copy(update={"guard": GuardSettings(conditions=conditions)})
    config._dut_settings = load_bench("emulated").dut_settings
    guard = InsideGuard(config, places)
    bench = open_bench(config, lines=world)
    guard.attach(bench)
    bench.start()
    return guard, bench


def power(world):
    return [world.plant.powered(dut) or world.plant.laser_on(dut) for dut in range(3)]


def test_an_emulated_bench_is_guarded_inside():
    config = load_bench("emulated")
    with open_guard(config, bench_file="emulated") as guard:
        assert isinstance(guard, InsideGuard)
        assert guard.lines is None


def test_a_trip_makes_the_bench_safe_and_ends_the_session(world):
    guard, bench = guarded(world, ALARM)
    bench.set_temperature_c = 50.0
    bench.soak(60.0)
    assert all(power(world))
    world.plant.faults.inject(parse_fault(f"chiller:chiller_alarm@{bench.clock.now_s}=-7"))
    with pytest.raises(InterlockError, match=r"made safe: chiller_alarm: chiller reports error -7"):
        bench.soak(60.0)
    assert not any(power(world))
    assert world.plant.setpoint_c == bench.config.safe_temperature_c
    assert not world.plant.stage_track.at(bench.clock.now_s)[1]
    with pytest.raises(InterlockError):
        guard.check()
    assert bench.close() == []
    guard.close()


def test_what_cannot_be_verified_is_said(world):
    guard, bench = guarded(world, ALARM)
    bench.chiller.set_setpoint_c(50.0)
    now_s = bench.clock.now_s
    world.plant.faults.inject(parse_fault(f"chiller:chiller_alarm@{now_s}=-7"))
    world.plant.faults.inject(parse_fault(f"chiller:setpoint_ignored@{now_s}=1"))
    with pytest.raises(InterlockError, match=r"could NOT be verified \(safe set-point: .*instead of 23 °C"):
        bench.soak(60.0)
    assert not any(power(world))
    guard.close()


def test_a_pause_ends_by_itself(world):
    guard, bench = guarded(world, PAUSE)
    world.plant.faults.inject(parse_fault(f"chiller:low_level@{bench.clock.now_s}/120=40"))
    with pytest.raises(HoldError) as held:
        bench.soak(60.0)
    assert not held.value.soak_back
    assert guard.wait_until_clear(bench) == pytest.approx(120.0, abs=60.0)
    assert all(power(world))
    bench.soak(60.0)
    assert bench.close() == []
    guard.close()


def test_soak_back_goes_to_the_safe_temperature_and_on(world):
    guard, bench = guarded(world, COLD)
    with pytest.raises(HoldError, match="plate reads 40") as held:
        bench.settle(60.0)
    assert held.value.soak_back
    guard.wait_until_clear(bench)
    assert world.plant.plate_c < 40.0
    assert bench.set_temperature_c == bench.config.safe_temperature_c
    guard.close()


def test_a_pause_that_never_ends_becomes_a_safe_state(world):
    guard, bench = guarded(world, PAUSE)
    world.plant.faults.inject(parse_fault(f"chiller:low_level@{bench.clock.now_s}=40"))
    with pytest.raises(HoldError):
        bench.soak(60.0)
    with pytest.raises(InterlockError, match="still not over after 1800 s"):
        guard.wait_until_clear(bench)
    assert not any(power(world))


def test_a_stop_is_kept_where_hardware_is_real(world, tmp_path):
    places = Places.of("b", tmp_path)
    _, bench = guarded(world, ALARM, places=places)
    world.plant.faults.inject(parse_fault(f"chiller:chiller_alarm@{bench.clock.now_s}/1=-7"))
    with pytest.raises(InterlockError):
        bench.soak(60.0)
    stop = read_stop(places)
    assert stop is not None
    assert stop.blocks
    with pytest.raises(InterlockError, match=r"error -7.*acknowledge with: arl ack"):
        InsideGuard(bench.config, places)
    acknowledge(places, who="x", note="seen")
    assert "error -7" in InsideGuard(bench.config, places).last_stop


def test_a_relay_that_falls_off_is_noticed(world):
    guard, bench = guarded(world, Condition(watch="relays"))
    bench.soak(30.0)
    world.plant.faults.inject(parse_fault(f"relays:reset@{bench.clock.now_s}"))
    with pytest.raises(InterlockError, match=r"dut_1 is off.*against what was commanded"):
        bench.soak(60.0)
    guard.close()


@pytest.mark.parametrize(
    ("fault", "condition"),
    [
        ("chiller:chiller_alarm@{}=-7", ALARM),
        ("chiller:low_level@{}=2", Condition(watch="level", floor=5.0)),
        ("chiller:pump_stop@{}", Condition(watch="pump")),
        ("thermometer:wrong_channel_order@{}=2", Condition(watch="housings", disagreement=3.0)),
    ],
)
@pytest.mark.parametrize(
    "doing", ["settling", "soaking", "sweeping", "turning far", "homing", "taking many frames", "waiting for frames"]
)
def test_two_seconds_after_a_trip_the_bench_is_safe_whatever_it_was_doing(world, fault, condition, doing):
    guard, bench = guarded(world, condition)
    bench.set_temperature_c = 60.0
    bench.soak(400.0)
    bench.stage.move_to_deg(0.0)
    bench.stage.wait_until_reached(60.0)
    since_s = bench.clock.now_s + {"settling": 33.3, "soaking": 33.3, "sweeping": 33.3}.get(doing, 1.1)
    if doing == "waiting for frames":
        for dut in range(3):
            world.plant.faults.inject(parse_fault(f"dut_{dut + 1}:dut_silent@{bench.clock.now_s}"))
    world.plant.faults.inject(parse_fault(fault.format(since_s)))
    work = {
        "settling": lambda: bench.settle(62.0),
        "soaking": lambda: bench.soak(60.0),
        "sweeping": lambda: list(sweep(bench, [0.9 * step for step in range(-60, 60)], frames=10)),
        "turning far": lambda: list(sweep(bench, [-60.0, 60.0], frames=2)),
        "homing": bench.home,
        "taking many frames": lambda: list(sweep(bench, [0.0], frames=200)),
        "waiting for frames": lambda: list(sweep(bench, [0.0], frames=200)),
    }
    with pytest.raises(InterlockError):
        work[doing]()
    assert not any(power(world))
    assert since_s < bench.clock.now_s <= since_s + 2.0
    guard.close()


def test_a_pause_asked_for_while_homing_waits_until_the_bench_is_homed(world):
    guard, bench = guarded(world, PAUSE)
    world.plant.faults.inject(parse_fault(f"chiller:low_level@{bench.clock.now_s}/120=40"))
    bench.home()
    bench.stage.move_to_deg(0.0)
    with pytest.raises(HoldError, match="coolant level"):
        bench.soak(10.0)
    guard.wait_until_clear(bench)
    guard.close()


def test_a_dut_that_is_mute_too_long_for_the_bench_file_pauses_the_bench(world):
    guard, bench = guarded(world, Condition(watch="duts", stale_s=1.5, action=Action.HOLD))
    assert len(list(sweep(bench, [0.0, 0.9], frames=100))) == 2, "frames that come are none that are missing"
    world.plant.faults.inject(parse_fault(f"dut_2:dut_silent@{bench.clock.now_s}"))
    with pytest.raises(HoldError, match=r"no frame of ARL-EMU-0002 for \d\.\d s$"):
        list(sweep(bench, [0.0, 0.9], frames=100))
    guard.close()
