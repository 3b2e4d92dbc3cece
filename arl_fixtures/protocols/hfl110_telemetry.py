"""HFL110 telemetry packet: 67 bytes, no header, mixed byte order, the serial number written backwards."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.protocols.hfl110 import Hfl110Wire

LENGTH: Final = 67
SERIAL_BYTES: Final = 26
_BIG: Final = struct.Struct(">I")
_TEMPERATURES: Final = struct.Struct("<2f")
_ANALOGUE: Final = struct.Struct("<6f")


@dataclass(frozen=True, slots=True, kw_only=True)
class Telemetry:
    """One telemetry packet. Units are those the vendor's names suggest; none is documented.

    `heater_temperature_c` is the physical value; the wire carries it with the sign of `Hfl110Wire.heater_sign`.
    """

    serial: str
    hardware_revision: int = 0
    sensor_temperature_c: float = 0.0
    heater_temperature_c: float = 0.0
    frame_counter: int = 0
    battery_switched_v: float = 0.0
    battery_v: float = 0.0
    heater_lens: float = 0.0
    heater_lens_high: float = 0.0
    lens: float = 0.0
    acquisition_period_ms: float = 40.0
    feedback: int = 0


def encode_telemetry(telemetry: Telemetry, wire: Hfl110Wire) -> bytes:
    """The packet.

    Raises:
        LocalProtocolError: the serial number does not fit.
    """
    serial = telemetry.serial.encode("ascii", "replace")
    if len(serial) > SERIAL_BYTES:
        raise LocalProtocolError(f"HFL110 serial number '{telemetry.serial}' is longer than {SERIAL_BYTES} bytes")
    return b"".join(
        (
            _BIG.pack(telemetry.hardware_revision),
            _TEMPERATURES.pack(telemetry.sensor_temperature_c, wire.heater_sign * telemetry.heater_temperature_c),
            _BIG.pack(telemetry.frame_counter % 2**32),
            _ANALOGUE.pack(
                telemetry.battery_switched_v,
                telemetry.battery_v,
                telemetry.heater_lens,
                telemetry.heater_lens_high,
                telemetry.lens,
                telemetry.acquisition_period_ms,
            ),
            bytes([telemetry.feedback]),
            serial.ljust(SERIAL_BYTES, b"\0")[::-1],
        )
    )


def decode_telemetry(payload: bytes, wire: Hfl110Wire) -> Telemetry:
    r"""Read a packet. Bytes of the serial number that are no printable ASCII appear as \xNN.

    Raises:
        RemoteProtocolError: wrong length.
    """
    if len(payload) != LENGTH:
        raise RemoteProtocolError(f"HFL110 telemetry packet of {len(payload)} bytes; expected {LENGTH}")
    sensor_c, heater_c = _TEMPERATURES.unpack_from(payload, 4)
    switched, battery, heater_lens, heater_lens_high, lens, period = _ANALOGUE.unpack_from(payload, 16)
    return Telemetry(
        serial=_printable(payload[41:][::-1].rstrip(b"\0")),
        hardware_revision=_BIG.unpack_from(payload, 0)[0],
        sensor_temperature_c=sensor_c,
        heater_temperature_c=wire.heater_sign * heater_c,
        frame_counter=_BIG.unpack_from(payload, 12)[0],
        battery_switched_v=switched,
        battery_v=battery,
        heater_lens=heater_lens,
        heater_lens_high=heater_lens_high,
        lens=lens,
        acquisition_period_ms=period,
        feedback=payload[40],
    )


def _printable(raw: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else f"\\x{byte:02x}" for byte in raw)
