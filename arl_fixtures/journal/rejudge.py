"""Old measurements against new limits: a journal of its own that says what it was made from.

The measurements are copied as they are, so that every report can be made from it as from any journal.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from arl_fixtures.errors import StorageError
from arl_fixtures.journal.bridge import conditions_of, judgement_entry, measurement_of
from arl_fixtures.journal.entries import CycleEnd, JournalModel, Judgement, SessionEnd, StepEnd
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.lines import Line
from arl_fixtures.journal.record import AttemptRecord, SessionRecord
from arl_fixtures.metrics.judge import judge, overall
from arl_fixtures.metrics.limits import LimitSet
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.recording.bag_folder import PART_SUFFIX
from arl_fixtures.recording.names import safe_file_name

_REPLACED: Final = (Judgement, CycleEnd, SessionEnd)


class _Then:
    """A clock that stands where the old line stood."""

    def __init__(self, line: Line) -> None:
        self.line = line

    @property
    def now_s(self) -> float:
        return self.line.time_s

    def utc_ns(self) -> int:
        return self.line.utc_ns


def rejudged_path(record: SessionRecord, limits: LimitSet, limits_sha256: str) -> Path:
    """Beside the journal it is made from, because bags are named relative to it; other limits, another name."""
    name = safe_file_name(f"{record.path.stem}-rejudged-{limits.name}-v{limits.version}-{limits_sha256[:6]}")
    return record.path.with_name(f"{name}.jsonl")


def rejudge(record: SessionRecord, limits: LimitSet, limits_sha256: str) -> SessionRecord:
    """Write the journal of a re-judgement, at `rejudged_path`.

    Args:
        record: the journal whose measurements are judged anew.
        limits: the new limits.
        limits_sha256: their hash.

    Returns:
        the new journal, read.

    Raises:
        StorageError: the file is there already or cannot be written.
        UnitError: a limit's unit is of another dimension than what it is to judge.
    """
    identity = record.identity.model_copy(update={"limits_name": limits.name, "limits_sha256": limits_sha256})
    begin = record.begin.model_copy(update={"identity": identity, "rejudged_from": record.path.name})
    judged = {(a.begin.step_id, a.begin.attempt): _judge(record, a, limits) for a in record.attempts}
    path = rejudged_path(record, limits, limits_sha256)
    if path.exists():
        raise StorageError(f"{path}: this re-judgement exists already and is not overwritten")
    part = path.with_name(path.name + PART_SUFFIX)
    part.unlink(missing_ok=True)
    with Journal.create(part, begin, _Then(record.lines[0])) as journal:
        journal.append_at(list(_lines(record, judged)))
    part.rename(path)
    return Journal.read(path)


class _Judged(NamedTuple):
    """An attempt judged anew; `verdict` is the old one where there was nothing to judge."""

    entries: Sequence[JournalModel]
    verdict: Verdict
    reason: str


def _lines(
    record: SessionRecord, judged: Mapping[tuple[str, int], _Judged]
) -> Iterator[tuple[float, int, JournalModel]]:
    for line in record.lines[1:]:
        entry: JournalModel = line.entry
        if isinstance(entry, StepEnd):
            anew = judged[entry.step_id, entry.attempt]
            yield from ((line.time_s, line.utc_ns, each) for each in anew.entries)
            entry = entry.model_copy(update={"verdict": anew.verdict.value, "reason": anew.reason})
        if not isinstance(entry, _REPLACED):
            yield line.time_s, line.utc_ns, entry
    last = record.lines[-1]
    verdict = worst(_step_verdict(record, step_id, judged) for step_id in record.begin.plan)
    end = SessionEnd(reason=f"re-judged from {record.path.name}", verdict=verdict.value)
    yield last.time_s, last.utc_ns, end


def _step_verdict(record: SessionRecord, step_id: str, judged: Mapping[tuple[str, int], _Judged]) -> Verdict:
    """As `StepRecord.verdict`, from the new judgements; NOT_RUN where the session never came to the step."""
    step = record.steps.get(step_id)
    if step is None:
        return Verdict.NOT_RUN
    finished = [judged[step_id, each.begin.attempt].verdict for each in step.attempts if each.finished]
    if Verdict.FAIL in finished:
        return Verdict.FAIL
    return finished[-1] if finished else Verdict.INVALID


def _judge(record: SessionRecord, attempt: AttemptRecord, limits: LimitSet) -> _Judged:
    types = {dut.serial: dut.model for dut in record.identity.duts}
    measurements = [measurement_of(entry) for entry in attempt.measurements]
    judgements = judge(measurements, limits, conditions_of(attempt, record.begin.environment), types)
    step_id, number = attempt.begin.step_id, attempt.begin.attempt
    entries = [judgement_entry(step_id, number, each, limits) for each in judgements]
    if not attempt.finished or not judgements:
        return _Judged(entries, Verdict(attempt.verdict), attempt.end.reason if attempt.end else "")
    verdict, decisive = overall(judgements)
    return _Judged(entries, verdict, "" if decisive is None else f"{decisive.measurement.name}: {decisive.reason}")
