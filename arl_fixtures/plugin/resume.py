"""What an interrupted session left: finished steps, attempts that broke off, cut bags."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

from arl_fixtures.bench.keep import keep_bench, keep_file
from arl_fixtures.bench.profile import CycleStep, profile_path
from arl_fixtures.devices.port import Clock
from arl_fixtures.errors import ArlError
from arl_fixtures.journal import entries
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.record import AttemptRecord, SessionRecord, read_journal
from arl_fixtures.journal.resume import check_same, damaged_bags, new_journal_path, newest_journal
from arl_fixtures.plugin.journaling import identity, session_begin
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.recording.bag_folder import PART_SUFFIX, bag_sha256
from arl_fixtures.recording.names import bag_name
from arl_fixtures.recording.recover import RECOVERED_SUFFIX, recover
from arl_fixtures.recording.scan import McapScan


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
            DataError: there is none, or it is damaged.
        """
        if not resume:
            return cls()
        record = read_journal(newest_journal(out))
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

    @property
    def cycle_ends(self) -> dict[int, entries.CycleEnd]:
        """What was journalled of each cycle that is over, by cycle count."""
        lines = self.record.lines if self.record is not None else []
        return {line.entry.cycle: line.entry for line in lines if isinstance(line.entry, entries.CycleEnd)}

    def failures(self, step_id: str) -> list[str]:
        """Why earlier attempts at a step did not finish, one each."""
        if self.record is None or step_id not in self.record.steps:
            return []
        return [
            f"attempt {attempt.begin.attempt}: {_why(attempt, self.damaged.get(step_id, ''))}"
            for attempt in self.record.steps[step_id].attempts
        ]

    def open(self, files: SessionFiles, plan: Sequence[CycleStep], clock: Clock, *, last_stop: str = "") -> Journal:
        """The journal to go on with: the old one, or a new one in the output folder.

        Cut bags are recovered, and that is journalled.

        Args:
            files: of the session.
            plan: its steps.
            clock: the bench clock.
            last_stop: what the guard says of the last stop, and of who acknowledged it.

        Raises:
            DataError: the journal is of another DUT, bench or profile; the message names the difference.
            StorageError: the journal cannot be written.
        """
        out = files.options.out
        if self.record is None:
            keep_inputs(files)
            return Journal.create(new_journal_path(out), session_begin(files, plan), clock)
        now = identity(files)
        check_same(self.record, now)
        keep_inputs(files)
        journal = Journal.resume(self.record.path, now, clock, reason="resumed with --resume")
        cut = [attempt for attempt in self.record.attempts if not attempt.finished]
        # the guard lets nobody drive a bench whose stop was not acknowledged: it has been
        note = f"the bench may be driven again; {last_stop}".rstrip("; ")
        journal_lines: list[entries.JournalModel] = [
            entries.Acknowledgement(of_seq=seq, by="guard", note=note)
            for seq, _ in self.record.unacknowledged()
        ]
        known = {line.entry.path for line in self.record.lines if isinstance(line.entry, entries.Recovery)}
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
            journal_lines += _recovered(out, begin, known)
        if journal_lines:
            journal.append_many(journal_lines)
        return journal


def keep_inputs(files: SessionFiles) -> None:
    """Copy the session's files beside the journal, for its reports.

    Raises:
        ConfigError: one of them was changed after it had been read.
        StorageError: they cannot be written.
    """
    out = files.options.out
    keep_bench(files.bench, out)
    keep_file(profile_path(files.options.profile), files.hashes["profile"], "profile", out)
    keep_file(files.options.limits, files.hashes["limits"], "limits", out)


def _recovered(out: Path, begin: entries.StepBegin, known: Set[str]) -> list[entries.JournalModel]:
    """Keep what is whole of an unfinished attempt's bag, under a name that tells it from a finished one.

    Args:
        out: folder of the journal.
        begin: the attempt.
        known: recovered bags that the journal holds already.
    """
    bags, name = out / "bags", bag_name(begin.step_id, begin.attempt)
    whole, part, kept = bags / name, bags / (name + PART_SUFFIX), bags / (name + RECOVERED_SUFFIX)
    if kept.name in known:
        return []
    try:
        if kept.is_dir():
            source, fault = kept, "kept by an earlier session that died before it could say so"
        elif whole.is_dir():
            whole.rename(kept)
            source, fault = whole, "whole, but its values were never journalled"
        elif part.is_dir():
            source, fault = part, recover(part, kept).fault
        else:
            return []
        sha256, count = bag_sha256(kept), sum(1 for file in kept.glob("*.mcap") for _ in McapScan(file).messages())
    except (ArlError, OSError) as error:
        return [entries.Note(text=f"nothing could be recovered of {name}: {error}")]
    return [
        entries.Recovery(
            step_id=begin.step_id,
            attempt=begin.attempt,
            source=source.name,
            path=kept.name,
            sha256=sha256,
            message_count=count,
            fault=fault,
        )
    ]


def _why(attempt: AttemptRecord, damage: str) -> str:
    if attempt.finished:
        return damage or "its recording is damaged"
    return attempt.end.reason if attempt.end is not None else "the session ended within it"
