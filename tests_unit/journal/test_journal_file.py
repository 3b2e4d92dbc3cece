from __future__ import annotations

import contextlib
import json
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import journal_samples as sample
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.errors import DataError, StorageError
from arl_fixtures.journal import entries as said
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.lines import read_lines

MakeJournal = Callable[..., Path]
WHOLE = [*sample.attempt(0, 1, "FAIL"), *sample.attempt(1, 1, "PASS")]


def refuse(constant: str) -> float:
    raise AssertionError(f"{constant} is no JSON")


def test_each_line_is_json_with_number_times_and_chain(make_journal: MakeJournal) -> None:
    path = make_journal(*WHOLE)
    lines = [json.loads(line, parse_constant=refuse) for line in path.read_text("utf-8").splitlines()]
    assert [line["seq"] for line in lines] == list(range(len(WHOLE) + 1))
    assert [line["time_s"] for line in lines] == [float(k) for k in range(len(WHOLE) + 1)]
    assert lines[5]["utc_ns"] == 1_767_225_600_000_000_000 + 5 * 10**9
    assert lines[0]["prev"] == "0" * 16
    assert len({line["prev"] for line in lines}) == len(lines)
    assert [line.entry for line in read_lines(path).lines][1:4] == WHOLE[:3]


floats = st.floats(width=64)
texts = st.text(st.characters(codec=None), max_size=40)


@given(
    value=st.none() | floats,
    u=st.none() | floats,
    dof=floats,
    text=texts,
    parts=st.lists(st.tuples(texts, floats), max_size=3),
    verdict=st.sampled_from(["PASS", "CONDITIONAL", "NOT_RUN", "INVALID", "FAIL"]),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_number_and_any_text_comes_back(
    tmp_path_factory: pytest.TempPathFactory,
    value: float | None,
    u: float | None,
    dof: float,
    text: str,
    parts: list[tuple[str, float]],
    verdict: str,
) -> None:
    entries: list[said.JournalModel] = [
        sample.step_begin(0, 1),
        said.Measurement(
            step_id=sample.PLAN[0],
            attempt=1,
            dut=text,
            metric="m",
            value=value,
            u=u,
            dof=dof,
            contributions=tuple(said.Contribution(name=name, u=part, kind="A", dof=dof) for name, part in parts),
        ),
        sample.judgement(0, 1, verdict).model_copy(update={"risk": dof}),
        said.Fault(device=text, message=text, action="retry"),
        said.SafeStop(cause=text, actions=(said.SafeAction(name="power off", verified=True, detail=text),)),
    ]
    path = tmp_path_factory.mktemp("j") / "session-0001.jsonl"
    with Journal.create(path, sample.begin(), VirtualClock()) as journal:
        journal.append_many(entries)
    for line in path.read_text("utf-8").removesuffix("\n").split("\n"):
        json.loads(line, parse_constant=refuse)
    found = [line.entry for line in read_lines(path).lines[1:]]
    assert [repr(entry) for entry in found] == [repr(entry) for entry in entries]


def test_texts_are_bounded_and_valid_unicode() -> None:
    note = said.Note(text="\udc80" + "x" * 100_000)
    assert note.text.startswith("\\udc80xxx")
    assert len(note.text) < 10_010


@given(data=st.data())
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_cut_at_any_byte_it_goes_on_and_says_so(
    make_whole: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    whole = make_whole.read_bytes()
    first_line = whole.index(b"\n") + 1
    size = data.draw(st.integers(first_line, len(whole)))
    zeros = data.draw(st.sampled_from([0, 0, 3, 4096]))
    path = tmp_path_factory.mktemp("cut") / "session-0001.jsonl"
    path.write_bytes(whole[:size] + bytes(zeros))
    kept = whole[:size].count(b"\n")
    tail = whole[:size].rpartition(b"\n")[2] + bytes(zeros)

    before = Journal.read(path)
    assert len(before.lines) == kept
    assert before.torn == tail
    with Journal.resume(path, sample.identity(), VirtualClock(start_s=before.last_time_s)) as journal:
        journal.append(said.Note(text="on we go"))
    after = Journal.read(path)
    assert repr(after.lines[:kept]) == repr(before.lines)  # NaN is not equal to itself
    assert after.torn == b""
    types = [line.entry.type for line in after.lines[kept:]]
    assert types == ["repair"] * bool(tail) + ["session_resume", "note"]
    if tail:
        repair = after.lines[kept].entry
        assert isinstance(repair, said.Repair)
        assert repair.discarded_bytes == len(tail)


@pytest.fixture(scope="module")
def make_whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "session-0001.jsonl"
    with Journal.create(path, sample.begin(), VirtualClock()) as journal:
        journal.append_many(WHOLE)
    return path


@given(data=st.data())
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_byte_changed_before_the_last_line_is_never_overlooked(
    make_whole: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    damaged = bytearray(make_whole.read_bytes())
    last_line = damaged.rstrip(b"\n").rindex(b"\n") + 1
    place = data.draw(st.integers(0, last_line - 1))
    damaged[place] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("bad") / "session-0001.jsonl"
    path.write_bytes(damaged)
    with pytest.raises(DataError, match=r"session-0001\.jsonl"):
        Journal.read(path)


@pytest.mark.parametrize("drop", [1, 3])
def test_a_line_taken_out_is_found(drop: int, make_journal: MakeJournal) -> None:
    path = make_journal(*WHOLE)
    lines = path.read_bytes().splitlines(keepends=True)
    del lines[drop]
    path.write_bytes(b"".join(lines))
    with pytest.raises(DataError, match=rf":{drop + 1}: journal is damaged: line bears number {drop + 1}"):
        Journal.read(path)


def test_an_existing_journal_is_not_overwritten(make_journal: MakeJournal, clock: VirtualClock) -> None:
    path = make_journal()
    before = path.read_bytes()
    with pytest.raises(StorageError, match="exists already"):
        Journal.create(path, sample.begin(), clock)
    assert path.read_bytes() == before


def test_two_sessions_do_not_share_a_journal(make_journal: MakeJournal, clock: VirtualClock) -> None:
    path = make_journal()
    with Journal.resume(path, sample.identity(), clock):
        with pytest.raises(StorageError, match="in use by another session"):
            Journal.resume(path, sample.identity(), clock)
        assert Journal.read(path).resumes  # reading needs no lock
    Journal.resume(path, sample.identity(), clock).close()


@contextlib.contextmanager
def files_no_larger_than(size_bytes: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_takes_no_more_leaves_whole_lines(make_journal: MakeJournal, clock: VirtualClock) -> None:
    path = make_journal(*WHOLE)
    with Journal.resume(path, sample.identity(), clock) as journal:
        before = path.read_bytes()
        note = said.Note(text="x" * 300)
        with files_no_larger_than(len(before) + 100), pytest.raises(StorageError, match="cannot write journal: File"):
            journal.append(note)
        assert path.read_bytes() == before
        journal.append(note)
    assert Journal.read(path).lines[-1].entry == note


def test_an_acknowledgement_does_not_go_on_with_the_session(make_journal: MakeJournal, clock: VirtualClock) -> None:
    path = make_journal(said.SafeStop(cause="ceiling"), said.SessionEnd(reason="safe stop", verdict="INVALID"))
    path.write_bytes(path.read_bytes() + b'{"seq":3,"ti')
    with Journal.reopen(path, clock) as journal:
        journal.append(said.Acknowledgement(of_seq=1, by="me"))
    record = Journal.read(path)
    assert [line.entry.type for line in record.lines[3:]] == ["repair", "acknowledgement"]
    assert record.end is not None
    assert record.resumes == []
    assert record.unacknowledged() == []


def test_what_is_no_journal_is_named(tmp_path: Path, clock: VirtualClock) -> None:
    path = tmp_path / "session-0001.jsonl"
    with pytest.raises(DataError, match="cannot read journal: No such file"):
        Journal.read(path)
    path.write_bytes(b"")
    with pytest.raises(DataError, match="holds no whole line"):
        Journal.read(path)
    path.write_text('{"hello": 1}\n{"hello": 2}\n')
    with pytest.raises(DataError, match=r":1: journal is damaged: key 'seq' is missing"):
        Journal.read(path)
    with pytest.raises(DataError, match=r":1: journal is damaged"):
        Journal.resume(path, sample.identity(), clock)
    assert path.read_text() == '{"hello": 1}\n{"hello": 2}\n'


def test_a_newer_schema_is_refused(make_journal: MakeJournal) -> None:
    path = make_journal(said.Note(text="x"))
    path.write_bytes(path.read_bytes().replace(b"arl-journal/1", b"arl-journal/9"))
    with pytest.raises(DataError, match=r":1: journal is damaged: session_begin.schema_version.*'arl-journal/1'"):
        Journal.read(path)


WRITER = """
import sys
from pathlib import Path
import journal_samples as sample
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.journal.entries import Note
from arl_fixtures.journal.journal import Journal

with Journal.create(Path(sys.argv[1]), sample.begin(), VirtualClock()) as journal:
    while True:
        seq = journal.append_many([Note(text="n" * 50) for _ in range(7)])
        sys.stdout.write(f"{seq}\\n")
        sys.stdout.flush()
"""


@pytest.mark.parametrize("after_lines", [1, 40])
def test_what_was_acknowledged_is_there_after_a_kill(after_lines: int, tmp_path: Path) -> None:
    path = tmp_path / "session-0001.jsonl"
    child = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, cwd=Path(__file__).parent, text=True
    )
    assert child.stdout is not None
    for _ in range(after_lines):
        acknowledged = int(child.stdout.readline())
    child.send_signal(signal.SIGKILL)
    rest = child.stdout.read().split("\n")
    acknowledged = max([acknowledged, *(int(line) for line in rest[:-1])])
    child.stdout.close()
    child.wait()
    assert len(Journal.read(path).lines) >= acknowledged + 1
    Journal.resume(path, sample.identity(), VirtualClock()).close()
