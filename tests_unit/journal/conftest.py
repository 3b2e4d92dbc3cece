from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from journal_samples import begin

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.journal.entries import JournalModel
from arl_fixtures.journal.journal import Journal


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def make_journal(tmp_path: Path, clock: VirtualClock) -> Callable[..., Path]:
    """Write the begin and some entries, a second of bench time apart, into a journal that is then let go."""

    def make(*entries: JournalModel, name: str = "session-0001.jsonl") -> Path:
        with Journal.create(tmp_path / name, begin(), clock) as journal:
            for entry in entries:
                clock.sleep(1.0)
                journal.append(entry)
        return tmp_path / name

    return make
