"""Conrad 8-relay board (197720, 197730): four-byte frames on RS-232, daisy-chained.

    frame    command, address, data, exclusive or of the three
    answer   255 − command, own address, data, exclusive or

Bit 0 of the data is relay K1. There is no start byte. A frame that no board of the chain took comes back unchanged,
as does the end of SETUP (with the address after the last board's) and a broadcast.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

from pydantic import Field

from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.yaml_model import FileModel

FRAME_BYTES: Final = 4
RELAYS: Final = 8
BROADCAST: Final = 0


class ConradWire(FileModel):
    """What both sides of the line must agree on."""

    address: int = Field(default=1, ge=1, le=255, description="given to the first board of the chain by SETUP")


class Command(IntEnum):
    """What a host can ask."""

    NOP = 0
    SETUP = 1
    GET_PORT = 2
    SET_PORT = 3
    GET_OPTION = 4
    SET_OPTION = 5
    SET_SINGLE = 6
    DEL_SINGLE = 7
    TOGGLE = 8


ERROR: Final = 0xFF
"""First byte of the answer to a frame with a wrong check byte; NOP is answered alike."""

OPTION_EXECUTE_BROADCAST: Final = 1
OPTION_BLOCK_BROADCAST: Final = 2
OPTION_DEFAULT: Final = OPTION_EXECUTE_BROADCAST


class Frame(NamedTuple):
    """A frame without its check byte."""

    command: int
    address: int
    data: int

    @property
    def answers(self) -> int:
        """The command of which this would be the answer."""
        return 0xFF - self.command


def encode(frame: Frame) -> bytes:
    """Four bytes of a frame.

    Raises:
        LocalProtocolError: a field is no byte.
    """
    command, address, data = frame
    try:
        return bytes((command, address, data, command ^ address ^ data))
    except ValueError:
        raise LocalProtocolError(f"relay board: {frame} does not fit bytes") from None


def decode(data: bytes) -> Frame | None:
    """Frame in four bytes, or None if the check byte is wrong.

    Raises:
        LocalProtocolError: not four bytes.
    """
    if len(data) != FRAME_BYTES:
        raise LocalProtocolError(f"relay board: a frame has {FRAME_BYTES} bytes, got {len(data)}")
    command, address, value, check = data
    return Frame(command, address, value) if command ^ address ^ value == check else None


def mask(relay: int) -> int:
    """Data bit of relay K1…K8.

    Raises:
        LocalProtocolError: there is no such relay.
    """
    if not 1 <= relay <= RELAYS:
        raise LocalProtocolError(f"relay board: no relay K{relay}; expected K1…K{RELAYS}")
    return 1 << (relay - 1)


def find_reply(received: bytes, command: int, address: int) -> Frame | None:
    """The board's answer to `command`, or the frame itself come back, in what was received.

    Every offset is tried, as frames have no start byte. A returned frame has the request's command, not its
    inverse: nobody took it.
    """
    for start in range(len(received) - FRAME_BYTES + 1):
        head = received[start]
        if received[start + 1] != address or head not in (0xFF - command, command):
            continue
        frame = decode(received[start : start + FRAME_BYTES])
        if frame is not None:
            return frame
    return None


def find_error(received: bytes, address: int) -> Frame | None:
    """The board's complaint about a wrong check byte, in what was received."""
    for start in range(len(received) - FRAME_BYTES + 1):
        if received[start] == ERROR and received[start + 1] == address:
            frame = decode(received[start : start + FRAME_BYTES])
            if frame is not None:
                return frame
    return None


def find_setup_end(received: bytes, address: int) -> tuple[Frame, ...] | None:
    """All boards' answers to a finished SETUP that numbers them from `address`.

    Each board answers, and what comes out at the end of the chain carries the number after the last board's.

    Returns:
        The answers in chain order (data = firmware version), empty if no board took it; None while the end is
        missing.
    """
    for start in range(len(received) - FRAME_BYTES + 1):
        boards: list[Frame] = []
        for place in range(start, len(received) - FRAME_BYTES + 1, FRAME_BYTES):
            frame = decode(received[place : place + FRAME_BYTES])
            if frame is None or frame.address != address + len(boards):
                break
            if frame.command == Command.SETUP:
                return tuple(boards)
            if frame.answers != Command.SETUP:
                break
            boards.append(frame)
        else:
            if boards:
                # answers in step with the chain: its end is under way, and no other reading of these bytes is better
                return None
    return None
