"""Huber PB: ten-character requests and answers of a Huber thermostat, on TCP 8101 or a serial line.

    request  {M AA VVVV CR LF     VVVV four hexadecimal digits to write, **** to read
    answer   {S AA VVVV CR LF     the value after the write, clamped by the device

There is no checksum. A request of any other form gets no answer at all.
"""

from __future__ import annotations

import re
from enum import IntEnum, IntFlag
from typing import Final, Literal, NamedTuple

from pydantic import Field

from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.yaml_model import FileModel

TCP_PORT: Final = 8101

NOT_AVAILABLE: Final = 0x7FFF
"""The variable does not exist or is not enabled on this model."""

SENSOR_MISSING: Final = 0xC504
"""−151.00 °C: sensor missing or broken."""

TEMPERATURE_MIN_C: Final = -151.11
TEMPERATURE_MAX_C: Final = 500.0


class Address(IntEnum):
    """Variables used here; the device knows more."""

    SETPOINT = 0x00
    BATH = 0x01
    RETURN = 0x02
    PUMP_PRESSURE = 0x03
    POWER = 0x04
    ERROR = 0x05
    WARNING = 0x06
    PROCESS = 0x07
    STATUS = 0x0A
    LEVEL = 0x0F
    PID_AUTO = 0x12
    PROCESS_CONTROL = 0x13
    CONTROL = 0x14
    CIRCULATION = 0x16
    KEY_LOCK = 0x17
    SERIAL_1B = 0x1B
    SERIAL_1C = 0x1C
    PUMP_SPEED = 0x26
    SETPOINT_MIN = 0x30
    SETPOINT_MAX = 0x31
    PROCESS_3A = 0x3A
    PUMP_SPEED_SETPOINT = 0x48
    MAINTENANCE_DAYS = 0x5C


class Status(IntFlag):
    """Status word 1 (address 0A), bit 0 = least significant. Bits 13 and 14 are disputed: advisory only."""

    CONTROLLING = 1 << 0
    CIRCULATING = 1 << 1
    COMPRESSOR = 1 << 2
    PROCESS_CONTROL = 1 << 3
    PUMPING = 1 << 4
    COOLING_AVAILABLE = 1 << 5
    KEY_LOCK = 1 << 6
    PID_AUTO = 1 << 7
    ERROR = 1 << 8
    WARNING = 1 << 9
    SET_INTERNAL = 1 << 10
    SET_EXTERNAL = 1 << 11
    E_GRADE = 1 << 12
    BIT_13 = 1 << 13
    BIT_14 = 1 << 14


StatusBitOrder = Literal["lsb", "msb16", "msb15"]
"""Which end of the status word is bit 0; drivers in the field disagree. `lsb` is what real baths were read with."""

SerialWordOrder = Literal["1b_high", "1c_high"]
"""Which of the two serial number words is the high one; disputed."""


class PbWire(FileModel):
    """What sources disagree about, to be set to what the device at hand does; both sides of the wire use it."""

    status_bit_order: StatusBitOrder = Field(default="lsb", description="which end of status word 1 is bit 0")
    serial_word_order: SerialWordOrder = Field(
        default="1b_high", description="which serial number word is the high one"
    )
    pressure_mbar_per_count: float = Field(default=1.0, gt=0, description="1: whole mbar absolute; 0.01: as `huber`")
    process_address: Literal[0x07, 0x3A] = Field(default=0x07, description="of the process temperature: 7 or 58 (3A)")


class Request(NamedTuple):
    """What a host asks: read `address`, or write `word` (unsigned 16 bits) to it."""

    address: int
    word: int | None


class Reply(NamedTuple):
    """What the thermostat answers."""

    address: int
    word: int


_REPLY: Final = re.compile(rb"\{S([0-9A-Fa-f]{2})([0-9A-Fa-f]{4})\r\n")
_REQUEST: Final = re.compile(rb"\{M([0-9A-Fa-f]{2})([0-9A-Fa-f]{4}|\*{4})\Z")
_LONGEST_LINE: Final = 1024


def encode_request(address: int, word: int | None = None) -> bytes:
    """Ten bytes that read `address`, or write `word` to it.

    Raises:
        LocalProtocolError: address or word does not fit.
    """
    _require(address, word or 0)
    return b"{M%02X****\r\n" % address if word is None else b"{M%02X%04X\r\n" % (address, word)


def encode_reply(address: int, word: int) -> bytes:
    """Ten bytes that answer with the value of `address`.

    Raises:
        LocalProtocolError: address or word does not fit.
    """
    _require(address, word)
    return b"{S%02X%04X\r\n" % (address, word)


def _require(address: int, word: int) -> None:
    if not 0 <= address <= 0xFF or not 0 <= word <= 0xFFFF:
        raise LocalProtocolError(f"PB: address {address} or value {word} does not fit 8 and 16 bits")


def find_reply(received: bytes, address: int) -> int | None:
    """The value of `address` in what was received, whatever lies before it.

    Answers for other addresses are skipped: they belong to earlier requests.

    Returns:
        Unsigned 16-bit word, or None if there is no complete answer for that address.
    """
    for match in _REPLY.finditer(received):
        if int(match[1], 16) == address:
            return int(match[2], 16)
    return None


def take_requests(buffer: bytearray) -> list[Request]:
    """Remove complete lines from `buffer` and return the well-formed requests among them."""
    requests = []
    while (end := buffer.find(b"\r\n")) >= 0:
        match = _REQUEST.search(bytes(buffer[:end]))
        del buffer[: end + 2]
        if match is not None:
            word = None if match[2] == b"****" else int(match[2], 16)
            requests.append(Request(int(match[1], 16), word))
    if len(buffer) > _LONGEST_LINE:
        del buffer[:-_LONGEST_LINE]
    return requests


def encode_temperature(temperature_c: float) -> int:
    """Temperature as a word of 0.01 K, rounded (not truncated).

    Raises:
        LocalProtocolError: outside −151.11 … 500 °C, or a value that is coded as "not available" (327.67 °C)
            or "sensor missing" (−151.00 °C).
    """
    if not TEMPERATURE_MIN_C <= temperature_c <= TEMPERATURE_MAX_C:
        raise LocalProtocolError(
            f"PB: {temperature_c:.2f} °C is outside {TEMPERATURE_MIN_C} … {TEMPERATURE_MAX_C} °C"
        )
    word = round(temperature_c * 100.0) & 0xFFFF
    if word in (NOT_AVAILABLE, SENSOR_MISSING):
        raise LocalProtocolError(f"PB: {temperature_c:.2f} °C is coded as no value and cannot be sent")
    return word


def decode_temperature(word: int) -> float | None:
    """Degrees Celsius of a word of 0.01 K, or None where it says that there is no value."""
    if word in (NOT_AVAILABLE, SENSOR_MISSING):
        return None
    signed = to_signed(word)
    # below the range as signed means above 327.67 °C as unsigned
    return (word if signed < round(TEMPERATURE_MIN_C * 100.0) else signed) / 100.0


def to_signed(word: int) -> int:
    """Two's complement of 16 bits."""
    return word - 0x10000 if word & 0x8000 else word


def to_word(value: int) -> int:
    """Unsigned 16-bit word of a signed or unsigned number.

    Raises:
        LocalProtocolError: it does not fit.
    """
    if not -0x8000 <= value <= 0xFFFF:
        raise LocalProtocolError(f"PB: {value} does not fit 16 bits")
    return value & 0xFFFF


def decode_status(word: int, order: StatusBitOrder = "lsb") -> Status:
    """Status bits of the word at address 0A."""
    if order == "lsb":
        return Status(word & 0x7FFF)
    width = 16 if order == "msb16" else 15
    return Status(sum(1 << bit for bit in range(15) if word >> (width - 1 - bit) & 1))


def encode_status(status: Status, order: StatusBitOrder = "lsb") -> int:
    """Word at address 0A for status bits."""
    if order == "lsb":
        return int(status)
    width = 16 if order == "msb16" else 15
    return sum(1 << (width - 1 - bit) for bit in range(15) if status >> bit & 1)


def decode_serial(word_1b: int, word_1c: int, order: SerialWordOrder = "1b_high") -> int:
    """Serial number from the words at 1B and 1C."""
    return word_1b << 16 | word_1c if order == "1b_high" else word_1c << 16 | word_1b


def encode_serial(serial: int, order: SerialWordOrder = "1b_high") -> tuple[int, int]:
    """Words at 1B and 1C for a serial number."""
    high, low = serial >> 16 & 0xFFFF, serial & 0xFFFF
    return (high, low) if order == "1b_high" else (low, high)
