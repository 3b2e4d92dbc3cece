"""Whatever becomes of the test process, the plant itself shows: power off, set-point safe, stage at rest in 2 s."""

import os
import signal

import pytest
from real_processes import assert_safe_within, comes_to_rest, go_on, is_safe, reap, until


@pytest.fixture(scope="module")
def stand(make_module_stand):
    return make_module_stand("poll_s: 1.0", watch_stopped=True)


def death_of_test(found):
    """Bench time at which the lab lost the test."""
    return max(time_s for time_s, name, value in found["events"] if name == "client lost" and value == "test")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_a_test_killed_at_once(stand, run_test, number):
    pid = run_test(stand, go_on)
    guard = stand.guard_pid()
    before = stand.inspect()["state"]
    assert not is_safe(before)
    os.kill(pid, number)
    assert reap(pid) == -number
    status = stand.wait_for_state("idle")
    assert f"the test (process {pid}) died" in status["cause"]
    found = stand.inspect()
    # on a busy machine the guard may hear of it and act before the lab does
    assert_safe_within(found, death_of_test(found), not_before_s=before["now_s"])
    # the guard is still there for the next test, which is told what happened
    assert stand.guard_pid() == guard
    assert f"process {pid}) died" in status["stop"]


def test_a_test_that_is_stopped_is_as_good_as_dead_and_hears_of_it_when_it_wakes(stand, run_test):
    pid = run_test(stand, go_on)
    not_before_s = stand.inspect()["state"]["now_s"]
    os.kill(pid, signal.SIGSTOP)
    os.waitid(os.P_PID, pid, os.WSTOPPED | os.WNOWAIT)
    since_s = stand.inspect()["state"]["now_s"]
    status = stand.wait_for_state("idle")
    assert "was stopped" in status["cause"]
    assert_safe_within(stand.inspect(), since_s, not_before_s=not_before_s)
    os.kill(pid, signal.SIGCONT)
    assert reap(pid) == 3
    assert "was stopped" in (stand.runtime / "heard").read_text()
    comes_to_rest(stand)


def test_a_test_that_closes_its_connection(stand, run_test):
    def hang_up(guard, bench):
        (stand.runtime / "since").write_text(repr(bench.clock.now_s))
        guard._link._link.close()
        signal.pause()

    pid = run_test(stand, hang_up)
    status = stand.wait_for_state("idle")
    assert "died" in status["cause"]
    assert_safe_within(stand.inspect(), float((stand.runtime / "since").read_text()))
    os.kill(pid, signal.SIGKILL)
    reap(pid)


def test_a_test_that_talks_nonsense(stand, run_test):
    def babble(guard, bench):
        guard._link._link.send({"op": "commanded", "loads": 7})
        signal.pause()

    pid = run_test(stand, babble)
    stand.wait_for_state("idle")
    comes_to_rest(stand)
    os.kill(pid, signal.SIGKILL)
    reap(pid)
    # a request that makes no sense is answered, and costs a passer-by nothing
    answer = stand.ask(op="hello", sha256=stand.config.sha256, lab="seven")
    assert answer is None or "error" in answer
    assert stand.ask(op="status")["state"] == "idle"


def test_ctrl_c_twice(stand, run_test):
    pid = run_test(stand, go_on)
    not_before_s = stand.inspect()["state"]["now_s"]
    os.kill(pid, signal.SIGINT)
    os.kill(pid, signal.SIGINT)
    assert reap(pid) == 70
    # whether the second one hits the good-bye or not: somebody has made it safe
    until(lambda: (stand.ask(op="status") or {"state": "idle"})["state"] == "idle", "the guard is done")
    found = stand.inspect()
    assert_safe_within(found, death_of_test(found), not_before_s=not_before_s)


def test_a_test_that_fails_says_good_bye(stand, run_test):
    def fail(guard, bench):
        raise ZeroDivisionError

    pid = run_test(stand, fail)
    assert reap(pid) == 70
    # an orderly end: safe, nothing to report, and the guard has gone home
    until(lambda: not stand.guard_pid(), "the guard ends")
    comes_to_rest(stand)
    assert not stand.places.driven.exists()


def test_a_test_killed_that_came_before_the_guard_of_the_last_one_had_gone_home(stand, run_test):
    mark = stand.runtime / "second"
    mark.unlink(missing_ok=True)

    def take_over(guard, bench):
        # while its own DUT ports are taken the guard cannot hear whether they are dark, and stays for that
        guard._link.ask("bye")
        with stand.open_guard() as second:
            (stand.runtime / "second").write_text(str(second.pid))
            signal.pause()

    pid = run_test(stand, take_over)
    until(lambda: mark.exists() and mark.read_text(), "the second session is there")
    guard = stand.guard_pid()
    assert guard == int(mark.read_text())
    os.kill(pid, signal.SIGKILL)
    reap(pid)
    since_s = stand.inspect()["state"]["now_s"]
    with stand.witness():
        until(lambda: stand.inspect()["state"]["now_s"] > since_s + 3.0, "bench time passes")
        assert stand.guard_pid() == guard
        assert "died" in stand.wait_for_state("idle")["cause"]


def test_a_main_loop_that_hangs(make_stand, run_test, stand):
    if other := stand.guard_pid():
        # else it would stay for some minutes, with the lines
        os.kill(other, signal.SIGTERM)
        until(lambda: not stand.guard_pid(), "the guard of the other tests has gone home")
    stand = make_stand("heartbeat_timeout_s: 1.0, poll_s: 1.0")

    def hang(guard, bench):
        # no sign of life is later than this
        (stand.runtime / "since").write_text(repr(bench.clock.now_s))
        signal.pause()

    pid = run_test(stand, hang)
    status = stand.wait_for_state("idle")
    assert "no sign of life" in status["cause"]
    since_s = float((stand.runtime / "since").read_text())
    assert_safe_within(stand.inspect(), since_s, limit_s=1.0 + 2.0)
    os.kill(pid, signal.SIGKILL)
    reap(pid)
