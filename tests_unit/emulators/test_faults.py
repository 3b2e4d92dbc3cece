from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from arl_fixtures.emulators.fault_kinds import FAULT_KINDS, FaultKind
from arl_fixtures.emulators.faults import Fault, FaultBook, parse_fault
from arl_fixtures.errors import ConfigError


def test_every_kind_says_what_it_does_and_to_whom():
    assert set(FAULT_KINDS) == set(FaultKind)
    for info in FAULT_KINDS.values():
        assert info.devices
        assert info.effect.endswith(".")
        assert not info.default or info.value, "a default needs a meaning"


def test_a_fault_as_written_on_a_command_line():
    fault = parse_fault("thermometer:drift@600/120=-5.5#2")
    assert fault == Fault(
        device="thermometer", kind=FaultKind.DRIFT, start_s=600.0, duration_s=120.0, value=-5.5, channel=2
    )
    assert parse_fault("dut_2:dut_silent") == Fault(device="dut_2", kind=FaultKind.DUT_SILENT)


@pytest.mark.parametrize(("text", "complaint"), [
    ("stage", "expected DEVICE:KIND"),
    ("stage:wobble", "unknown kind 'wobble'; known: silence"),
    ("stage:pump_stop", "'pump_stop' is no fault of 'stage'; it applies to: chiller"),
    ("toaster:silence", "'silence' is no fault of 'toaster'"),
    ("stage:silence@5/0/3", "expected DEVICE:KIND"),
])  # fmt: skip
def test_a_fault_that_does_not_exist_is_refused(text: str, complaint: str):
    with pytest.raises(ConfigError, match=complaint) as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)


def test_a_chiller_has_no_checksum_to_be_wrong():
    with pytest.raises(ValidationError):
        Fault(device="chiller", kind="wrong_checksum")


def test_whom_a_fault_concerns():
    assert Fault(device="dut_2", kind="dut_silent").concerns("dut_2")
    assert not Fault(device="dut_2", kind="dut_silent").concerns("dut_1")
    assert Fault(device="dut", kind="dut_silent").concerns("dut_1")
    assert Fault(device="bench", kind="brown_out").concerns("stage")


def test_the_amount_is_the_value_or_the_default():
    assert Fault(device="stage", kind="late_reply").amount == 2.0
    assert Fault(device="stage", kind="late_reply", value=0.0).amount == 0.0


def test_a_fault_is_active_from_its_start_up_to_its_end():
    book = FaultBook([Fault(device="stage", kind="silence", start_s=5.0, duration_s=2.0)])
    active = [book.active("stage", FaultKind.SILENCE, now_s) is not None for now_s in (4.9, 5.0, 6.9, 7.0)]
    assert active == [False, True, True, False]
    assert book.active("chiller", FaultKind.SILENCE, 6.0) is None
    assert book.active("stage", FaultKind.GARBAGE, 6.0) is None


def test_clearing_ends_what_began_and_forgets_what_did_not():
    book = FaultBook(
        [Fault(device="stage", kind="stage_stall", start_s=1.0), Fault(device="stage", kind="silence", start_s=9.0)]
    )
    edge = book.take_edge(5.0)
    assert edge is not None
    assert edge.begins
    assert book.clear("chiller") == 0
    assert book.clear("stage") == 2
    assert book.faults == ()
    assert book.active("stage", FaultKind.STAGE_STALL, 5.0) is None, "at once, though the device hears of it later"
    assert book.clear() == 0
    edge = book.take_edge(5.0)
    assert edge is not None
    assert not edge.begins
    assert edge.fault.kind is FaultKind.STAGE_STALL
    assert book.take_edge(math.inf) is None
    assert book.faults == ()


faults = st.builds(
    Fault,
    device=st.sampled_from(["stage", "relays"]),
    kind=st.sampled_from(["silence", "garbage"]),
    start_s=st.floats(0.0, 100.0),
    duration_s=st.one_of(st.just(math.inf), st.floats(0.0, 50.0)),
)


@given(st.lists(faults, max_size=8))
def test_every_beginning_has_at_most_one_end_and_time_is_ordered(schedule: list[Fault]):
    book, edges = FaultBook(schedule), []
    while (edge := book.take_edge(1e6)) is not None:
        edges.append(edge)
    assert [edge.time_s for edge in edges] == sorted(edge.time_s for edge in edges)
    assert sum(edge.begins for edge in edges) == len(schedule)
    assert sum(not edge.begins for edge in edges) == sum(math.isfinite(fault.duration_s) for fault in schedule)
    assert len(book.faults) == sum(math.isinf(fault.duration_s) for fault in schedule)


def test_the_documentation_lists_every_kind_as_it_is():
    page = (Path(__file__).parents[2] / "docs" / "faults.md").read_text(encoding="utf-8")
    for kind, info in FAULT_KINDS.items():
        value = f"{info.value} ({info.default:g})" if info.value else ""
        assert f"| `{kind.value}` | {', '.join(sorted(info.devices))} | {info.effect} | {value} |" in page
