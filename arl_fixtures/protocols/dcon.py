"""DCON ASCII: the command set of ICP DAS I-7018 and Advantech ADAM-4018 thermocouple modules.

A frame is a lead character, two hexadecimal digits of address, a command, optionally two digits of checksum, and
CR. What a module does not understand, what is not for it, and what has a wrong checksum gets no answer.
"""

from __future__ import annotations

import re
from enum import Enum
from typing import Final, Literal, NamedTuple

from pydantic import Field

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.yaml_model import FileModel

RangeDialect = Literal["adam", "icp"]
"""How a module writes a value out of range: ADAM `+9999` / `-0000`, ICP DAS `+9999.9` / `-9999.9`."""

TYPE_K: Final = 0x0F
"""Type code of a thermocouple of type K."""

BAUD_CODES: Final[dict[int, int]] = {
    0x03: 1200,
    0x04: 2400,
    0x05: 4800,
    0x06: 9600,
    0x07: 19200,
    0x08: 38400,
    0x09: 57600,
    0x0A: 115200,
}
"""Baud code to bits per second, ICP-compatible (NuDAM has 09 = 115200)."""

CHECKSUM_BIT: Final = 0x40
FORMAT_MASK: Final = 0x03
"""Bits of the format byte: checksum on; data format, 0 = engineering units."""


class DconWire(FileModel):
    """What both sides of the line must agree on.

    Modules leave the factory without checksum; here it is on, as without it a flipped digit is a temperature.
    """

    address: int = Field(default=1, ge=0, le=255, description="of the module")
    checksum: bool = Field(default=True, description="as set at the module")
    channels: int = Field(default=8, ge=1, le=16, description="channels in the answer to #AA, used or not")


class RangeFault(Enum):
    """Why a channel has no temperature."""

    OVER = "over range or open"
    UNDER = "under range"


class Value(NamedTuple):
    """One channel: degrees Celsius, or None and why."""

    value_c: float | None
    fault: RangeFault | None


class Config(NamedTuple):
    """Answer to `$AA2`."""

    type_code: int
    baud_code: int
    format_code: int

    @property
    def checksum(self) -> bool:
        """Whether the module uses checksums."""
        return bool(self.format_code & CHECKSUM_BIT)

    @property
    def engineering(self) -> bool:
        """Whether values are in engineering units (and not percent of span or hexadecimal)."""
        return self.format_code & FORMAT_MASK == 0


_LEADS: Final = b">!?"
_VALUE: Final = re.compile(r"[+-]\d{1,5}(?:\.\d{1,4})?")
_VALUES: Final = re.compile(r"(?:[+-]\d{1,5}(?:\.\d{1,4})?)+")
_LONGEST_LINE: Final = 256


def checksum(frame: bytes) -> bytes:
    """Low byte of the sum of all characters, as two upper-case hexadecimal digits."""
    return b"%02X" % (sum(frame) & 0xFF)


def encode(text: str, *, with_checksum: bool) -> bytes:
    """Frame as it goes on the line.

    Raises:
        LocalProtocolError: the text is empty or not printable ASCII.
    """
    if not text or not text.isascii() or not text.isprintable():
        raise LocalProtocolError(f"DCON: {text!r} cannot be sent; expected printable ASCII")
    frame = text.encode("ascii")
    return frame + checksum(frame) + b"\r" if with_checksum else frame + b"\r"


def find_replies(received: bytes, *, with_checksum: bool) -> list[str]:
    """All complete answers in what was received, without checksum and CR, garbage before them removed.

    With checksums, an answer begins at the first lead character from which the checksum is right; without them,
    at the last lead character of its line. Lines that hold no answer are skipped.
    """
    replies = []
    *lines, _ = received.split(b"\r")
    for line in lines:
        starts = [place for place, byte in enumerate(line) if byte in _LEADS]
        if not with_checksum:
            starts = starts[-1:]
        for start in starts:
            frame = line[start:]
            if with_checksum:
                if len(frame) < 3 or checksum(frame[:-2]) != frame[-2:]:
                    continue
                frame = frame[:-2]
            if frame.isascii():
                replies.append(frame.decode("ascii"))
                break
    return replies


def take_requests(buffer: bytearray, *, with_checksum: bool) -> list[str]:
    """Remove complete lines from `buffer` and return the requests among them whose checksum is right."""
    requests = []
    while (end := buffer.find(b"\r")) >= 0:
        frame = bytes(buffer[:end])
        del buffer[: end + 1]
        if with_checksum:
            if len(frame) < 3 or checksum(frame[:-2]) != frame[-2:]:
                continue
            frame = frame[:-2]
        if frame and frame.isascii():
            requests.append(frame.decode("ascii"))
    if len(buffer) > _LONGEST_LINE:
        del buffer[:-_LONGEST_LINE]
    return requests


def parse_values(text: str) -> tuple[Value, ...]:
    """Channels of a `#AA` answer (without `>`), both dialects of out-of-range.

    Values are told apart by their signs: ADAM's `+9999` is shorter than the usual seven characters.

    Raises:
        RemoteProtocolError: the text is something else.
    """
    if _VALUES.fullmatch(text) is None:
        raise RemoteProtocolError(f"DCON: expected signed values, got {text[:80]!r}")
    return tuple(_parse_value(match) for match in _VALUE.findall(text))


def _parse_value(text: str) -> Value:
    number = float(text)
    if number >= 9999.0:
        return Value(None, RangeFault.OVER)
    if number <= -9999.0 or text == "-0000":
        return Value(None, RangeFault.UNDER)
    return Value(number, None)


def format_value(value: Value, dialect: RangeDialect) -> str:
    """One channel as a module writes it: sign, five digits and one point, or the dialect's out-of-range text.

    Raises:
        LocalProtocolError: the value does not fit (10 000 and beyond).
    """
    if value.fault is RangeFault.OVER:
        return "+9999" if dialect == "adam" else "+9999.9"
    if value.fault is RangeFault.UNDER:
        return "-0000" if dialect == "adam" else "-9999.9"
    if value.value_c is None or abs(value.value_c) >= 9998.95:
        raise LocalProtocolError(f"DCON: {value.value_c} does not fit five digits")
    text = f"{value.value_c:+07.1f}"
    return "+0000.0" if text == "-0000.0" else text


def parse_config(text: str, address: int) -> Config:
    """Answer to `$AA2`, `!AATTCCFF`.

    Raises:
        RemoteProtocolError: it has another form.
    """
    match = re.fullmatch(rf"!{address:02X}([0-9A-F]{{2}})([0-9A-F]{{2}})([0-9A-F]{{2}})", text)
    if match is None:
        raise RemoteProtocolError(f"DCON: expected !{address:02X}TTCCFF, got {text[:80]!r}")
    return Config(*(int(part, 16) for part in match.groups()))


def format_config(config: Config, address: int) -> str:
    """Answer to `$AA2`."""
    return f"!{address:02X}{config.type_code:02X}{config.baud_code:02X}{config.format_code:02X}"
