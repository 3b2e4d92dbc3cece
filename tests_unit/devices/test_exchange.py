"""A late answer must never be taken for the answer to a later question."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.links import VirtualStreamPort
from arl_fixtures.devices.exchange import Exchange, ExchangeSettings, Question
from arl_fixtures.emulators.device import Outgoing
from arl_fixtures.errors import DeviceLostError, DeviceTimeoutError, RemoteProtocolError
from tests_unit.line_bench import Scripted, SerialPort


def question(kind: str) -> Question[int]:
    """A toy protocol: `a` is answered by `a0;`, `a1;`, … with nothing that tells which `a` it answers."""

    def find(received: bytes) -> int | None:
        for word in received.split(b";")[:-1]:
            if word[:1] == kind.encode():
                return int(word[1:])
        return None

    return Question(kind, kind, kind.encode(), find)


class Counter:
    """Answers every question with how often it was asked anything, each answer late by the next of `delays_s`."""

    def __init__(self, *delays_s: float) -> None:
        self.asked = 0
        self._delays_s = list(delays_s)
        self._last_s = 0.0

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        self.asked += 1
        delay_s = self._delays_s.pop(0) if self._delays_s else 0.01
        # answers keep their order, as on any line
        self._last_s = max(self._last_s, now_s + delay_s)
        return [Outgoing(self._last_s, data + b"%d;" % self.asked)]

    def disconnect(self, now_s: float) -> None:
        return None


def exchange(port, clock: VirtualClock, fences: str = "", **settings: float) -> Exchange:
    def offered() -> Iterator[Question[object]]:
        return (question(kind) for kind in fences)

    patience = ExchangeSettings(**({"timeout_s": 1.0, "retries": 1} | settings))
    return Exchange("toy", port, clock, patience, fences=offered)


delays = st.lists(st.floats(0.0, 5.0), max_size=12)


@given(delays, st.lists(st.sampled_from("ab"), min_size=1, max_size=6))
@settings(max_examples=200, deadline=None)
def test_on_a_serial_line_no_answer_is_ever_an_old_one(delays_s: list[float], asked: list[str]):
    clock, device = VirtualClock(), Counter(*delays_s)
    asking = exchange(SerialPort("toy", device, clock), clock, fences="xyz", quiet_s=6.0)
    for kind in asked:
        before = device.asked
        try:
            answer = asking.ask(question(kind))
        except DeviceTimeoutError:
            continue
        except RemoteProtocolError:
            continue
        assert answer > before


@given(delays, st.lists(st.just("a"), min_size=1, max_size=6))
@settings(max_examples=100, deadline=None)
def test_on_a_connection_no_answer_is_ever_an_old_one(delays_s: list[float], asked: list[str]):
    clock, device = VirtualClock(), Counter(*delays_s)
    asking = exchange(VirtualStreamPort("toy", device, clock), clock, reopening_forgets=True)
    for kind in asked:
        before = device.asked
        try:
            answer = asking.ask(question(kind))
        except DeviceTimeoutError:
            continue
        assert answer > before


def test_the_fence_is_of_a_kind_that_nobody_waits_for():
    clock = VirtualClock()
    device = Scripted([], [(1.5, b"x7;")], [(0.0, b"a1;")])
    asking = exchange(SerialPort("toy", device, clock), clock, fences="ax", timeout_s=2.0)
    assert asking.ask(question("a")) == 1
    assert device.heard == [b"a", b"x", b"a"]


def test_without_a_fence_left_the_line_must_be_quiet():
    clock, device = VirtualClock(), Scripted([], [(0.0, b"a2;")])
    asking = exchange(SerialPort("toy", device, clock), clock, quiet_s=3.0)
    assert asking.ask(question("a")) == 2
    assert clock.now_s == pytest.approx(3.0)


def test_silence_is_a_timeout_in_bounded_time():
    clock, device = VirtualClock(), Scripted()
    asking = exchange(SerialPort("line 7", device, clock), clock, fences="x", timeout_s=0.5, retries=2)
    with pytest.raises(DeviceTimeoutError, match=r"toy at line 7: no answer to '.' within 0.5 s"):
        asking.ask(question("a"))
    assert clock.now_s <= 3 * 0.5 + 3.0


def test_nonsense_is_shown():
    clock, device = VirtualClock(), Scripted([(0.1, b"\x00\xffhello")])
    asking = exchange(SerialPort("line 7", device, clock), clock, retries=0)
    with pytest.raises(RemoteProtocolError, match=r"toy at line 7: no answer to 'a' in what came: 00 ff 68"):
        asking.ask(question("a"))


def test_a_flood_does_not_wait_for_its_end():
    clock, device = VirtualClock(), Scripted([(0.001 * n, b"!" * 100) for n in range(900)])
    asking = exchange(SerialPort("toy", device, clock), clock, retries=0)
    with pytest.raises(RemoteProtocolError):
        asking.ask(question("a"))
    assert clock.now_s < 0.1


def test_an_answer_in_pieces_is_put_together():
    clock, device = VirtualClock(), Scripted([(0.1, b"noise;a"), (0.2, b"4"), (0.3, b"2;")])
    asking = exchange(SerialPort("toy", device, clock), clock)
    assert asking.ask(question("a")) == 42
    assert clock.now_s == pytest.approx(0.3)


def test_what_came_unasked_is_not_an_answer():
    clock, device = VirtualClock(), Scripted([(0.1, b"a1;"), (0.2, b"a99;")], [(0.1, b"a2;")])
    asking = exchange(SerialPort("toy", device, clock), clock)
    assert asking.ask(question("a")) == 1
    clock.sleep(1.0)
    assert asking.ask(question("a")) == 2


def test_the_gap_between_questions_is_kept():
    clock, device = VirtualClock(), Counter()
    asking = exchange(SerialPort("toy", device, clock), clock, gap_s=1.0)
    for _ in range(3):
        asking.ask(question("a"))
    assert clock.now_s == pytest.approx(2.0 + 3 * 0.01)


class Cut(Counter):
    """A device whose line is cut for a while."""

    def __init__(self, start_s: float, end_s: float) -> None:
        super().__init__()
        self._start_s, self._end_s = start_s, end_s

    def is_connected(self, now_s: float) -> bool:
        return not self._start_s <= now_s < self._end_s


@pytest.mark.parametrize("end_s", [2.0, 9.0])
def test_a_line_that_comes_back_is_opened_again(end_s: float):
    clock, device = VirtualClock(), Cut(1.0, end_s)
    asking = exchange(VirtualStreamPort("toy", device, clock), clock, reopening_forgets=True)
    asking.ask(question("a"))
    clock.sleep(1.2)
    if end_s > 3.0:
        with pytest.raises(DeviceLostError, match="toy"):
            asking.ask(question("a"))
        clock.sleep(end_s)
    assert asking.ask(question("a")) == 2, "a retry waits a moment for the line to come back"
