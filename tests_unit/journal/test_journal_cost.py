"""What an entry costs: little of the processor, and nobody who measures waits for the disk."""

import errno
import os
import threading
from pathlib import Path
from typing import get_args

import pytest
from journal_samples import begin, identity, judgement, measurement, step_begin, step_end
from processor_time import processor_s

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.errors import StorageError
from arl_fixtures.journal import entries as said
from arl_fixtures.journal.journal import PART_OF_A_STEP, Journal

LARGEST_S = 0.2e-3
PATIENCE_S = 300.0
RELIED_ON = [
    step_end(0, 1, "PASS"),
    said.SessionResume(identity=identity()),
    said.Repair(discarded_bytes=1, discarded="x"),
    said.Recovery(
        step_id="c0000-00-up+25C", attempt=1, source="a", path="b", sha256="0" * 64, message_count=1, fault="cut"
    ),
    said.Alarm(source="guard", condition="hot", action="hold"),
    said.Fault(device="stage", message="stage: silent", action="again"),
    said.SafeStop(cause="ceiling"),
    said.Acknowledgement(of_seq=1, by="me"),
    said.CycleEnd(cycle=0, verdict="PASS"),
    said.SessionEnd(reason="done", verdict="PASS"),
]


class Disk:
    """Counts its flushes; each waits while `stuck`, and fails with what `fault` says."""

    def __init__(self) -> None:
        self.flushes = 0
        self.fault: OSError | None = None
        self.ready, self.asked = threading.Event(), threading.Event()
        self.ready.set()
        self._flush = os.fdatasync

    def __call__(self, descriptor: int) -> None:
        self.flushes += 1
        self.asked.set()
        assert self.ready.wait(PATIENCE_S)
        fault, self.fault = self.fault, None
        if fault is not None:
            raise fault
        self._flush(descriptor)


@pytest.fixture
def disk(monkeypatch):
    disk = Disk()
    monkeypatch.setattr(os, "fdatasync", disk)
    return disk


@pytest.fixture
def journal(tmp_path: Path, disk):
    with Journal.create(tmp_path / "session-0001.jsonl", begin(), VirtualClock()) as journal:
        disk.flushes = 0
        disk.asked.clear()
        yield journal
        disk.ready.set()


def test_each_entry_takes_its_time(journal):
    def say():
        for dut in range(300):
            journal.append(measurement(0, 1))
            journal.append(judgement(0, 1, "PASS", dut=f"SN-{dut}"))

    assert processor_s(say) / 600 < LARGEST_S


def test_all_that_a_step_has_measured_is_one_sync(journal, disk):
    outcome = [entry for dut in range(300) for entry in (measurement(0, 1), judgement(0, 1, "PASS", dut=f"SN-{dut}"))]
    journal.append_many([*outcome, step_end(0, 1, "PASS")])
    assert disk.flushes == 1


def test_who_measures_does_not_wait_for_the_disk(journal, disk):
    disk.ready.clear()
    journal.append(step_begin(0, 1))
    assert disk.asked.wait(PATIENCE_S), "it is flushed without being asked"
    for _ in range(100):
        journal.append(measurement(0, 1))
    assert len(Journal.read(journal.path).lines) == 102, "and outlives the process before that"
    disk.ready.set()
    journal.sync()
    assert disk.flushes == 2, "one flush for all that came while the one before was under way"


@pytest.mark.parametrize("entry", RELIED_ON, ids=lambda entry: entry.type)
def test_what_somebody_relies_on_is_on_the_disk_when_append_returns(journal, disk, entry):
    disk.ready.clear()
    journal.append(measurement(0, 1))
    assert disk.asked.wait(PATIENCE_S)
    before = disk.flushes
    relying = threading.Thread(target=journal.append, args=(entry,))
    relying.start()
    disk.ready.set()
    relying.join(PATIENCE_S)
    assert disk.flushes == before + 1


def test_every_type_of_entry_is_either_relied_on_or_part_of_a_step():
    (union, *_) = get_args(said.Entry)
    known = {type(entry) for entry in RELIED_ON} | set(PART_OF_A_STEP) | {said.SessionBegin}
    assert known == set(get_args(union))


def test_what_did_not_reach_the_disk_was_never_said(journal, disk):
    journal.append(said.Alarm(source="guard", condition="hot", action="hold"))
    held = journal.path.read_bytes()
    disk.asked.clear()
    disk.fault = OSError(errno.EIO, "Input/output error")
    journal.append(step_begin(0, 1))
    assert disk.asked.wait(PATIENCE_S)
    with pytest.raises(StorageError, match=r"session-0001\.jsonl: cannot write journal: Input/output error"):
        journal.sync()
    assert journal.path.read_bytes() == held
    journal.append(step_begin(0, 1))
    journal.close()
    assert [line.entry.type for line in Journal.read(journal.path).lines[1:]] == ["alarm", "step_begin"]


def test_a_failed_flush_that_nobody_waited_for_is_told_with_the_next_entry(journal, disk):
    disk.fault = OSError(errno.EIO, "Input/output error")
    journal.append(step_begin(0, 1))
    with pytest.raises(StorageError, match="Input/output error"):
        journal.append(step_end(0, 1, "PASS"))
    assert len(Journal.read(journal.path).lines) == 1


def test_a_journal_whose_last_flush_fails_does_not_close_in_silence(journal, disk):
    disk.fault = OSError(errno.EIO, "Input/output error")
    journal.append(step_begin(0, 1))
    with pytest.raises(StorageError, match="Input/output error"):
        journal.close()
    journal.close()
