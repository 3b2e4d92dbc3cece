"""Time that passes for a few processes is not that of the other work of the machine."""

import contextlib
import os
import signal
import threading

import pytest

from arl_fixtures.lab import own_time
from arl_fixtures.lab.own_time import OwnTime

PATIENCE_S = 300.0
TEST, GUARD, SENTINEL, OTHER = 11, 12, 13, 99


class Kernel:
    """What it tells of processes: each a parent, the processor time it has used, and the states of its threads."""

    def __init__(self, monkeypatch):
        self.known = {}
        monkeypatch.setattr(own_time, "_numbers", self.numbers)
        monkeypatch.setattr(own_time, "_stat", self.stat)

    def numbers(self, folder):
        if folder == "/proc":
            return list(self.known)
        return range(len(self.known[int(folder.split("/")[2])][2]))

    def stat(self, path):
        parts = path.split("/")
        if int(parts[2]) not in self.known:
            return None
        parent, cpu_s, states = self.known[int(parts[2])]
        return own_time._Stat(states[int(parts[4]) if len(parts) > 4 else 0], parent, cpu_s)


@pytest.fixture
def kernel(monkeypatch):
    return Kernel(monkeypatch)


@pytest.mark.parametrize("asleep", ["S", "T", "Z"])
def test_time_passes_while_nobody_who_counts_wants_to_run(kernel, asleep):
    kernel.known = {TEST: (1, 0.5, asleep), OTHER: (1, 7.0, "R")}
    at_once, _ = OwnTime(lambda: [TEST])._look()
    assert at_once


@pytest.mark.parametrize("kept_waiting", ["R", "D", "SR"])
def test_while_one_that_counts_is_kept_waiting_only_what_was_computed_passes(kernel, kept_waiting):
    own = OwnTime(lambda: [TEST])
    kernel.known = {TEST: (1, 0.5, kept_waiting)}
    assert own._look() == (False, 0.0)
    assert own._look() == (False, 0.0)
    kernel.known = {TEST: (1, 0.53, kept_waiting)}
    assert own._look() == (False, pytest.approx(0.03))


def test_with_a_process_counts_whom_it_starts_though_it_dies_itself(kernel):
    own = OwnTime(lambda: [TEST] if TEST in kernel.known else [])
    kernel.known = {TEST: (1, 0.0, "S"), OTHER: (1, 0.0, "R")}
    assert own._look()[0]
    kernel.known[GUARD] = (TEST, 0.0, "S")
    assert own._look()[0]
    kernel.known[SENTINEL] = (GUARD, 0.0, "R")
    assert not own._look()[0]
    del kernel.known[TEST], kernel.known[GUARD]
    kernel.known[SENTINEL] = (1, 0.0, "R")
    assert not own._look()[0]
    # its number may be another's after that
    del kernel.known[SENTINEL]
    assert own._look()[0]
    kernel.known[SENTINEL] = (1, 0.0, "R")
    assert own._look()[0]


def test_who_was_started_before_its_parent_counted_counts_with_it(kernel):
    count = []
    own = OwnTime(lambda: count)
    kernel.known = {TEST: (1, 0.0, "S"), GUARD: (TEST, 0.0, "R")}
    assert own._look()[0]
    count.append(TEST)
    assert not own._look()[0]


def test_a_stopped_process_holds_no_time_and_one_that_computes_does_not_hold_it_for_ever():
    for work in (signal.pause, busy):
        pid = os.fork()
        if not pid:
            with contextlib.suppress(BaseException):
                work()
            os._exit(0)
        own = OwnTime(lambda pid=pid: [pid])
        own.start()
        try:
            if work is signal.pause:
                os.kill(pid, signal.SIGSTOP)
            pause = threading.Event()
            for _ in range(int(PATIENCE_S / 0.01)):
                if own() > 0.2:
                    break
                pause.wait(0.01)
            assert own() > 0.2
        finally:
            own.stop()
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
    stands_s = own()
    assert own() == stands_s


def busy():
    while True:
        pass
