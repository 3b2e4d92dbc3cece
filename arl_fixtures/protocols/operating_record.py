"""Operating data that the sensor's own telemetry lacks, as a UDP record of ours.

A stand-in for a measurement link to the DUT's control unit, to be replaced by a driver for the real one. All
numbers are big-endian:

| offset | type | field |
| --- | --- | --- |
| 0 | 4 bytes | `ARLO` |
| 4 | u16 | version, 1 |
| 6 | 26 bytes | serial number, ASCII, padded with NUL |
| 32 | u32 | frame counter |
| 36 | u64 | time stamp, µs since the DUT started |
| 44 | u16 | n, number of signals |
| 46 | n × (u16, f32) | signal number and value in the unit of its name |
| 46 + 6 n | u32 | CRC-32 (zlib) of all bytes before |
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError

MAGIC: Final = b"ARLO"
VERSION: Final = 1
SERIAL_BYTES: Final = 26
_HEAD: Final = struct.Struct(f">4sH{SERIAL_BYTES}sIQH")
_CHECK: Final = struct.Struct(">I")

SIGNALS: Final[Mapping[int, str]] = {
    1: "fpga_temperature_c",
    2: "tof_temperature_c",
    3: "laser_temperature_c",
    16: "tec_current_a",
    17: "tec_voltage_p_v",
    18: "tec_voltage_n_v",
    32: "laser_current_a",
    33: "laser_voltage_v",
    34: "pump_time_us",
    64: "rail_1v0_v",
    65: "rail_1v8_v",
    66: "rail_3v3_v",
    67: "rail_5v0_v",
    68: "rail_12v0_v",
    69: "rail_1v1_v",
    70: "rail_1v2_v",
    71: "rail_1v35_v",
    72: "rail_1v5_v",
    73: "rail_2v5_v",
    74: "rail_24v0_v",
}
"""Signal numbers. They are part of the format: never reuse one; a reader shows those it does not know as signal_N."""
NUMBERS: Final[Mapping[str, int]] = {name: number for number, name in SIGNALS.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingRecord:
    """One record: values by signal name with unit suffix."""

    serial: str
    frame_counter: int
    timestamp_us: int
    values: Mapping[str, float]


def encode_record(record: OperatingRecord) -> bytes:
    """The record's bytes.

    Raises:
        LocalProtocolError: a signal has no number, or the serial number does not fit.
    """
    serial = record.serial.encode("ascii", "replace")
    if len(serial) > SERIAL_BYTES:
        raise LocalProtocolError(f"operating record: serial '{record.serial}' is longer than {SERIAL_BYTES} bytes")
    flat: list[float] = []
    for name, value in record.values.items():
        flat += (_number(name), value)
    count = len(record.values)
    head = _HEAD.pack(MAGIC, VERSION, serial, record.frame_counter % 2**32, record.timestamp_us % 2**64, count)
    body = head + struct.pack(">" + "Hf" * count, *flat)
    return body + _CHECK.pack(zlib.crc32(body))


def decode_record(payload: bytes) -> OperatingRecord:
    """Read a record.

    Raises:
        RemoteProtocolError: magic, version, length or check sum is wrong.
    """
    if len(payload) < _HEAD.size + _CHECK.size or payload[:4] != MAGIC:
        raise RemoteProtocolError(f"operating record of {len(payload)} bytes does not begin with 'ARLO' and a header")
    _, version, serial, frame_counter, timestamp_us, count = _HEAD.unpack_from(payload)
    if version != VERSION:
        raise RemoteProtocolError(f"operating record of version {version}; expected {VERSION}")
    length = _HEAD.size + 6 * count + _CHECK.size
    if len(payload) != length:
        raise RemoteProtocolError(f"operating record of {len(payload)} bytes; {count} signals make {length}")
    if _CHECK.unpack_from(payload, length - _CHECK.size)[0] != zlib.crc32(payload[: -_CHECK.size]):
        raise RemoteProtocolError("operating record with a wrong check sum")
    flat = struct.unpack_from(">" + "Hf" * count, payload, _HEAD.size)
    return OperatingRecord(
        serial=serial.rstrip(b"\0").decode("ascii", "backslashreplace"),
        frame_counter=frame_counter,
        timestamp_us=timestamp_us,
        values={
            SIGNALS.get(number, f"signal_{number}"): value
            for number, value in zip(flat[::2], flat[1::2], strict=True)
        },
    )


def _number(name: str) -> int:
    number = NUMBERS.get(name)
    if number is None and name.startswith("signal_") and name[7:].isdigit() and int(name[7:]) < 65536:
        number = int(name[7:])
    if number is None:
        raise LocalProtocolError(f"operating record: signal '{name}' has no number; see SIGNALS")
    return number
