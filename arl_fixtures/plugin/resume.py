"""What an interrupted session left: finished steps, attempts that broke off, cut bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.devices.port import Clock
from arl_fixtures.errors import ArlError, DataError
from arl_fixtures.journal import entries
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.record import AttemptRecord, SessionRecord, read_journal
from arl_fixtures.journal.resume import check_same, damaged_bags, new_journal_path, newest_journal
from arl_fixtures.plugin.journaling import identity, session_begin
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.recording.bag_folder import PART_SUFFIX
from arl_fixtures.recording.names import bag_name
from arl_fixtures.recording.recover import RECOVERED_SUFFIX, recover


@final
@dataclass
class Past:
    """The journal of the session that is resumed, or nothing.

    Attributes:
        record: the journal as read; None for a new session.
        damaged: step ids whose finished bag is not what the journal says, with the reason.
    """

    record: SessionRecord | None = None
    damaged: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, out: Path, *, resume: bool) -> Past:
        """The newest journal in the output folder where the user asked to resume.

        Raises:
            DataError: there is none, it is damaged, or a safe stop waits for its acknowledgement.
        """
        if not resume:
            return cls()
        record = read_journal(newest_journal(out))
        waiting = record.unacknowledged()
        if waiting:
            seq, stop = waiting[0]
            raise DataError(
                f"{record.path}:{seq + 1}: the bench was brought into its safe state ({stop.cause}); "
                "look at it, then acknowledge with `arl ack`"
            )
        return cls(record, {bag.step_id: reason for bag, reason in damaged_bags(record)})

    @property
    def start_s(self) -> float:
        """Bench time at which a virtual clock goes on."""
        return self.record.last_time_s if self.record is not None else 0.0

    def finished(self, step_id: str) -> AttemptRecord | None:
        """The finished attempt at a step whose recording is whole."""
        if self.record is None or step_id not in self.record.steps or step_id in self.damaged:
            return None
        done = [attempt for attempt in self.record.steps[step_id].attempts if attempt.finished]
        return done[-1] if done else None

    def verdict(self, step_id: str) -> str:
        """Verdict of a finished step: a later pass does not erase an earlier fail."""
        assert self.record is not None
        return self.record.steps[step_id].verdict

    def failures(self, step_id: str) -> list[str]:
        """Why earlier attempts at a step did not finish, one each."""
        if self.record is None or step_id not in self.record.steps:
            return []
        return [
            f"attempt {attempt.begin.attempt}: {_why(attempt, self.damaged.get(step_id, ''))}"
            for attempt in self.record.steps[step_id].attempts
        ]

    def open(self, files: SessionFiles, plan: Sequence[CycleStep], clock: Clock) -> Journal:
        """The journal to go on with: the old one, or a new one in the output folder.

        Cut bags are recovered, and that is journalled.

        Raises:
            DataError: the journal is of another DUT, bench or profile; the message names the difference.
            StorageError: the journal cannot be written.
        """
        out = files.options.out
        if self.record is None:
            return Journal.create(new_journal_path(out), session_begin(files, plan), clock)
        now = identity(files)
        check_same(self.record, now)
        journal = Journal.resume(self.record.path, now, clock, reason="resumed with --resume")
        cut = [attempt for attempt in self.record.attempts if not attempt.finished]
        journal_lines: list[entries.JournalModel] = []
        for attempt in cut:
            begin = attempt.begin
            if attempt.end is None:
                journal_lines.append(
                    entries.StepEnd(
                        step_id=begin.step_id,
                        attempt=begin.attempt,
                        finished=False,
                        verdict="INVALID",
                        reason="the session ended within this attempt",
                    )
                )
            journal_lines += _recovered(out, begin)
        if journal_lines:
            journal.append_many(journal_lines)
        return journal


def _recovered(out: Path, begin: entries.StepBegin) -> list[entries.JournalModel]:
    """Keep what is whole of an unfinished attempt's bag, once."""
    name = bag_name(begin.step_id, begin.attempt)
    part = out / "bags" / (name + PART_SUFFIX)
    kept = out / "bags" / (name + RECOVERED_SUFFIX)
    if not part.is_dir() or kept.exists():
        return []
    try:
        recovery = recover(part, kept)
    except ArlError as error:
        return [entries.Note(text=f"nothing could be recovered of {part.name}: {error}")]
    return [
        entries.Recovery(
            step_id=begin.step_id,
            attempt=begin.attempt,
            source=part.name,
            path=kept.name,
            sha256=recovery.sha256,
            message_count=sum(recovery.messages.values()),
            fault=recovery.fault,
        )
    ]


def _why(attempt: AttemptRecord, damage: str) -> str:
    if attempt.finished:
        return damage or "its recording is damaged"
    return attempt.end.reason if attempt.end is not None else "the session ended within it"
