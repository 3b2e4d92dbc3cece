"""Journal lines as bytes: an entry in its envelope, each line chained to the one before.

`prev` is the start of the SHA-256 of the line before, so that a line changed, lost or put in between is found.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from pydantic import ValidationError

from arl_fixtures.errors import DataError
from arl_fixtures.journal.entries import ENTRY, Entry, JournalModel, SessionBegin

FIRST: Final = "0" * 16
_ENVELOPE: Final = ("seq", "time_s", "utc_ns", "prev")


class Line(NamedTuple):
    """One entry as journalled.

    Attributes:
        seq: position in the file, from 0.
        time_s: bench clock.
        utc_ns: bench UTC, nanoseconds.
        entry: what it says.
    """

    seq: int
    time_s: float
    utc_ns: int
    entry: Entry


class Contents(NamedTuple):
    """A journal file read.

    Attributes:
        lines: all whole lines.
        size: bytes they take: where the next line belongs.
        last_hash: for the next line's `prev`.
        torn: bytes after the last whole line, empty in a file that was not cut.
    """

    lines: list[Line]
    size: int
    last_hash: str
    torn: bytes


def encode(seq: int, time_s: float, utc_ns: int, prev: str, entry: JournalModel) -> bytes:
    """One line with its end."""
    body = entry.model_dump_json()
    return f'{{"seq":{seq},"time_s":{time_s!r},"utc_ns":{utc_ns},"prev":"{prev}",{body[1:]}\n'.encode()


def line_hash(line: bytes) -> str:
    """What the next line bears as `prev`."""
    return hashlib.sha256(line).hexdigest()[:16]


def read_lines(path: Path) -> Contents:
    """All lines of a journal; what comes after the last line's end is torn and set apart.

    Raises:
        DataError: not readable, no whole line, or a whole line is damaged; the message names the line.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot read journal: {error.strerror}") from None
    *whole, rest = data.split(b"\n")
    lines: list[Line] = []
    size, prev = 0, FIRST
    for number, raw in enumerate(whole, start=1):
        try:
            line = _decode(raw, len(lines), prev)
        except ValueError as error:
            raise DataError(f"{path}:{number}: journal is damaged: {error}") from None
        lines.append(line)
        size += len(raw) + 1
        prev = line_hash(raw + b"\n")
    if not lines:
        raise DataError(f"{path}: journal holds no whole line")
    if not isinstance(lines[0].entry, SessionBegin):
        raise DataError(f"{path}:1: journal does not begin with 'session_begin' but with '{lines[0].entry.type}'")
    return Contents(lines, size, prev, rest)


def _decode(raw: bytes, seq: int, prev: str) -> Line:
    values = _JSON.decode(raw.decode())
    if not isinstance(values, dict):
        raise ValueError("line is no object")
    try:
        envelope = {name: values.pop(name) for name in _ENVELOPE}
    except KeyError as error:
        raise ValueError(f"key {error} is missing") from None
    if envelope["seq"] != seq:
        raise ValueError(f"line bears number {envelope['seq']}, expected {seq}")
    if envelope["prev"] != prev:
        raise ValueError("line does not follow from the one before: one of them was changed")
    try:
        entry = ENTRY.validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{place}: {first['msg']}") from None
    return Line(seq, float(envelope["time_s"]), int(envelope["utc_ns"]), entry)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no JSON")


_JSON: Final = json.JSONDecoder(parse_constant=_refuse)
