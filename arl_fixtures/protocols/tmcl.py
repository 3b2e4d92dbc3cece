"""TMCL direct mode: nine-byte binary requests and answers of Trinamic motor modules.

    request  module address, command, type, motor or bank, value (signed 32 bits, big-endian), checksum
    answer   host address, module address, status, command, value, checksum

The checksum is the low byte of the sum of the first eight. There is no start byte, and an answer carries no number
of its request: only its command tells what it answers.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final, NamedTuple

from pydantic import Field

from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.yaml_model import FileModel

FRAME_BYTES: Final = 9
VALUE_MIN: Final = -(2**31)
VALUE_MAX: Final = 2**31 - 1


class TmclWire(FileModel):
    """What both sides of the line must agree on."""

    module_address: int = Field(default=1, ge=0, le=255, description="global parameter 66")
    host_address: int = Field(default=2, ge=0, le=255, description="global parameter 76")
    motor: int = Field(default=0, ge=0, le=5, description="of a module with several")


class Command(IntEnum):
    """Commands used here."""

    ROTATE_RIGHT = 1
    ROTATE_LEFT = 2
    STOP = 3
    MOVE = 4
    SET_AXIS = 5
    GET_AXIS = 6
    SET_GLOBAL = 9
    GET_GLOBAL = 10
    REFERENCE_SEARCH = 13
    GET_VERSION = 136
    NOTIFY_REACHED = 138


class MoveType(IntEnum):
    """Types of `MOVE`."""

    ABSOLUTE = 0
    RELATIVE = 1


class SearchType(IntEnum):
    """Types of `REFERENCE_SEARCH`; the status answer is 0 while none is active."""

    START = 0
    STOP = 1
    STATUS = 2


class VersionType(IntEnum):
    """Types of `GET_VERSION`: nine bytes without checksum, or a normal answer."""

    TEXT = 0
    BINARY = 1


class Axis(IntEnum):
    """Axis parameters used here (TMCM-1240)."""

    TARGET = 0
    ACTUAL = 1
    TARGET_SPEED = 2
    ACTUAL_SPEED = 3
    MAX_SPEED = 4
    ACCELERATION = 5
    RUN_CURRENT = 6
    STANDBY_CURRENT = 7
    REACHED = 8
    HOME_SWITCH = 9
    RIGHT_SWITCH = 10
    LEFT_SWITCH = 11
    RIGHT_DISABLE = 12
    LEFT_DISABLE = 13
    SOFT_STOP = 26
    MICROSTEP_RESOLUTION = 140
    SEARCH_MODE = 193
    SEARCH_SPEED = 194
    SWITCH_SPEED = 195
    SWITCH_DISTANCE = 196
    LAST_REFERENCE = 197
    ERROR_FLAGS = 207
    DRIVER_FLAGS = 208
    ENCODER = 209
    MAX_ENCODER_DEVIATION = 212
    UNIT_MODE = 255


class ErrorFlag(IntEnum):
    """Bits of axis parameter 207; reading clears them."""

    STALLGUARD = 1
    DEVIATION = 2


class StatusCode(IntEnum):
    """Status byte of an answer."""

    WRONG_CHECKSUM = 1
    INVALID_COMMAND = 2
    WRONG_TYPE = 3
    INVALID_VALUE = 4
    EEPROM_LOCKED = 5
    NOT_AVAILABLE = 6
    OK = 100
    LOADED = 101
    REACHED = 128


USER_BANK: Final = 2
"""Bank of the user variables for `SET_GLOBAL` and `GET_GLOBAL`."""


class Request(NamedTuple):
    """What a host asks of a module."""

    module: int
    command: int
    type: int = 0
    motor: int = 0
    value: int = 0


class Reply(NamedTuple):
    """What a module answers."""

    host: int
    module: int
    status: int
    command: int
    value: int


_REQUEST: Final = struct.Struct(">BBBBi")
_REPLY: Final = struct.Struct(">BBBBi")
_STATUS_CODES: Final = frozenset(int(code) for code in StatusCode)


def checksum(frame: bytes) -> int:
    """Low byte of the sum."""
    return sum(frame) & 0xFF


def encode_request(request: Request) -> bytes:
    """Nine bytes of a request.

    Raises:
        LocalProtocolError: a field does not fit.
    """
    return _encode(_REQUEST, request)


def encode_reply(reply: Reply) -> bytes:
    """Nine bytes of an answer.

    Raises:
        LocalProtocolError: a field does not fit.
    """
    return _encode(_REPLY, reply)


def _encode(form: struct.Struct, fields: tuple[int, ...]) -> bytes:
    try:
        frame = form.pack(*fields)
    except struct.error as error:
        raise LocalProtocolError(f"TMCL: {fields} does not fit a frame: {error}") from None
    return frame + bytes((checksum(frame),))


def find_reply(received: bytes, *, host: int, module: int, command: int, value: int | None = None) -> Reply | None:
    """The first answer to `command` in what was received, whatever lies around it.

    Every offset is tried, as frames have no start byte: addresses, command, a known status and the checksum
    must all be right. An answer to a request whose checksum broke on the way echoes the command, too.

    Args:
        received: bytes since the request.
        host: our address.
        module: the module's address.
        command: of the request.
        value: accept only an answer with this value.
    """
    for start in range(len(received) - FRAME_BYTES + 1):
        if (
            received[start] != host
            or received[start + 1] != module
            or received[start + 3] != command
            or received[start + 2] not in _STATUS_CODES
        ):
            continue
        frame = received[start : start + FRAME_BYTES]
        if checksum(frame[:-1]) != frame[-1]:
            continue
        reply = Reply(*_REPLY.unpack(frame[:-1]))
        if reply.status == StatusCode.REACHED or (value is not None and reply.value != value):
            continue
        return reply
    return None


def find_version_text(received: bytes, *, host: int) -> str | None:
    """The answer to `GET_VERSION` as text: host address and eight printable characters, no checksum."""
    for start in range(len(received) - FRAME_BYTES + 1):
        text = received[start + 1 : start + FRAME_BYTES]
        if received[start] == host and text.isascii() and text.decode("ascii").isprintable():
            return text.decode("ascii")
    return None


def encode_version_text(host: int, text: str) -> bytes:
    """Answer to `GET_VERSION` as text.

    Raises:
        LocalProtocolError: the text is not eight printable ASCII characters.
    """
    if len(text) != FRAME_BYTES - 1 or not text.isascii() or not text.isprintable():
        raise LocalProtocolError(f"TMCL: version text {text!r} is not eight printable ASCII characters")
    return bytes((host,)) + text.encode("ascii")


def decode_request(frame: bytes) -> Request | None:
    """Request in nine bytes, or None if the checksum is wrong.

    Raises:
        LocalProtocolError: not nine bytes.
    """
    if len(frame) != FRAME_BYTES:
        raise LocalProtocolError(f"TMCL: a frame has {FRAME_BYTES} bytes, got {len(frame)}")
    if checksum(frame[:-1]) != frame[-1]:
        return None
    return Request(*_REQUEST.unpack(frame[:-1]))


def decode_version(value: int) -> tuple[int, int, int]:
    """Module number, major and minor version from the binary form's value."""
    return value >> 16 & 0xFFFF, value >> 8 & 0xFF, value & 0xFF


def encode_version(module: int, major: int, minor: int) -> int:
    """Value of the binary version answer."""
    return module << 16 | major << 8 | minor
