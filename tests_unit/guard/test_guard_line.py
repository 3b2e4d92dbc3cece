"""Two users of one line: who waits for whom, and for how long."""

import pytest

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.errors import DeviceLostError, DeviceTimeoutError
from arl_fixtures.guard import link as guard_link
from arl_fixtures.guard.line import HOLD_S, Line, OwnPort, Patience, PatientClock
from arl_fixtures.guard.link import GuardedPort

QUIET_S = 3.0


class Port:
    """A line on which `coming` lies ready."""

    name = "serial:///dev/fake"

    def __init__(self):
        self.coming = b""
        self.written = []
        self.closed = False

    def write(self, data):
        self.written.append(data)

    def read(self, timeout_s):
        data, self.coming = self.coming, b""
        return data

    def drain(self):
        return self.read(0.0)

    def reopen(self):
        self.coming = b""

    def close(self):
        self.closed = True
        raise DeviceLostError("already gone")


class Host:
    """Time that passes by waiting; cut short where `cut_s` says."""

    def __init__(self):
        self.clock = VirtualClock()
        self.cut_s = float("inf")

    def read(self, port, timeout_s, attention):
        if not port.coming:
            self.sleep(self.clock.now_s + timeout_s, attention)
        return port.read(0.0)

    def sleep(self, until_s, attention):
        self.clock.sleep(min(until_s, self.cut_s) - self.clock.now_s)


@pytest.fixture
def host():
    return Host()


@pytest.fixture
def line(host):
    return Line("relays", Port(), host.clock, quiet_s=QUIET_S)


@pytest.fixture
def patience():
    return Patience(None)


@pytest.fixture
def own(line, host, patience):
    return OwnPort(line, host, patience)


def serve(line, op="read", payload=b"", *, drain=False):
    return line.serve(op, payload, drain=drain, read=lambda port: port.read(0.0))


def test_the_guard_waits_until_the_tests_exchange_is_over(line, host):
    host.clock.sleep(10.0)
    line.port.coming = b"answer"
    assert serve(line, payload=b"question") == b"answer"
    assert line.free_for_guard_s() == pytest.approx(10.0 + HOLD_S)
    host.clock.sleep(HOLD_S)
    assert line.free_for_guard_s() <= host.clock.now_s


def test_a_question_of_the_test_without_answer_keeps_the_guard_away_until_nothing_can_come(line, host):
    assert serve(line, payload=b"question") == b""
    assert line.free_for_guard_s() == pytest.approx(QUIET_S)
    host.clock.sleep(1.0)
    line.port.coming = b"answer"
    assert serve(line, payload=b"again") == b"answer"
    assert line.free_for_guard_s() == pytest.approx(1.0 + HOLD_S)


def test_a_question_of_the_guard_without_answer_keeps_the_test_away(line, own, host):
    own.write(b"question")
    assert own.read(0.5) == b""
    assert line.free_for_test_s() == pytest.approx(QUIET_S)
    own.write(b"again")
    line.port.coming = b"answer"
    assert own.read(0.5) == b"answer"
    assert line.free_for_test_s() == float("-inf")


def test_opening_again_settles_the_line(line, own):
    own.write(b"question")
    own.reopen()
    assert line.free_for_test_s() == float("-inf")
    serve(line, payload=b"question")
    serve(line, "reopen")
    assert line.free_for_guard_s() == pytest.approx(HOLD_S)


def test_forgetting_comes_before_writing(line):
    line.port.coming = b"stale"
    assert serve(line, payload=b"question", drain=True) == b""
    assert line.port.written == [b"question"]


def test_the_guards_patience_ends_at_its_deadline(own, host, patience):
    patience.deadline_s = 0.4
    own.write(b"question")
    assert own.read(2.0) == b""
    assert host.clock.now_s == pytest.approx(0.4)
    with pytest.raises(DeviceTimeoutError, match="no time left"):
        own.read(2.0)
    with pytest.raises(DeviceTimeoutError, match="no time left"):
        own.write(b"question")


def test_the_guards_sleep_is_cut_by_deadline_and_urgency(host, patience):
    clock = PatientClock(host, patience)
    clock.sleep(0.5)
    patience.deadline_s = 1.0
    with pytest.raises(DeviceTimeoutError):
        clock.sleep(1.0)
    assert clock.now_s == pytest.approx(1.0)
    patience.deadline_s, host.cut_s = float("inf"), 1.2
    with pytest.raises(DeviceTimeoutError):
        clock.sleep(1.0)
    assert clock.now_s == pytest.approx(1.2)
    assert clock.utc_ns() == host.clock.utc_ns()


class LostGuard:
    """The test's side of a guard that was killed, and takes a while to die of it."""

    lost = "the guard is gone"

    def __init__(self, dies_after_looks):
        self._looks = dies_after_looks

    def announce(self):
        pass

    @property
    def buried(self):
        self._looks -= 1
        return self._looks < 0


def test_the_test_waits_for_a_line_until_the_dead_guard_is_buried_however_long_that_takes(monkeypatch):
    monkeypatch.setattr(guard_link, "_TAKEOVER_PAUSE_S", 0.0)
    tries, port = [], Port()

    def open_line():
        tries.append(1)
        if len(tries) < 1000:
            raise DeviceLostError("the line is owned by 'guard'")
        return port

    GuardedPort("relays", "relays", LostGuard(990), open_line).write(b"off")
    assert port.written == [b"off"]
    # a line that is not free though the guard is dead is somebody else's
    tries.clear()
    with pytest.raises(DeviceLostError, match="owned"):
        GuardedPort("relays", "relays", LostGuard(0), open_line).write(b"off")
    assert len(tries) == guard_link._TAKEOVER_TRIES


def test_releasing_a_line_that_is_gone_is_no_error(line):
    line.close()
    assert line.port.closed
