"""Where the guard dies with its test, nobody starts anything: the plant itself shows that it is safe in 2 s."""

import contextlib
import json
import os
import select
import signal
import time
from pathlib import Path

import pytest
from real_processes import LEASE_S, assert_safe_within, fork, go_on, is_safe, reap, until, zombie

from arl_fixtures.bench.guard_settings import GuardSettings
from arl_fixtures.guard import sentinel as sentinel_room
from arl_fixtures.guard.runtime import Lease, Places, process_state, read_stop
from arl_fixtures.guard.sentinel import Sentinel, Watch

pytestmark = pytest.mark.usefixtures("forked_guards")


@pytest.fixture
def stand(make_stand):
    # a living test has that long, too, before a sentinel takes it for one that hangs
    return make_stand("poll_s: 1.0, heartbeat_timeout_s: 300", watch_stopped=True)


def stands_by(stand):
    return stand.ask(op="status")["sentinel"]


def kill(*pids):
    # 0 would be all of us
    assert all(pids)
    for pid in pids:
        os.kill(pid, signal.SIGKILL)


def gone(pid):
    return not Path(f"/proc/{pid}").exists() or zombie(pid)


def left_alone(stand, *pids):
    """Kill these, and see that somebody comes, makes the bench safe and goes; gives what the plant says."""
    with stand.witness():
        kill(*pids)
        until(lambda: not stand.places.driven.exists(), "the bench is safe")
    return came_and_went(stand)


def came_and_went(stand):
    """Wait until whoever came has made the bench safe and has gone; gives what the plant says."""
    until(lambda: not stand.places.driven.exists(), "the bench is safe")
    until(lambda: not stand.guard_pid(), "whoever made it safe has gone")
    return stand.inspect()


def lost_s(found, name, *, of):
    return [time_s for time_s, what, value in found["events"] if what == "client lost" and value == name][of]


def log_of(stand, what):
    entries = map(json.loads, stand.places.log.read_text().splitlines())
    return [entry for entry in entries if entry["what"] == what]


@pytest.mark.parametrize("order", ["guard first", "test first"])
def test_test_and_guard_killed_together(stand, run_test, order):
    pid = run_test(stand, go_on)
    guard, sentinel = stand.guard_pid(), stands_by(stand)
    before = stand.inspect()["state"]
    assert not is_safe(before)
    found = left_alone(stand, *((guard, pid) if order == "guard first" else (pid, guard)))
    reap(pid)
    # the guard that came has been lost, too, after it had gone home
    since_s = max(lost_s(found, "test", of=-1), lost_s(found, "guard", of=-2))
    assert_safe_within(found, since_s, not_before_s=before["now_s"])
    stop = read_stop(stand.places)
    assert not stop.unverified
    assert not stop.blocks
    assert "the guard died while" in stop.cause
    until(lambda: gone(sentinel), "the sentinel ends with its purpose")
    assert len(log_of(stand, "nobody is left: the next guard is called")) == 1
    # the next session needs nothing but to be told
    with stand.open_guard() as again:
        assert "the guard died while" in again.last_stop


def test_a_stopped_test_is_no_help_when_its_guard_dies(stand, run_test):
    pid = run_test(stand, go_on)
    guard, before = stand.guard_pid(), stand.inspect()["state"]
    os.kill(guard, signal.SIGSTOP)
    os.kill(pid, signal.SIGSTOP)
    with stand.witness():
        kill(guard)
        until(lambda: not stand.places.driven.exists(), "the bench is safe")
    # who came stays until it could listen at the DUTs' ports, which a stopped test still holds
    kill(pid)
    reap(pid)
    found = came_and_went(stand)
    assert_safe_within(found, lost_s(found, "guard", of=-2), not_before_s=before["now_s"])


def test_a_guard_that_hangs_while_its_test_dies_is_replaced_when_its_lease_is_over(stand, run_test):
    pid = run_test(stand, go_on)
    guard = stand.guard_pid()
    os.kill(guard, signal.SIGSTOP)
    kill(pid)
    reap(pid)
    assert stand.places.driven.exists(), "it may come to itself yet"
    stand.end_lease()
    found = came_and_went(stand)
    assert is_safe(found["state"])
    assert gone(guard)


def test_a_sentinel_that_dies_is_replaced(stand, run_test):
    pid = run_test(stand, go_on)
    first = stands_by(stand)
    kill(first)
    second = until(lambda: (now := stands_by(stand)) not in {0, first} and now, "the guard posts another")
    assert stand.ask(op="status")["state"] == "armed"
    found = left_alone(stand, pid, stand.guard_pid())
    reap(pid)
    assert_safe_within(found, max(lost_s(found, "test", of=-1), lost_s(found, "guard", of=-2)))
    until(lambda: gone(second), "the sentinel ends with its purpose")


def test_guard_and_sentinel_killed_leave_it_to_the_test(stand, run_test):
    pid = run_test(stand, go_on)
    kill(stands_by(stand), stand.guard_pid())
    assert reap(pid) == 3
    found = stand.inspect()
    assert_safe_within(found, lost_s(found, "guard", of=-1), limit_s=1.0 + 2.0)
    assert stand.places.driven.exists()


def test_after_a_test_that_made_safe_itself_the_next_guard_verifies_and_reports_it(stand, run_test):
    pid = run_test(stand, go_on)
    kill(stand.guard_pid())
    assert reap(pid) == 3
    found = came_and_went(stand)
    assert_safe_within(found, lost_s(found, "guard", of=-2), limit_s=1.0 + 2.0)
    assert read_stop(stand.places).unverified == {}
    # it waited until the test was done with the lines
    come_s = max(time_s for time_s, what, who in found["events"] if what == "client joined" and who == "guard")
    assert come_s >= lost_s(found, "test", of=-1)


def test_what_a_guard_could_not_verify_before_it_died_is_tried_on_by_the_next(make_stand, run_test):
    stand = make_stand("attempts: 1, poll_s: 1.0")
    pid = run_test(stand, go_on)
    stand.inject(f"relays:silence@{stand.inspect()['state']['now_s']}")
    kill(pid)
    reap(pid)
    stand.wait_for_state("safe")
    first = stand.guard_pid()
    kill(first)
    second = until(lambda: (now := stand.guard_pid()) not in {0, first} and now, "another one comes")
    assert not is_safe(stand.inspect()["state"])
    stand.clear_faults()
    found = came_and_went(stand)
    assert is_safe(found["state"])
    stop = read_stop(stand.places)
    # somebody must look all the same, as the first one had said
    assert (stop.unverified, stop.blocks) == ({}, True)
    assert gone(second)


def test_a_guard_that_is_told_to_end_stays_away_though_it_could_not_verify_all(make_stand, run_test):
    stand = make_stand("attempts: 1, poll_s: 1.0")
    pid = run_test(stand, go_on)
    sentinel = stands_by(stand)
    stand.inject(f"relays:silence@{stand.inspect()['state']['now_s']}")
    kill(pid)
    reap(pid)
    stand.wait_for_state("safe")
    os.kill(stand.guard_pid(), signal.SIGTERM)
    until(lambda: not stand.guard_pid(), "it obeys")
    until(lambda: gone(sentinel), "the sentinel ends")
    assert not stand.guard_pid()
    assert log_of(stand, "nobody is left: the next guard is called") == []
    assert read_stop(stand.places).unverified


def test_an_orderly_end_leaves_no_sentinel_and_no_second_stop(stand, run_test):
    def end(guard, bench):
        return 0

    pid = run_test(stand, go_on)
    sentinel = stands_by(stand)
    os.kill(pid, signal.SIGINT)
    reap(pid)
    until(lambda: not stand.guard_pid(), "the guard goes home")
    until(lambda: gone(sentinel), "its sentinel, too")
    assert log_of(stand, "nobody is left: the next guard is called") == []
    assert read_stop(stand.places) is None
    again = run_test(stand, end)
    assert reap(again) == 0
    until(lambda: not stand.guard_pid(), "the guard goes home")
    assert len(log_of(stand, "sentinel")) == 2
    until(lambda: all(gone(entry["pid"]) for entry in log_of(stand, "sentinel")), "so do their sentinels")


def test_no_signal_but_kill_reaches_it_and_it_holds_nothing(stand, run_test):
    pid = run_test(stand, go_on)
    guard, sentinel = stand.guard_pid(), stands_by(stand)
    assert os.getsid(sentinel) == sentinel
    held = {str(entry.readlink()) for entry in Path(f"/proc/{sentinel}/fd").iterdir()}
    assert {name.partition(":")[0] for name in held} == {"/dev/null", "pipe", "anon_inode"}
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        os.kill(sentinel, number)
    found = left_alone(stand, pid, guard)
    reap(pid)
    assert_safe_within(found, max(lost_s(found, "test", of=-1), lost_s(found, "guard", of=-2)))


# -- what it does, without a bench


class Scene:
    """A mark, and guards that are called; what they do is said by the test."""

    def __init__(self, folder):
        self.places = Places.of("b", folder)
        self.calls = folder / "calls"
        self.calls.write_text("")
        self.places.driven.write_text('{"since_utc": "noon"}')
        self.dies_first = 0

    def call_guard(self):
        with self.calls.open("a") as file:
            file.write(f"{time.monotonic()}\n")
        if self.called() <= self.dies_first:
            kill(os.getpid())
        self.places.driven.unlink()

    def watch(self, test, *, heartbeat_timeout_s=10.0):
        life_line, writer = os.pipe()
        settings = GuardSettings(heartbeat_timeout_s=heartbeat_timeout_s, lease_s=LEASE_S)
        fd = os.pidfd_open(test) if test else -1
        return Watch(self.places, settings, self.call_guard, test, fd, life_line), writer

    def called(self):
        return len(self.called_s())

    def called_s(self):
        return [float(line) for line in self.calls.read_text().splitlines()]


def ends_within(pid, wall_s):
    fd = os.pidfd_open(pid)
    try:
        return bool(select.select([fd], [], [], wall_s)[0])
    finally:
        os.close(fd)


@pytest.fixture
def scene(tmp_path):
    return Scene(tmp_path)


def test_guards_that_die_are_called_again_until_the_bench_is_safe(scene):
    scene.dies_first = 3
    watch, life_line = scene.watch(0)
    os.close(life_line)
    watch.stand()
    assert scene.called() == 4
    assert not scene.places.driven.exists()


def test_it_gives_up_in_the_end(scene, monkeypatch):
    monkeypatch.setattr(sentinel_room, "RETRY_FOR_S", 0.1)
    scene.dies_first = 1000
    watch, life_line = scene.watch(0)
    os.close(life_line)
    watch.stand()
    # pauses of 0.02, 0.04 and 0.08 s
    assert scene.called() == 3
    assert scene.places.driven.exists()


def test_where_another_guard_has_come_it_calls_none_and_leaves_with_the_mark(scene):
    lease = Lease(scene.places.lease, lease_s=LEASE_S)
    watch, life_line = scene.watch(0)
    os.close(life_line)
    stands = fork(watch.stand)
    assert not ends_within(stands, 0.2)
    scene.places.driven.unlink()
    assert reap(stands) == 0
    assert scene.called() == 0
    lease.release()


def test_a_session_that_is_not_its_own_is_no_business_of_it(scene):
    watch, life_line = scene.watch(0)
    scene.places.driven.write_text('{"since_utc": "one"}')
    os.close(life_line)
    watch.stand()
    assert scene.called() == 0


def test_a_living_test_has_its_time_to_make_safe_itself_but_not_for_ever(scene, monkeypatch):
    monkeypatch.setattr(sentinel_room, "_OWN_TIME_S", 0.3)
    hangs = fork(signal.pause)
    watch, life_line = scene.watch(hangs, heartbeat_timeout_s=0.1)
    os.close(life_line)
    began_s = time.monotonic()
    watch.stand()
    (called_s,) = scene.called_s()
    assert called_s - began_s >= 0.1 + 0.3
    kill(hangs)
    reap(hangs)


def test_a_test_that_is_dead_before_it_is_posted_counts_as_dead(scene):
    dead = fork(lambda: 0)
    reap(dead)
    post = Sentinel(scene.places, GuardSettings(), scene.call_guard)
    post.begin(dead)
    assert post.pid
    sentinel = post.pid
    # as when the guard is killed: the mark lies there, the life line ends
    post.end()
    until(lambda: scene.called() == 1, "the next guard is called")
    until(lambda: process_state(sentinel) in {"", "Z", "X"}, "the sentinel ends")
    with contextlib.suppress(ChildProcessError):
        os.waitpid(sentinel, 0)


def test_where_none_can_be_posted_the_guard_goes_on_and_its_log_says_so(scene, monkeypatch):
    def refused():
        raise OSError(11, "no more processes")

    post = Sentinel(scene.places, GuardSettings(), scene.call_guard)
    monkeypatch.setattr(os, "fork", refused)
    post.begin(os.getpid())
    assert post.pid == 0
    assert '"no sentinel"' in scene.places.log.read_text()
    monkeypatch.undo()
    # the next look tries again
    until(lambda: post.tend(needed=True) or post.pid, "it is posted at last")
    scene.places.driven.unlink()
    post.tend(needed=False)
    assert post.pid == 0
    assert scene.called() == 0
