"""What an entry costs: little of the processor, and one sync for all that a step has measured."""

import os
import time
from pathlib import Path

import pytest
from journal_samples import begin, judgement, measurement, step_begin, step_end

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.journal.journal import Journal

LARGEST_S = 0.2e-3


@pytest.fixture
def syncs(monkeypatch):
    count = []
    sync = os.fdatasync
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: (count.append(descriptor), sync(descriptor)))
    return count


def test_all_that_a_step_has_measured_is_one_sync_and_each_entry_takes_its_time(tmp_path: Path, syncs):
    outcome = [entry for dut in range(300) for entry in (measurement(0, 1), judgement(0, 1, "PASS", dut=f"SN-{dut}"))]
    with Journal.create(tmp_path / "session-0001.jsonl", begin(), VirtualClock()) as journal:
        journal.append(step_begin(0, 1))
        before = len(syncs)
        start_s = time.process_time()
        journal.append_many([*outcome, step_end(0, 1, "PASS")])
        took_s = time.process_time() - start_s
        assert len(syncs) - before == 1
    assert took_s / len(outcome) < LARGEST_S


def test_a_single_entry_is_synced_before_append_returns(tmp_path: Path, syncs):
    with Journal.create(tmp_path / "session-0001.jsonl", begin(), VirtualClock()) as journal:
        for attempt in range(1, 6):
            before = len(syncs)
            journal.append(step_begin(0, attempt))
            assert len(syncs) == before + 1
