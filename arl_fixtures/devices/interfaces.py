"""What the bench asks of each kind of device. A driver of any make implements one of these.

All methods return within a bounded bench time; they raise `DeviceTimeoutError` when the device stays silent,
`RemoteProtocolError` when it answers nonsense, `DeviceLostError` when its line is gone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from arl_fixtures.devices.idling import Idle, nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """Who a device says it is; empty where its protocol has no answer."""

    name: str
    firmware: str = ""
    serial: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChillerStatus:
    """State of the chiller as it reports it; None where it cannot tell.

    `circulating` is what it was told, `pumping` what its pump does. Codes are the device's own, 0 for none;
    pressure is absolute, about 1000 mbar with the pump at rest.
    """

    controlling: bool
    circulating: bool
    error_code: int
    warning_code: int
    level_percent: float | None
    pump_mbar: float | None
    pumping: bool = True
    pump_rpm: int | None = None


class Chiller(Protocol):
    """A thermostat that brings its coolant to a set-point."""

    def identify(self) -> Identity:
        """Name, firmware, serial number."""

    def set_setpoint_c(self, setpoint_c: float) -> float:
        """Command a set-point; returns the value the device took, which a clamp may have changed."""

    def setpoint_c(self) -> float:
        """The set-point as the device has it, °C."""

    def bath_c(self) -> float:
        """Coolant temperature in the bath, °C."""

    def status(self) -> ChillerStatus:
        """Alarms, pump, level."""

    def start(self) -> None:
        """Circulate and control."""

    def stop(self) -> None:
        """Stop controlling and circulating."""

    def clear_error(self) -> None:
        """Acknowledge a fault at the device."""

    def close(self) -> None:
        """Release the line."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One thermocouple: `value_c` is None when `fault` says why ("open", "over range", "under range")."""

    value_c: float | None
    fault: str = ""


class Thermometer(Protocol):
    """A logger with several thermocouples."""

    def identify(self) -> Identity:
        """Name, firmware, serial number."""

    def read_c(self) -> tuple[Reading, ...]:
        """All channels in order."""

    def close(self) -> None:
        """Release the line."""


class Stage(Protocol):
    """A rotary stage; angles in degrees, clockwise positive seen from above."""

    def identify(self) -> Identity:
        """Name, firmware, serial number."""

    def home(self, timeout_s: float, idle: Idle = nothing) -> None:
        """Search the reference; afterwards positions are absolute. Takes `Breaks` with `idle`."""

    def move_to_deg(self, angle_deg: float) -> None:
        """Start to move; returns at once."""

    def wait_until_reached(self, timeout_s: float, idle: Idle = nothing) -> float:
        """Wait for the end of the motion; raises when it ended at a limit switch, stalled or never ended.

        Takes `Breaks` with `idle`.

        Returns:
            Bench time since which it surely stands; frames whose exposure began later count.
        """

    def position_deg(self) -> float:
        """Where the stage is."""

    def moving(self) -> bool:
        """Whether it turns."""

    def stop(self) -> None:
        """Stop at once."""

    def fault(self) -> str:
        """What is wrong with it, in words; empty when nothing is."""

    def close(self) -> None:
        """Release the line."""


class Relays(Protocol):
    """Switched supplies, by the name of the load."""

    def identify(self) -> Identity:
        """Name, firmware, serial number."""

    def loads(self) -> Sequence[str]:
        """Names of the loads in channel order."""

    def set(self, load: str, on: bool) -> None:
        """Switch a load and verify it by read-back."""

    def states(self) -> Mapping[str, bool]:
        """State of every load, read back from the board."""

    def all_off(self) -> None:
        """Switch every load off and verify it by read-back."""

    def close(self) -> None:
        """Release the line."""
