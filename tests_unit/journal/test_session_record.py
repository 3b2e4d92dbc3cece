from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import journal_samples as sample
import pytest

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.errors import DataError, StorageError
from arl_fixtures.journal import entries as said
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.resume import (
    NextStep,
    check_same,
    damaged_bags,
    new_journal_path,
    newest_journal,
    next_step,
)
from arl_fixtures.recording.bag_folder import BagFolder
from arl_fixtures.recording.messages import IMAGE

MakeJournal = Callable[..., Path]


def test_steps_and_attempts_in_order(make_journal: MakeJournal) -> None:
    record = Journal.read(
        make_journal(
            sample.step_begin(0, 1),
            sample.step_end(0, 1, "INVALID", finished=False),
            *sample.attempt(0, 2, "PASS"),
            *sample.attempt(1, 1, "CONDITIONAL"),
            said.SessionEnd(reason="finished", verdict="CONDITIONAL"),
        )
    )
    assert list(record.steps) == list(sample.PLAN[:2])
    first, second = record.steps.values()
    assert [(a.begin.attempt, a.finished, a.verdict) for a in first.attempts] == [
        (1, False, "INVALID"),
        (2, True, "PASS"),
    ]
    assert (first.verdict, second.verdict) == ("PASS", "CONDITIONAL")
    assert first.attempts[1].settle is not None
    assert [m.value for m in first.attempts[1].measurements] == [0.012, None]
    assert record.end is not None
    assert record.identity == sample.identity()


def test_a_later_pass_does_not_erase_a_fail(make_journal: MakeJournal) -> None:
    record = Journal.read(make_journal(*sample.attempt(0, 1, "FAIL"), *sample.attempt(0, 2, "PASS")))
    assert record.steps[sample.PLAN[0]].verdict == "FAIL"
    assert [attempt.verdict for attempt in record.attempts] == ["FAIL", "PASS"]


@pytest.mark.parametrize(
    ("entries", "said_of_it"),
    [
        ([sample.measurement(0, 1)], r":2: 'measurement' of a step attempt that was never begun"),
        ([sample.step_begin(0, 1), sample.step_begin(0, 1)], r":3: attempt 1 at step .* begins a second time"),
    ],
)
def test_a_line_out_of_place_is_refused(
    entries: list[said.JournalModel], said_of_it: str, make_journal: MakeJournal
) -> None:
    with pytest.raises(DataError, match=said_of_it):
        Journal.read(make_journal(*entries))


def broken(step: int, attempt: int) -> list[said.JournalModel]:
    return [sample.step_begin(step, attempt), sample.step_end(step, attempt, "INVALID", finished=False)]


FIRST, SECOND, THIRD = sample.PLAN


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ([], NextStep(step_id=FIRST, attempt=1)),
        ([sample.step_begin(0, 1)], NextStep(step_id=FIRST, attempt=2)),
        (broken(0, 1), NextStep(step_id=FIRST, attempt=2)),
        (sample.attempt(0, 1, "PASS"), NextStep(step_id=SECOND, attempt=1)),
        (sample.attempt(0, 1, "FAIL"), NextStep(step_id=SECOND, attempt=1)),
        ([*sample.attempt(0, 1, "PASS"), *broken(1, 1), *broken(1, 2)], NextStep(step_id=SECOND, attempt=3)),
        (
            [*sample.attempt(0, 1, "PASS"), *broken(1, 1), *broken(1, 2), sample.step_begin(1, 3)],
            NextStep(step_id=THIRD, attempt=1, given_up=(SECOND,)),
        ),
        (
            [e for k in range(3) for e in sample.attempt(k, 1, "PASS")],
            NextStep(step_id="", attempt=0),
        ),
    ],
)
def test_where_to_go_on(entries: list[said.JournalModel], expected: NextStep, make_journal: MakeJournal) -> None:
    assert next_step(Journal.read(make_journal(*entries)), sample.PLAN) == expected


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"duts": (said.Dut(serial="SN-1", model="hfl110"),)}, r"other DUTs: without SN-2 \(journal: SN-1, SN-2\)"),
        (
            {"duts": (said.Dut(serial="SN-1", model="hfl110"), said.Dut(serial="SN-9", model="hfl110"))},
            "without SN-2 and with SN-9",
        ),
        (
            {"duts": (said.Dut(serial="SN-2", model="hfl110"), said.Dut(serial="SN-1", model="hfl110"))},
            "in another order",
        ),
        ({"bench_sha256": "f" * 64}, r"bench 'bench' has changed: SHA-256 ffffffffffff…, journal: bbbbbbbbbbbb…"),
        ({"profile_name": "full"}, "other profile: 'full', journal: 'short'"),
    ],
)
def test_another_dut_bench_or_profile_is_named(
    change: dict[str, object], named: str, make_journal: MakeJournal
) -> None:
    record = Journal.read(make_journal())
    with pytest.raises(DataError, match=f"cannot resume: .*{named}"):
        check_same(record, sample.identity(**change))


def test_other_limits_and_newer_software_may_go_on(make_journal: MakeJournal) -> None:
    record = Journal.read(make_journal())
    check_same(record, sample.identity(limits_sha256="0" * 64, software_version="0.2.0"))


def test_safe_stops_wait_for_their_acknowledgement(make_journal: MakeJournal) -> None:
    stop = said.SafeStop(cause="T3 above its ceiling")
    ack = said.Acknowledgement(of_seq=1, by="me")
    assert Journal.read(make_journal(stop, name="a.jsonl")).unacknowledged() == [(1, stop)]
    assert Journal.read(make_journal(stop, ack, stop, name="b.jsonl")).unacknowledged() == [(3, stop)]


def test_bags_are_held_against_the_journal(make_journal: MakeJournal, tmp_path: Path) -> None:
    with BagFolder(tmp_path / "bags" / "whole", {}) as folder:
        folder.file.message(folder.topic("/t", IMAGE), 1, b"\x00\x01\x00\x00")
        receipt = folder.close()

    def bag(step: int, path: str, sha256: str) -> said.Bag:
        return said.Bag(step_id=sample.PLAN[step], attempt=1, path=path, sha256=sha256, size_bytes=1, message_count=1)

    entries = [
        sample.step_begin(0, 1),
        bag(0, "bags/whole", receipt.sha256),
        sample.step_end(0, 1, "PASS"),
        sample.step_begin(1, 1),
        bag(1, "bags/whole", "0" * 64),
        sample.step_end(1, 1, "PASS"),
        sample.step_begin(2, 1),
        bag(2, "../../etc", "0" * 64),
        sample.step_end(2, 1, "PASS"),
    ]
    record = Journal.read(make_journal(*entries))
    found = damaged_bags(record)
    assert [bag.step_id for bag, _ in found] == list(sample.PLAN[1:])
    assert "content differs" in found[0][1]
    assert "outside the output folder" in found[1][1]
    with pytest.raises(StorageError):
        record.bag_path(found[1][0])


def test_journals_are_numbered(tmp_path: Path, clock: VirtualClock) -> None:
    with pytest.raises(DataError, match="nothing to resume"):
        newest_journal(tmp_path)
    for expected in ("session-0001.jsonl", "session-0002.jsonl"):
        path = new_journal_path(tmp_path)
        assert path.name == expected
        Journal.create(path, sample.begin(), clock).close()
    assert newest_journal(tmp_path).name == "session-0002.jsonl"
