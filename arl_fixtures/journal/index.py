"""An SQLite index over all journals of a campaign, made from them at any time. The journals stay the truth.

The tables are documented in docs/journal.md for users' own SQL, pandas and DuckDB; what is there keeps its meaning.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from arl_fixtures.errors import DataError, StorageError
from arl_fixtures.journal.entries import Acknowledgement, Alarm, Fault, Note, Recovery, Repair, SafeStop
from arl_fixtures.journal.record import AttemptRecord, SessionRecord, read_journal
from arl_fixtures.journal.resume import JOURNAL_PATTERN

INDEX_NAME: Final = "index.sqlite"
INDEX_VERSION: Final = 1

_SCHEMA: Final = """
CREATE TABLE session (
    session INTEGER PRIMARY KEY, journal TEXT, campaign TEXT, began_utc_ns INTEGER, ended TEXT, verdict TEXT,
    rejudged_from TEXT, resumes INTEGER, software_version TEXT, bench TEXT, bench_sha256 TEXT,
    profile TEXT, profile_sha256 TEXT, limits TEXT, limits_sha256 TEXT
);
CREATE TABLE dut (session INTEGER REFERENCES session, dut TEXT, model TEXT);
CREATE TABLE attempt (
    session INTEGER REFERENCES session, cycle INTEGER, step INTEGER, step_id TEXT, attempt INTEGER,
    set_temperature_c REAL, ramp INTEGER, began_utc_ns INTEGER, ended_utc_ns INTEGER, finished INTEGER, verdict TEXT,
    reason TEXT, settled INTEGER, settle_s REAL, overshoot_k REAL, bag TEXT, bag_sha256 TEXT, bag_bytes INTEGER,
    PRIMARY KEY (session, step_id, attempt)
);
CREATE TABLE measurement (
    session INTEGER REFERENCES session, step_id TEXT, attempt INTEGER, dut TEXT, metric TEXT, scope TEXT,
    value REAL, unit TEXT, u REAL, dof REAL, reason TEXT, reference TEXT
);
CREATE TABLE judgement (
    session INTEGER REFERENCES session, step_id TEXT, attempt INTEGER, dut TEXT, metric TEXT, scope TEXT,
    lower REAL, upper REAL, limit_unit TEXT, severity TEXT, rule TEXT, verdict TEXT, risk REAL, reason TEXT
);
CREATE TABLE event (
    session INTEGER REFERENCES session, seq INTEGER, utc_ns INTEGER, type TEXT, source TEXT, text TEXT
);
CREATE TABLE damaged (journal TEXT, reason TEXT);
CREATE INDEX measurement_by_metric ON measurement (metric, dut);
CREATE INDEX measurement_by_step ON measurement (session, step_id, attempt, dut, metric, scope);
CREATE INDEX judgement_by_measurement ON judgement (session, step_id, attempt, dut, metric, scope);
CREATE VIEW result AS
    WITH judged AS (
        SELECT session, step_id, attempt, dut, metric, scope, value, unit, u, dof, lower, upper, limit_unit, risk,
               coalesce(verdict, '') AS verdict, coalesce(j.reason, m.reason) AS reason
        FROM measurement m LEFT JOIN judgement j USING (session, step_id, attempt, dut, metric, scope)
        UNION ALL
        SELECT session, step_id, attempt, dut, metric, scope, NULL, '', NULL, NULL, lower, upper, limit_unit, risk,
               verdict, reason
        FROM judgement j WHERE NOT EXISTS (
            SELECT 1 FROM measurement m WHERE (m.session, m.step_id, m.attempt, m.dut, m.metric, m.scope)
                                            = (j.session, j.step_id, j.attempt, j.dut, j.metric, j.scope))
    )
    SELECT r.dut, a.cycle, a.step, a.step_id, a.set_temperature_c, a.ramp, r.metric, r.scope, r.value, r.unit,
           r.u AS uncertainty, r.dof, r.verdict, r.lower, r.upper, r.limit_unit, r.risk, r.reason,
           a.attempt, a.finished, a.bag, a.ended_utc_ns, s.journal, s.rejudged_from, s.campaign
    FROM judged r JOIN attempt a USING (session, step_id, attempt) JOIN session s USING (session);
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryRow:
    """One value in a campaign's history; `value` and `uncertainty` are None where there is none."""

    dut: str
    cycle: int
    step_id: str
    set_temperature_c: float
    ramp: int
    metric: str
    scope: str
    value: float | None
    unit: str
    uncertainty: float | None
    verdict: str
    reason: str
    attempt: int
    finished: bool
    bag: str
    journal: str


def rebuild(folder: Path, index: Path | None = None) -> Path:
    """Make the index anew from all journals below a folder; it replaces the old one in one step.

    A damaged journal is left out and named in the table `damaged`.

    Args:
        folder: campaign folder; journals may lie in folders below it.
        index: file to write; `index.sqlite` in the folder by default.

    Raises:
        DataError: there is no journal.
        StorageError: the index cannot be written.
    """
    index = index or folder / INDEX_NAME
    journals = sorted(folder.rglob(JOURNAL_PATTERN))
    if not journals:
        raise DataError(f"{folder}: holds no journal ({JOURNAL_PATTERN})")
    fresh = index.with_name(f"{index.name}.{os.getpid()}.new")
    try:
        fresh.unlink(missing_ok=True)
        with closing(sqlite3.connect(fresh, isolation_level=None)) as database:
            # nothing is lost with this file: it is made from the journals
            database.executescript(f"PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN; {_SCHEMA}")
            database.execute(f"PRAGMA user_version = {INDEX_VERSION}")
            for path in journals:
                _add_journal(database, folder, path)
            database.execute("COMMIT")
        fresh.replace(index)
    except (sqlite3.Error, OSError) as error:
        fresh.unlink(missing_ok=True)
        raise StorageError(f"{index}: cannot write index: {error}") from None
    return index


def history(
    index: Path,
    *,
    dut: str | None = None,
    metric: str | None = None,
    scope: str | None = None,
    cycle: int | None = None,
    step_id: str | None = None,
    set_temperature_c: float | None = None,
    rejudged: bool = False,
    limit: int = 10_000,
) -> list[HistoryRow]:
    """Values in the order of cycle, step and attempt; every attempt is there.

    Args:
        index: file made by `rebuild`.
        dut: serial number.
        metric: metric.
        scope: scope.
        cycle: cycle count.
        step_id: step.
        set_temperature_c: set temperature, degrees Celsius.
        rejudged: re-judgements instead of the sessions themselves.
        limit: most rows.

    Raises:
        DataError: no index, or of another version.
    """
    wanted: list[tuple[str, Any]] = [
        ("dut", dut),
        ("metric", metric),
        ("scope", scope),
        ("cycle", cycle),
        ("step_id", step_id),
        ("set_temperature_c", set_temperature_c),
    ]
    given = [(column, value) for column, value in wanted if value is not None]
    where = "".join(f" AND {column} = ?" for column, _ in given)
    columns = ", ".join(HistoryRow.__dataclass_fields__)
    query = (
        f"SELECT {columns} FROM result WHERE (rejudged_from != '') = ?{where} "
        "ORDER BY cycle, step, attempt, dut, metric, scope LIMIT ?"
    )
    if not index.is_file():
        raise DataError(f"{index}: there is no index; make it from the journals")
    try:
        with closing(sqlite3.connect(f"{index.resolve().as_uri()}?mode=ro", uri=True)) as database:
            (version,) = database.execute("PRAGMA user_version").fetchone()
            if version != INDEX_VERSION:
                raise DataError(f"{index}: index of version {version}, expected {INDEX_VERSION}; make it anew")
            rows = database.execute(query, [rejudged, *(value for _, value in given), limit]).fetchall()
    except sqlite3.Error as error:
        raise DataError(f"{index}: cannot read index: {error}") from None
    return [HistoryRow(**dict(zip(HistoryRow.__dataclass_fields__, _row(row), strict=True))) for row in rows]


def _row(row: Sequence[Any]) -> list[Any]:
    fields = list(HistoryRow.__dataclass_fields__)
    return [bool(value) if name == "finished" else value for name, value in zip(fields, row, strict=True)]


def _add_journal(database: sqlite3.Connection, folder: Path, path: Path) -> None:
    name = path.relative_to(folder).as_posix()
    try:
        record = read_journal(path)
    except DataError as error:
        database.execute("INSERT INTO damaged VALUES (?, ?)", (name, str(error)))
        return
    begin, identity, end = record.begin, record.identity, record.end
    cursor = database.execute(
        "INSERT INTO session VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (
            name,
            begin.campaign,
            record.lines[0].utc_ns,
            end.reason if end else "",
            end.verdict if end else "",
            begin.rejudged_from,
            len(record.resumes),
            identity.software_version,
            identity.bench_name,
            identity.bench_sha256,
            identity.profile_name,
            identity.profile_sha256,
            identity.limits_name,
            identity.limits_sha256,
        ),
    )
    session = cursor.lastrowid
    duts = [(session, dut.serial, dut.model) for dut in identity.duts]
    database.executemany("INSERT INTO dut VALUES (?, ?, ?)", duts)
    for attempt in record.attempts:
        _add_attempt(database, session, attempt, _bag_name(folder, record, attempt))
    database.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?)", _events(session, record))


def _add_attempt(database: sqlite3.Connection, session: int | None, attempt: AttemptRecord, bag: str) -> None:
    begin, settle, step_bag = attempt.begin, attempt.settle, attempt.bag
    database.execute(
        f"INSERT INTO attempt VALUES ({', '.join('?' * 18)})",
        (
            session,
            begin.cycle,
            begin.step_index,
            begin.step_id,
            begin.attempt,
            begin.set_temperature_c,
            begin.ramp,
            attempt.begin_utc_ns,
            attempt.end_utc_ns or None,
            attempt.finished,
            attempt.verdict,
            attempt.end.reason if attempt.end else "broke off",
            settle.settled if settle else None,
            settle.duration_s if settle else None,
            settle.overshoot_k if settle else None,
            bag,
            step_bag.sha256 if step_bag else "",
            step_bag.size_bytes if step_bag else None,
        ),
    )
    key = (session, begin.step_id, begin.attempt)
    database.executemany(
        f"INSERT INTO measurement VALUES ({', '.join('?' * 12)})",
        [
            (*key, m.dut, m.metric, m.scope, m.value, m.unit, m.u, m.dof, m.reason, m.reference)
            for m in attempt.measurements
        ],
    )
    rows: list[tuple[Any, ...]] = []
    for j in attempt.judgements:
        held = j.limit
        bounds = (held.lower, held.upper, held.unit, held.severity, held.rule) if held else (None, None, "", "", "")
        rows.append((*key, j.dut, j.metric, j.scope, *bounds, j.verdict, j.risk, j.reason))
    database.executemany(f"INSERT INTO judgement VALUES ({', '.join('?' * 14)})", rows)


def _bag_name(folder: Path, record: SessionRecord, attempt: AttemptRecord) -> str:
    """Path of the bag relative to the index's folder; empty without one."""
    if attempt.bag is None:
        return ""
    return (record.path.parent / attempt.bag.path).relative_to(folder).as_posix()


def _events(session: int | None, record: SessionRecord) -> Iterable[tuple[Any, ...]]:
    for line in record.lines:
        match entry := line.entry:
            case Alarm():
                said = (entry.source, f"{entry.condition}: {entry.action}")
            case Fault():
                said = (entry.device, f"{entry.message}: {entry.action}")
            case SafeStop():
                said = ("guard", entry.cause)
            case Acknowledgement():
                said = (entry.by, f"of line {entry.of_seq}: {entry.note}")
            case Recovery():
                said = (entry.source, entry.fault)
            case Repair():
                said = ("journal", f"{entry.discarded_bytes} bytes of a torn line were cut off")
            case Note():
                said = ("", entry.text)
            case _:
                continue
        yield session, line.seq, line.utc_ns, entry.type, *said
