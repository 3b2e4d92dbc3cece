from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.emulators.device import Outgoing
from arl_fixtures.emulators.faults import Fault, FaultBook
from arl_fixtures.emulators.faulty_wire import FaultyWire
from arl_fixtures.emulators.plant import Plant


class Echo:
    """Answers what it hears after 10 ms, and starts in half a second."""

    boot_s = 0.5

    def __init__(self) -> None:
        self.resets: list[float] = []
        self.disconnects = 0

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        return [Outgoing(now_s + 0.01, b"<" + data + b">\r\n")]

    def disconnect(self, now_s: float) -> None:
        self.disconnects += 1

    def reset(self, now_s: float) -> None:
        self.resets.append(now_s)


def wired(*faults: Fault) -> tuple[FaultyWire, Echo]:
    device = Echo()
    return FaultyWire("stage", device, Plant(faults=FaultBook(list(faults)))), device


def fault(kind: str, **more: float) -> Fault:
    return Fault(device="stage", kind=kind, **more)


def said(wire: FaultyWire, data: bytes, now_s: float) -> bytes:
    return b"".join(outgoing.data for outgoing in wire.receive(data, now_s))


def test_a_sound_wire_changes_nothing():
    wire, _ = wired()
    assert wire.receive(b"a", 1.0) == [Outgoing(1.01, b"<a>\r\n")]


@pytest.mark.parametrize(("kind", "more", "expected"), [
    ("silence", {}, b""),
    ("truncated_reply", {}, b"<a>"),
    ("truncated_reply", {"value": 1}, b"<"),
    ("wrong_checksum", {}, b"<a?\r\n"),
])  # fmt: skip
def test_what_a_fault_leaves_of_an_answer(kind: str, more: dict[str, float], expected: bytes):
    wire, _ = wired(fault(kind, start_s=1.0, duration_s=1.0, **more))
    assert said(wire, b"a", 0.5) == b"<a>\r\n"
    assert said(wire, b"a", 1.5) == expected
    assert said(wire, b"a", 2.0) == b"<a>\r\n"


def test_garbage_before_and_in_place_of_an_answer():
    before, _ = wired(fault("garbage", value=4))
    answer = said(before, b"a", 1.0)
    assert answer.endswith(b"<a>\r\n")
    assert len(answer) == 9
    instead, _ = wired(fault("garbage"))
    assert len(said(instead, b"a", 1.0)) == 5
    assert said(instead, b"a", 1.0) != said(instead, b"a", 2.0)


def test_garbage_is_the_same_for_the_same_seed():
    first, second = (wired(fault("garbage", value=9))[0] for _ in range(2))
    assert said(first, b"a", 1.0) == said(second, b"a", 1.0)


def test_two_answers_come_in_one_piece():
    wire, _ = wired(fault("merged_replies", duration_s=10.0))
    assert said(wire, b"a", 1.0) == b""
    assert said(wire, b"b", 2.0) == b"<a>\r\n<b>\r\n"
    assert said(wire, b"c", 3.0) == b""
    assert said(wire, b"d", 11.0) == b"<c>\r\n<d>\r\n", "what was held back comes with the next answer"
    assert said(wire, b"e", 12.0) == b"<e>\r\n"


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 3.0)), min_size=2, max_size=10))
@settings(deadline=None, max_examples=40)
def test_answers_never_overtake_each_other(steps: list[tuple[float, float]]):
    plant = Plant()
    wire = FaultyWire("stage", Echo(), plant)
    now_s, sent = 0.0, []
    for wait_s, late_s in steps:
        now_s += wait_s
        plant.faults.clear()
        plant.faults.inject(fault("late_reply", start_s=now_s, value=late_s))
        sent += wire.receive(b"a", now_s)
    times_s = [outgoing.time_s for outgoing in sent]
    assert times_s == sorted(times_s)


def test_a_cut_line_says_so_and_carries_nothing():
    wire, device = wired(fault("disconnect", start_s=1.0, duration_s=1.0))
    assert [wire.is_connected(now_s) for now_s in (0.9, 1.0, 1.9, 2.0)] == [True, False, False, True]
    assert said(wire, b"a", 1.5) == b""
    wire.disconnect(1.5)
    assert device.disconnects == 1


def test_a_reset_happens_once_and_makes_deaf():
    wire, device = wired(fault("reset", start_s=1.0))
    assert said(wire, b"a", 1.4) == b""
    assert device.resets == [1.0]
    assert said(wire, b"a", 1.5) == b"<a>\r\n"
    assert device.resets == [1.0]


def test_a_brown_out_makes_deaf_until_the_device_has_started_after_it():
    wire, device = wired(Fault(device="bench", kind="brown_out", start_s=1.0, duration_s=3.0))
    assert said(wire, b"a", 4.4) == b""
    assert device.resets == [1.0]
    assert said(wire, b"a", 4.5) == b"<a>\r\n"
