"""What happened besides measuring: faults, alarms, safe stops, resumes, as a table in order of time."""

from __future__ import annotations

from typing import Final

from arl_fixtures.journal.entries import (
    Acknowledgement,
    Alarm,
    Entry,
    Fault,
    Note,
    Recovery,
    Repair,
    SafeAction,
    SafeStop,
    SessionEnd,
    SessionResume,
)
from arl_fixtures.journal.record import SessionRecord
from arl_fixtures.report.blocks import Cell, Section, Table, Text, Tone
from arl_fixtures.report.text import shown, unit_text, utc_text

MOST_EVENTS: Final = 300


def events(record: SessionRecord) -> Section:
    """Section with every event of a session; an open safe stop is said first."""
    rows = []
    for line in record.lines:
        told = event_text(line.entry)
        if told is not None:
            kind, tone, text = told
            rows.append((Cell(utc_text(line.utc_ns)), Cell(str(line.seq + 1)), Cell(kind, tone), Cell(text)))
    blocks: list[Text | Table] = [
        Text(text=f"Safe stop in line {seq + 1} is not acknowledged: {shown(stop.cause)}", tone="fail")
        for seq, stop in record.unacknowledged()
    ]
    if record.end is None:
        blocks.append(
            Text(text="The session has not ended: it is running, or it died and was not resumed.", tone="conditional")
        )
    if record.torn:
        blocks.append(Text(text=f"{len(record.torn)} bytes of a torn last line are left out.", tone="conditional"))
    blocks.append(
        Table(
            header=("Time", "Line", "What", "Text"),
            rows=tuple(rows[:MOST_EVENTS]),
            weights=(2.4, 0.8, 1.6, 5.2),
            note=f"The first {MOST_EVENTS} of {len(rows)}." if len(rows) > MOST_EVENTS else "",
        )
        if rows
        else Text(text="No fault, alarm, safe stop or interruption.")
    )
    return Section(title="Events", blocks=tuple(blocks))


def event_text(entry: Entry) -> tuple[str, Tone, str] | None:
    """What kind of event, how grave, and what it says; None for what is no event."""
    match entry:
        case Alarm():
            value = "" if entry.value is None else f" at {entry.value:.6g} {unit_text(entry.unit)}".rstrip()
            return "alarm", "fail", shown(f"{entry.source}: {entry.condition}{value}; {entry.action}")
        case Fault():
            return "fault", "invalid", shown(f"{entry.device}: {entry.message}; {entry.action}")
        case SafeStop():
            actions = "; ".join(_action_text(action) for action in entry.actions)
            return "safe stop", "fail", shown(f"{entry.cause}. {actions}".strip())
        case Acknowledgement():
            return "acknowledged", "", shown(f"line {entry.of_seq + 1} by {entry.by}: {entry.note}")
        case SessionResume():
            identity = entry.identity
            return "resumed", "conditional", shown(f"{entry.reason} (software {identity.software_version})".strip())
        case Recovery():
            return (
                "recovery",
                "",
                shown(f"{entry.path}: {entry.message_count} messages of {entry.source}; {entry.fault}"),
            )
        case Repair():
            return "repair", "conditional", f"{entry.discarded_bytes} bytes of a torn line were cut off"
        case Note():
            return "note", "", shown(entry.text)
        case SessionEnd() if entry.reason != "finished":
            return "ended", "conditional", shown(entry.reason)
        case _:
            return None


def _action_text(action: SafeAction) -> str:
    proven = "verified" if action.verified else "NOT VERIFIED"
    return f"{action.name} {proven}: {action.detail}" if action.detail else f"{action.name} {proven}"
