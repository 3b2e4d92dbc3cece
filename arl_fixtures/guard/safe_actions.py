"""The three safe actions, each with its read-back. Whoever carries them out brings the devices and the patience."""

from __future__ import annotations

from typing import Final

from arl_fixtures.devices.interfaces import Chiller, Relays, Stage
from arl_fixtures.errors import DeviceError, RemoteProtocolError
from arl_fixtures.guard.core import SafeStep

SETPOINT_TOLERANCE_K: Final = 0.1


def carry_out(step: SafeStep, *, relays: Relays, chiller: Chiller, stage: Stage, safe_temperature_c: float) -> None:
    """One safe action, verified by what the device itself says afterwards.

    Raises:
        DeviceError: the device did not answer, or says something else than what it was told.
    """
    match step:
        case SafeStep.POWER_OFF:
            _power_off(relays)
        case SafeStep.SETPOINT:
            _command_setpoint(chiller, safe_temperature_c)
        case SafeStep.STAGE_STOP:
            _stop(stage)


def _power_off(relays: Relays) -> None:
    relays.all_off()
    on = [load for load, closed in relays.states().items() if closed]
    if on:
        raise DeviceError(f"still on: {', '.join(on)}")


def _command_setpoint(chiller: Chiller, safe_temperature_c: float) -> None:
    chiller.set_setpoint_c(safe_temperature_c)
    held_c = chiller.setpoint_c()
    if abs(held_c - safe_temperature_c) > SETPOINT_TOLERANCE_K:
        raise RemoteProtocolError(f"the chiller holds {held_c:g} °C instead of {safe_temperature_c:g} °C")


def _stop(stage: Stage) -> None:
    stage.stop()
    if stage.moving():
        raise DeviceError("the stage still turns after stop")
