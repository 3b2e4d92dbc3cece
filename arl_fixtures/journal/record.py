"""What a journal says, put together: steps, attempts, verdicts. Nothing is left out and nothing replaced."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from arl_fixtures.errors import DataError
from arl_fixtures.journal.entries import (
    Acknowledgement,
    Bag,
    Identity,
    Judgement,
    Measurement,
    SafeStop,
    SessionBegin,
    SessionEnd,
    SessionResume,
    Settle,
    StepBegin,
    StepEnd,
    VerdictName,
)
from arl_fixtures.journal.lines import Line, read_lines
from arl_fixtures.recording.names import inside

MAX_ATTEMPTS: Final = 3


@dataclass(slots=True)
class AttemptRecord:
    """One attempt at a step.

    Attributes:
        begin: which step, which attempt.
        begin_utc_ns: when.
        end: None when the session died within.
        end_utc_ns: when; 0 without an end.
        settle: None when it did not come to it.
        bag: None when nothing was recorded to the end.
        measurements: in order.
        judgements: in order.
    """

    begin: StepBegin
    begin_utc_ns: int
    end: StepEnd | None = None
    end_utc_ns: int = 0
    settle: Settle | None = None
    bag: Bag | None = None
    measurements: list[Measurement] = field(default_factory=list)
    judgements: list[Judgement] = field(default_factory=list)

    @property
    def finished(self) -> bool:
        """Whether it ran to its end, whatever the verdict."""
        return self.end is not None and self.end.finished

    @property
    def verdict(self) -> VerdictName:
        """Its verdict; INVALID when it did not run to its end."""
        return self.end.verdict if self.end is not None else "INVALID"


@dataclass(slots=True)
class StepRecord:
    """All attempts at one step, in order."""

    step_id: str
    attempts: list[AttemptRecord] = field(default_factory=list)

    @property
    def begin(self) -> StepBegin:
        """Cycle, index, set temperature and ramp are those of any attempt."""
        return self.attempts[0].begin

    @property
    def finished(self) -> bool:
        """Whether one attempt ran to its end."""
        return any(attempt.finished for attempt in self.attempts)

    @property
    def verdict(self) -> VerdictName:
        """FAIL if any finished attempt failed: a later pass does not erase it. Else that of the last finished one."""
        finished = [attempt.verdict for attempt in self.attempts if attempt.finished]
        if "FAIL" in finished:
            return "FAIL"
        return finished[-1] if finished else "INVALID"


@dataclass(slots=True)
class SessionRecord:
    """A journal read.

    Attributes:
        path: the file.
        lines: every line.
        begin: its first.
        resumes: interruptions after which it went on.
        end: None while it runs or when it died.
        steps: by id, in the order they were first begun.
        torn: bytes after the last whole line; empty unless the last session died while writing.
    """

    path: Path
    lines: list[Line]
    begin: SessionBegin
    resumes: list[SessionResume] = field(default_factory=list)
    end: SessionEnd | None = None
    steps: dict[str, StepRecord] = field(default_factory=dict)
    torn: bytes = b""

    @property
    def identity(self) -> Identity:
        """What it was begun with."""
        return self.begin.identity

    @property
    def last_time_s(self) -> float:
        """Bench time of the last line: where a resumed virtual clock goes on."""
        return self.lines[-1].time_s

    @property
    def attempts(self) -> Iterator[AttemptRecord]:
        """Every attempt at every step."""
        return (attempt for step in self.steps.values() for attempt in step.attempts)

    def bag_path(self, bag: Bag) -> Path:
        """Where a bag lies.

        Raises:
            StorageError: the journal names a place outside its folder.
        """
        return inside(self.path.parent, bag.path)

    def unacknowledged(self) -> list[tuple[int, SafeStop]]:
        """Safe stops that nobody has taken note of, with their sequence numbers."""
        known = {line.entry.of_seq for line in self.lines if isinstance(line.entry, Acknowledgement)}
        return [
            (line.seq, line.entry)
            for line in self.lines
            if isinstance(line.entry, SafeStop) and line.seq not in known
        ]


def read_journal(path: Path) -> SessionRecord:
    """Read a journal, also while it is being written.

    Raises:
        DataError: it is damaged before its last line, or a line belongs to no attempt; the message names the line.
    """
    contents = read_lines(path)
    first = contents.lines[0].entry
    assert isinstance(first, SessionBegin)  # read_lines has seen to it
    record = SessionRecord(path, contents.lines, first, torn=contents.torn)
    attempts: dict[tuple[str, int], AttemptRecord] = {}
    for line in contents.lines:
        try:
            _take(record, attempts, line)
        except KeyError:
            where = f"{path}:{line.seq + 1}"
            raise DataError(f"{where}: '{line.entry.type}' of a step attempt that was never begun") from None
    return record


def _take(record: SessionRecord, attempts: dict[tuple[str, int], AttemptRecord], line: Line) -> None:
    entry = line.entry
    match entry:
        case StepBegin():
            if (entry.step_id, entry.attempt) in attempts:
                where = f"{record.path}:{line.seq + 1}"
                raise DataError(f"{where}: attempt {entry.attempt} at step {entry.step_id} begins a second time")
            attempt = attempts[entry.step_id, entry.attempt] = AttemptRecord(entry, line.utc_ns)
            record.steps.setdefault(entry.step_id, StepRecord(entry.step_id)).attempts.append(attempt)
        case StepEnd():
            attempt = attempts[entry.step_id, entry.attempt]
            attempt.end, attempt.end_utc_ns = entry, line.utc_ns
        case Settle():
            attempts[entry.step_id, entry.attempt].settle = entry
        case Bag():
            attempts[entry.step_id, entry.attempt].bag = entry
        case Measurement():
            attempts[entry.step_id, entry.attempt].measurements.append(entry)
        case Judgement():
            attempts[entry.step_id, entry.attempt].judgements.append(entry)
        case SessionResume():
            record.resumes.append(entry)
            record.end = None
        case SessionEnd():
            record.end = entry
        case _:
            pass
