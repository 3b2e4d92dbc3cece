"""What comes next after an interruption, and whether it may."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from arl_fixtures.errors import DataError, StorageError
from arl_fixtures.journal.entries import Bag, Identity
from arl_fixtures.journal.record import MAX_ATTEMPTS, SessionRecord
from arl_fixtures.recording.bag_folder import verify

JOURNAL_PATTERN: Final = "session-*.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class NextStep:
    """Where to go on.

    Attributes:
        step_id: the step; empty when the plan is done.
        attempt: number of the attempt to be made.
        given_up: steps passed over because they did not finish in the attempts they had: INVALID.
    """

    step_id: str
    attempt: int
    given_up: tuple[str, ...] = ()


def next_step(record: SessionRecord, plan: Sequence[str], max_attempts: int = MAX_ATTEMPTS) -> NextStep:
    """The first step of the plan that has no finished attempt and still has one left.

    Args:
        record: the journal.
        plan: step ids in order.
        max_attempts: attempts a step has to finish.
    """
    given_up: list[str] = []
    for step_id in plan:
        step = record.steps.get(step_id)
        if step is None:
            return NextStep(step_id=step_id, attempt=1, given_up=tuple(given_up))
        if step.finished:
            continue
        last = max(attempt.begin.attempt for attempt in step.attempts)
        if len(step.attempts) < max_attempts:
            return NextStep(step_id=step_id, attempt=last + 1, given_up=tuple(given_up))
        given_up.append(step_id)
    return NextStep(step_id="", attempt=0, given_up=tuple(given_up))


def differences(before: Identity, now: Identity) -> list[str]:
    """What makes `now` another session than `before`, in words; limits and software may change."""
    found = []
    serials = [dut.serial for dut in before.duts], [dut.serial for dut in now.duts]
    if serials[0] != serials[1]:
        gone = [serial for serial in serials[0] if serial not in serials[1]]
        new = [serial for serial in serials[1] if serial not in serials[0]]
        change = f"without {', '.join(gone)}" if gone else ""
        change += (" and " if gone and new else "") + (f"with {', '.join(new)}" if new else "")
        found.append(f"other DUTs: {change or 'in another order'} (journal: {', '.join(serials[0])})")
    else:
        found += [
            f"DUT {old.serial} is now of type {new_dut.model!r}, was {old.model!r}"
            for old, new_dut in zip(before.duts, now.duts, strict=True)
            if old.model != new_dut.model
        ]
    for what in ("bench", "profile"):
        old_name, new_name = getattr(before, f"{what}_name"), getattr(now, f"{what}_name")
        old_hash, new_hash = getattr(before, f"{what}_sha256"), getattr(now, f"{what}_sha256")
        if old_name != new_name:
            found.append(f"other {what}: {new_name!r}, journal: {old_name!r}")
        elif old_hash != new_hash:
            found.append(f"{what} {old_name!r} has changed: SHA-256 {new_hash[:12]}…, journal: {old_hash[:12]}…")
    return found


def check_same(record: SessionRecord, now: Identity) -> None:
    """Refuse to go on with another DUT, bench or profile.

    Raises:
        DataError: names every difference.
    """
    found = differences(record.identity, now)
    if found:
        raise DataError(f"{record.path}: cannot resume: {'; '.join(found)}")


def damaged_bags(record: SessionRecord) -> list[tuple[Bag, str]]:
    """Bags of finished attempts whose content is not what the journal says, with the reason."""
    found = []
    for attempt in record.attempts:
        if attempt.finished and attempt.bag is not None:
            try:
                verify(record.bag_path(attempt.bag), attempt.bag.sha256)
            except (DataError, StorageError) as error:
                found.append((attempt.bag, str(error)))
    return found


def new_journal_path(folder: Path) -> Path:
    """`session-0001.jsonl` and so on: the first number above those that are there."""
    numbers = [int(stem) for path in folder.glob(JOURNAL_PATTERN) if (stem := path.stem[8:]).isdigit()]
    return folder / f"session-{max(numbers, default=0) + 1:04d}.jsonl"


def newest_journal(folder: Path) -> Path:
    """The journal with the highest number.

    Raises:
        DataError: there is none.
    """
    numbered = {int(stem): path for path in folder.glob(JOURNAL_PATTERN) if (stem := path.stem[8:]).isdigit()}
    if not numbered:
        raise DataError(f"{folder}: holds no journal ({JOURNAL_PATTERN}): nothing to resume")
    return numbered[max(numbered)]
