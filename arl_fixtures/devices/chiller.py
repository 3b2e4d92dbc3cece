"""Huber thermostat by PB commands, on TCP or a serial line.

The connection is opened again after a time-out: a late answer for the same variable would otherwise be read as the
current value (it is what other drivers do). On a serial line a variable that nobody else waits for is read first.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, final

from pydantic import Field

from arl_fixtures.devices.exchange import Exchange, ExchangeSettings, Question
from arl_fixtures.devices.interfaces import ChillerStatus, Identity
from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.errors import DeviceError
from arl_fixtures.protocols import huber_pb as pb
from arl_fixtures.protocols.huber_pb import Address, PbWire, Status

_FENCES: Final = (
    Address.STATUS,
    Address.LEVEL,
    Address.PUMP_SPEED,
    Address.PUMP_PRESSURE,
    Address.SETPOINT_MIN,
    Address.SETPOINT_MAX,
    Address.POWER,
)


class HuberSettings(PbWire):
    """Patience with a Huber thermostat; times on the bench clock."""

    timeout_s: float = Field(default=0.5, gt=0, description="for one answer")
    retries: int = Field(default=1, ge=0, description="how often a question is asked again")
    gap_s: float = Field(default=0.0, ge=0, description="pause between commands; Petite Fleur: 1")
    pause_after_start_s: float = Field(default=0.0, ge=0, description="after control on; Petite Fleur: 10")
    pause_after_circulation_s: float = Field(default=0.0, ge=0, description="after pump on; Petite Fleur: 5")
    reopen_after_timeout: bool = Field(default=True, description="false on a serial line")
    quiet_s: float = Field(default=3.0, ge=0, description="no answer is later than this (serial line only)")


@final
class HuberChiller:
    """Driver for a Huber thermostat with PB commands.

    Args:
        port: the line.
        clock: the bench clock.
        settings: dialect and patience.
    """

    def __init__(self, port: StreamPort, clock: Clock, settings: HuberSettings | None = None) -> None:
        self._settings = settings = settings or HuberSettings()
        self._clock = clock
        patience = ExchangeSettings(
            timeout_s=settings.timeout_s,
            retries=settings.retries,
            gap_s=settings.gap_s,
            quiet_s=settings.quiet_s,
            reopening_forgets=settings.reopen_after_timeout,
        )
        self._reads = {address: _question(address, None) for address in Address}
        self._exchange = Exchange("chiller", port, clock, patience, fences=self._fences)

    def identify(self) -> Identity:
        """Serial number; PB as far as known has no variable for model and firmware."""
        first, second = self._read(Address.SERIAL_1B), self._read(Address.SERIAL_1C)
        if pb.NOT_AVAILABLE in (first, second):
            return Identity(name="Huber thermostat")
        serial = pb.decode_serial(first, second, self._settings.serial_word_order)
        return Identity(name="Huber thermostat", serial=str(serial))

    def set_setpoint_c(self, setpoint_c: float) -> float:
        """Write the set-point; returns what the device took, °C."""
        word = self._exchange.ask(_question(Address.SETPOINT, pb.encode_temperature(setpoint_c)))
        return self._temperature(Address.SETPOINT, word)

    def setpoint_c(self) -> float:
        """Set-point in the device, °C."""
        return self._temperature(Address.SETPOINT, self._read(Address.SETPOINT))

    def setpoint_limits_c(self) -> tuple[float, float]:
        """Lowest and highest set-point that the device takes, °C (two exchanges)."""
        low, high = Address.SETPOINT_MIN, Address.SETPOINT_MAX
        return self._temperature(low, self._read(low)), self._temperature(high, self._read(high))

    def bath_c(self) -> float:
        """Coolant temperature in the bath, °C.

        Raises:
            DeviceError: the device has no value, as its sensor is missing or broken.
        """
        return self._temperature(Address.BATH, self._read(Address.BATH))

    def process_c(self) -> float | None:
        """Temperature of the external sensor, °C; None without one."""
        return pb.decode_temperature(self._read(Address(self._settings.process_address)))

    def status(self) -> ChillerStatus:
        """Alarms, pump, level (six exchanges)."""
        bits = pb.decode_status(self._read(Address.STATUS), self._settings.status_bit_order)
        level = self._optional(Address.LEVEL)
        pressure = self._optional(Address.PUMP_PRESSURE)
        return ChillerStatus(
            controlling=Status.CONTROLLING in bits,
            circulating=Status.CIRCULATING in bits,
            pumping=Status.PUMPING in bits,
            error_code=self._code(Address.ERROR),
            warning_code=self._code(Address.WARNING),
            level_percent=None if level is None else level / 10.0,
            pump_mbar=None if pressure is None else pressure * self._settings.pressure_mbar_per_count,
            pump_rpm=self._optional(Address.PUMP_SPEED),
        )

    def start(self) -> None:
        """Pump on, then temperature control on.

        Raises:
            DeviceError: the device did not take it, as with an alarm pending.
        """
        self._switch(Address.CIRCULATION, True, "circulation")
        self._clock.sleep(self._settings.pause_after_circulation_s)
        self._switch(Address.CONTROL, True, "temperature control")
        self._clock.sleep(self._settings.pause_after_start_s)

    def stop(self) -> None:
        """Temperature control off, then pump off."""
        self._switch(Address.CONTROL, False, "temperature control")
        self._switch(Address.CIRCULATION, False, "circulation")

    def clear_error(self) -> None:
        """Acknowledge error and warning."""
        for address in (Address.ERROR, Address.WARNING):
            self._exchange.ask(_question(address, 1))

    def close(self) -> None:
        """Release the connection."""
        self._exchange.close()

    def _read(self, address: Address) -> int:
        return self._exchange.ask(self._reads[address])

    def _temperature(self, address: Address, word: int) -> float:
        value_c = pb.decode_temperature(word)
        if value_c is None:
            why = "not available on this model" if word == pb.NOT_AVAILABLE else "sensor missing or broken"
            raise DeviceError(f"{self._exchange.place}: no value of '{_name(address)}': {why}")
        return value_c

    def _optional(self, address: Address) -> int | None:
        word = self._read(address)
        return None if word == pb.NOT_AVAILABLE else word

    def _code(self, address: Address) -> int:
        word = self._optional(address)
        # codes are negative, 0 is none
        return 0 if word is None else min(pb.to_signed(word), 0)

    def _switch(self, address: Address, on: bool, what: str) -> None:
        taken = self._exchange.ask(_question(address, int(on)))
        if taken != int(on):
            raise DeviceError(f"{self._exchange.place}: {what} stays {'off' if on else 'on'}")

    def _fences(self) -> Iterator[Question[object]]:
        return (_question(address, None) for address in _FENCES)


def _question(address: int, word: int | None) -> Question[int]:
    what = f"{'read' if word is None else 'write'} {_name(address)}"
    return Question(
        what, address, pb.encode_request(address, word), lambda received: pb.find_reply(received, address)
    )


def _name(address: int) -> str:
    return Address(address).name.lower().replace("_", " ")
