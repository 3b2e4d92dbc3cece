"""A condition that no longer holds, a pause, an acknowledgement, and two users of one line: with a guard process."""

import contextlib
import os
import signal

import pytest
from real_processes import assert_safe_within, comes_to_rest, go_on, reap, until

from arl_fixtures.bench.build import open_bench
from arl_fixtures.bench.sweep import sweep
from arl_fixtures.errors import DeviceError, HoldError, InterlockError
from arl_fixtures.guard.acknowledge import acknowledge
from arl_fixtures.guard.runtime import read_stop

pytestmark = pytest.mark.usefixtures("forked_guards")

HOLD = """
  poll_s: 1.0,
  clear_s: 4.0,
  conditions: [{watch: level, floor: 50, action: hold}, {watch: chiller_alarm}]
"""


def test_an_alarm_ends_the_session_and_asks_for_an_acknowledgement(make_stand, run_test):
    stand = make_stand("poll_s: 1.0")
    pid = run_test(stand, go_on)
    # bench time may have run on while we were held up
    alarm_s = stand.inject(f"chiller:chiller_alarm@{stand.inspect()['state']['now_s']}=-4")
    assert reap(pid) == 3
    assert "chiller_alarm: chiller reports error -4" in (stand.runtime / "heard").read_text()
    found = stand.inspect()
    # seen at the next look, and safe 2 s later
    assert_safe_within(found, alarm_s, limit_s=1.0 + 2.0)
    stop = read_stop(stand.places)
    assert stop is not None
    assert stop.blocks
    assert [action["step"] for action in stop.actions][:3] == [
        "laser and DUT power off",
        "safe set-point",
        "stage stopped",
    ]
    with pytest.raises(InterlockError, match=r"chiller reports error -4.*acknowledge with: arl ack"):
        stand.open_guard()
    # the guard has ended, for whoever comes to look needs the lines
    until(lambda: not stand.guard_pid(), "the guard has gone home")
    stand.clear_alarm()
    done = acknowledge(stand.places, who="an engineer", note="coolant refilled")
    assert done.acknowledged["note"] == "coolant refilled"
    with stand.open_guard() as guard:
        assert "chiller reports error -4" in guard.last_stop
    with pytest.raises(InterlockError, match="nothing to acknowledge"):
        acknowledge(stand.places, who="an engineer", note="")


def test_a_pause_is_asked_for_heeded_and_over(make_stand):
    stand = make_stand(HOLD)
    with stand.open_guard() as guard:
        bench = open_bench(stand.config, lines=guard.lines)
        guard.attach(bench)
        bench.start()
        bench.set_temperature_c = 30.0
        bench.soak(10.0)
        start_s = bench.clock.now_s
        stand.inject(f"chiller:low_level@{start_s}/20=40")
        with pytest.raises(HoldError, match=r"coolant level is 40.0 %, below 50 %"):
            bench.soak(20.0)
        assert stand.ask(op="status")["state"] == "holding"
        paused_s = guard.wait_until_clear(bench)
        assert 10.0 < paused_s < 40.0
        guard.check()
        bench.soak(10.0)
        assert bench.close() == []
    comes_to_rest(stand)


def test_a_chiller_that_does_not_answer_does_not_keep_the_power_on(make_stand, run_test):
    stand = make_stand("attempts: 2, poll_s: 1.0, conditions: [{watch: coolant, stale_s: 3}]")
    pid = run_test(stand, go_on)
    before_s = stand.inspect()["state"]["now_s"]
    stand.inject(f"chiller:silence@{before_s}")
    assert reap(pid) in {3, 70}  # the interlock, or the driver's own time-out, whichever the test meets first
    status = stand.wait_for_state("safe", "idle")
    state = stand.inspect()["state"]
    assert not any(state[f"{kind}_{n}"] for kind in ("dut", "laser") for n in (1, 2, 3))
    assert not state["stage_moving"]
    assert "safe set-point" in status["unverified"]
    stop = read_stop(stand.places)
    assert stop is not None
    assert stop.blocks
    assert "could NOT be verified" in str(stop)
    # the device comes back: what was missing is done without anybody asking
    stand.clear_faults()
    until(lambda: not stand.guard_pid(), "the guard has done all it can")
    stop = read_stop(stand.places)
    assert stop is not None
    assert (stop.unverified, stop.blocks) == ({}, True)
    assert stand.inspect()["state"]["setpoint_c"] == 23.0
    acknowledge(stand.places, who="test", note="")


def test_guard_and_test_share_the_lines_without_tearing_an_exchange(make_stand):
    stand = make_stand("poll_s: 0.02")  # as often as it gets a turn
    with stand.open_guard() as guard:
        bench = open_bench(stand.config, lines=guard.lines)
        guard.attach(bench)
        bench.start()
        for turn in range(15):
            target_c = 20.0 + 0.25 * turn
            assert bench.chiller.set_setpoint_c(target_c) == pytest.approx(target_c)
            assert bench.chiller.setpoint_c() == pytest.approx(target_c)
            assert all(reading.value_c is not None for reading in bench.thermometer.read_c()[:5])
            bench.stage.move_to_deg(float(turn % 5))
            bench.stage.wait_until_reached(10.0)
            assert bench.stage.position_deg() == pytest.approx(turn % 5, abs=0.02)
            assert all(bench.relays.states().values())
            bench.clock.sleep(0.1)
        guard.check()
        assert bench.close() == []


@pytest.mark.parametrize("late", ["thermometer:late_reply", "stage:late_reply", "relays:late_reply"])
def test_late_answers_of_one_user_are_never_taken_by_the_other(make_stand, late):
    stand = make_stand("poll_s: 0.25, line_quiet_s: 2.0, conditions: []")
    with stand.open_guard() as guard:
        bench = open_bench(stand.config, lines=guard.lines)
        guard.attach(bench)
        bench.stage.home(60.0)
        bench.relays.set("dut_1", True)
        now_s = bench.clock.now_s
        stand.inject(f"{late}@{now_s}/3=1.2")
        on, seen = True, []
        while bench.clock.now_s < now_s + 8.0:
            on = not on
            # a late answer may cost an attempt; what must never happen is a wrong one
            with contextlib.suppress(DeviceError):
                bench.relays.set("dut_2", on)
                seen.append(bench.relays.states()["dut_2"] == on)
                bench.stage.move_to_deg(5.0 if on else 0.0)
                bench.stage.wait_until_reached(10.0)
                seen.append(abs(bench.stage.position_deg() - (5.0 if on else 0.0)) < 0.02)
                bench.thermometer.read_c()
            bench.clock.sleep(0.2)
        assert len(seen) >= 2
        assert all(seen)
        assert bench.close() == []


def test_a_set_of_frames_longer_than_any_patience_is_neither_a_dead_test_nor_a_mute_dut(make_stand):
    stand = make_stand("poll_s: 1.0, heartbeat_timeout_s: 3.0, conditions: [{watch: duts, stale_s: 2}]")
    with stand.open_guard() as guard:
        bench = open_bench(stand.config, lines=guard.lines)
        guard.attach(bench)
        bench.start()
        ((_, _, _, blocks),) = sweep(bench, [0.0], frames=200)
        assert [len(block.time_ns) for block in blocks.values()] == [200, 200, 200]
        guard.check()
        assert bench.close() == []


def test_a_welded_relay_is_told_by_the_dut_that_goes_on_sending(make_stand, run_test):
    stand = make_stand("poll_s: 1.0")

    def boot_and_go_on(guard, bench):
        bench.soak(15.0)
        (stand.runtime / "booted").touch()
        go_on(guard, bench)

    pid = run_test(stand, boot_and_go_on)
    until((stand.runtime / "booted").exists, "the DUTs send")
    stand.inject("relays:relay_welded#1")
    os.kill(pid, signal.SIGKILL)
    reap(pid)
    stop = until(lambda: (found := read_stop(stand.places)) and "welded" in str(found) and found, "it is noticed")
    assert "ARL-EMU-0001 still sends; its relay may be welded" in str(stop)
    assert "ARL-EMU-0002" not in str(stop)
    assert stop.blocks
    state = stand.inspect()["state"]
    assert state["dut_1"]
    assert not state["dut_2"]
    # it goes on trying, and is done when the contact lets go
    stand.clear_faults()
    until(lambda: not read_stop(stand.places).unverified, "power is off")
    assert not stand.inspect()["state"]["dut_1"]


def test_at_an_orderly_end_a_welded_relay_is_told_to_the_test(make_stand, run_test):
    stand = make_stand("poll_s: 1.0")

    def end(guard, bench):
        bench.soak(15.0)
        stand.inject("relays:relay_welded#2")
        (stand.runtime / "said").write_text("; ".join(bench.close()))

    assert reap(run_test(stand, end)) == 0
    assert "ARL-EMU-0002 still sends; its relay may be welded" in (stand.runtime / "said").read_text()
    with pytest.raises(InterlockError, match="still sends"):
        stand.open_guard()
