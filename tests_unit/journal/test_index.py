from __future__ import annotations

import math
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import journal_samples as sample
import pytest

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.errors import DataError, StorageError
from arl_fixtures.journal import entries as said
from arl_fixtures.journal.index import history, rebuild
from arl_fixtures.journal.journal import Journal

MakeJournal = Callable[..., Path]
WHOLE = [
    *sample.attempt(0, 1, "FAIL"),
    *sample.attempt(0, 2, "PASS"),
    *sample.attempt(1, 1, "CONDITIONAL"),
    said.Alarm(source="T3", condition="above ceiling", value=95.0, unit="degC", action="safe state"),
    said.SafeStop(cause="T3 above ceiling"),
    said.SessionEnd(reason="finished", verdict="FAIL"),
]


def test_history_shows_every_attempt_in_order(make_journal: MakeJournal, tmp_path: Path) -> None:
    make_journal(*WHOLE)
    rows = history(rebuild(tmp_path), dut="SN-1", metric="distance_error")
    assert [(row.step_id, row.attempt, row.verdict) for row in rows] == [
        (sample.PLAN[0], 1, "FAIL"),
        (sample.PLAN[0], 2, "PASS"),
        (sample.PLAN[1], 1, "CONDITIONAL"),
    ]
    first = rows[0]
    assert (first.value, first.unit, first.uncertainty, first.scope) == (0.012, "m", 0.001, "stripe_50")
    assert (first.set_temperature_c, first.ramp, first.cycle) == (-10.0, 1, 0)
    assert (first.bag, first.journal, first.finished) == (f"bags/{sample.PLAN[0]}", "session-0001.jsonl", True)


def test_what_could_not_be_measured_is_there_with_its_reason(make_journal: MakeJournal, tmp_path: Path) -> None:
    make_journal(*sample.attempt(0, 1, "PASS"))
    (row,) = history(rebuild(tmp_path), dut="SN-2")
    assert (row.value, row.uncertainty, row.verdict) == (None, None, "INVALID")


def test_a_judgement_without_a_measurement_is_not_lost(make_journal: MakeJournal, tmp_path: Path) -> None:
    missing = sample.judgement(0, 1, "NOT_RUN").model_copy(update={"metric": "dead_pixels", "scope": ""})
    make_journal(sample.step_begin(0, 1), missing, sample.step_end(0, 1, "NOT_RUN"))
    (row,) = history(rebuild(tmp_path), metric="dead_pixels")
    assert (row.value, row.verdict) == (None, "NOT_RUN")


def test_filters_and_limit(make_journal: MakeJournal, tmp_path: Path) -> None:
    make_journal(*WHOLE)
    index = rebuild(tmp_path)
    assert len(history(index)) == 6
    assert len(history(index, limit=2)) == 2
    assert {row.step_id for row in history(index, set_temperature_c=-5.0)} == {sample.PLAN[1]}
    assert history(index, cycle=1) == []
    assert history(index, scope="no such") == []
    assert history(index, metric="x' OR '1'='1") == []


def test_the_index_is_made_anew_and_the_same(make_journal: MakeJournal, tmp_path: Path, clock: VirtualClock) -> None:
    path = make_journal(*sample.attempt(0, 1, "PASS"))
    index = rebuild(tmp_path)
    one = history(index)
    assert history(rebuild(tmp_path)) == one
    with Journal.resume(path, sample.identity(), clock) as journal:
        journal.append_many(sample.attempt(1, 1, "PASS"))
        assert len(history(rebuild(tmp_path))) == 2 * len(one)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["index.sqlite", "session-0001.jsonl"]


def test_a_damaged_journal_is_named_and_the_others_are_there(make_journal: MakeJournal, tmp_path: Path) -> None:
    make_journal(*WHOLE, name="session-0001.jsonl")
    bad = make_journal(*WHOLE, name="session-0002.jsonl")
    bad.write_bytes(bad.read_bytes().replace(b"FAIL", b"PASS", 1))
    index = rebuild(tmp_path)
    assert {row.journal for row in history(index)} == {"session-0001.jsonl"}
    with closing(sqlite3.connect(index)) as database:
        ((name, reason),) = database.execute("SELECT journal, reason FROM damaged").fetchall()
    assert name == "session-0002.jsonl"
    assert "journal is damaged" in reason


def test_users_own_sql(make_journal: MakeJournal, tmp_path: Path) -> None:
    make_journal(*WHOLE, name="campaign/session-0001.jsonl")
    with closing(sqlite3.connect(rebuild(tmp_path))) as database:
        worst = database.execute("SELECT dut, max(abs(value)) FROM result WHERE finished GROUP BY dut").fetchall()
        assert worst == [("SN-1", 0.012), ("SN-2", None)]
        events = database.execute("SELECT type, source, text FROM event ORDER BY seq").fetchall()
        assert events == [
            ("alarm", "T3", "above ceiling: safe state"),
            ("safe_stop", "guard", "T3 above ceiling"),
        ]
        ((dof,),) = database.execute("SELECT DISTINCT dof FROM measurement WHERE dof IS NOT NULL").fetchall()
        assert dof == math.inf
        (bag,) = database.execute("SELECT DISTINCT bag FROM attempt WHERE step = 0").fetchone()
        assert bag == f"campaign/bags/{sample.PLAN[0]}"


def test_no_index_and_a_foreign_one_are_said(tmp_path: Path, make_journal: MakeJournal) -> None:
    with pytest.raises(DataError, match="holds no journal"):
        rebuild(tmp_path)
    with pytest.raises(DataError, match="there is no index"):
        history(tmp_path / "index.sqlite")
    with closing(sqlite3.connect(tmp_path / "other.sqlite")) as other:
        other.execute("CREATE TABLE t (x)")
    with pytest.raises(DataError, match="version 0"):
        history(tmp_path / "other.sqlite")
    (tmp_path / "text.sqlite").write_text("no database at all, but long enough to look like one " * 40)
    with pytest.raises(DataError, match="cannot read index"):
        history(tmp_path / "text.sqlite")
    make_journal()
    with pytest.raises(StorageError, match="cannot write index"):
        rebuild(tmp_path, tmp_path / "nowhere" / "index.sqlite")
