"""Look at every device of a bench without moving, heating or powering anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from arl_fixtures.bench.build import Opened, open_devices
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.devices.interfaces import Identity
from arl_fixtures.errors import ArlError

LISTEN_S: Final = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What was found out about one device; `fault` is empty when nothing is wrong."""

    device: str
    driver: str
    url: str
    identity: str = ""
    reading: str = ""
    fault: str = ""


def examine(config: BenchConfig) -> list[Finding]:
    """Open, ask and close each device; a fault of one does not keep the others from being asked."""
    findings = []
    with open_devices(config) as opened:
        for kind, entry in config.devices().items():
            identity = reading = fault = ""
            try:
                device = opened.device(kind)
                identity = _describe(device.identify())
                reading, fault = _READERS[kind](opened)
            except ArlError as error:
                fault = str(error)
            findings.append(
                Finding(
                    device=kind, driver=entry.driver, url=entry.url, identity=identity, reading=reading, fault=fault
                )
            )
    return findings


def _describe(identity: Identity) -> str:
    parts = [identity.name]
    if identity.firmware:
        parts.append(f"firmware {identity.firmware}")
    if identity.serial:
        parts.append(f"serial {identity.serial}")
    return ", ".join(parts)


def _chiller(opened: Opened) -> tuple[str, str]:
    chiller = opened.chiller
    status = chiller.status()
    faults = []
    if status.error_code:
        faults.append(f"error {status.error_code}")
    if status.warning_code:
        faults.append(f"warning {status.warning_code}")
    level = "" if status.level_percent is None else f", level {status.level_percent:.0f} %"
    return f"bath {chiller.bath_c():.2f} °C, set-point {chiller.setpoint_c():.2f} °C{level}", ", ".join(faults)


def _thermometer(opened: Opened) -> tuple[str, str]:
    readings = opened.thermometer.read_c()
    named = opened.config.thermometer.named_channels()
    shown, faults = [], []
    for name, channel in named.items():
        if channel >= len(readings):
            faults.append(f"{name}: the logger has no channel {channel}")
        elif (value := readings[channel].value_c) is None:
            faults.append(f"{name}: {readings[channel].fault}")
        else:
            shown.append(f"{name} {value:.1f} °C")
    return ", ".join(shown), "; ".join(faults)


def _stage(opened: Opened) -> tuple[str, str]:
    return f"at {opened.stage.position_deg():.3f}°", opened.stage.fault()


def _relays(opened: Opened) -> tuple[str, str]:
    states = opened.relays.states()
    return ", ".join(f"{load} {'on' if on else 'off'}" for load, on in states.items()), ""


def _duts(opened: Opened) -> tuple[str, str]:
    config = opened.config
    known = ", ".join(f"{dut.serial} from {dut.sender_address}" for dut in config.dut_settings)
    powered = any(on for load, on in opened.relays.states().items() if load.startswith("dut"))
    if not powered:
        return f"{known}; not powered, so not heard", ""
    heard = opened.duts.listen(LISTEN_S)
    complaints = [f"{serial}: {status.complaint}" for serial, status in heard.items() if status.complaint]
    return f"{known}; {len(heard) - len(complaints)} heard", "; ".join(complaints)


_READERS: dict[str, Callable[[Opened], tuple[str, str]]] = {
    "chiller": _chiller,
    "thermometer": _thermometer,
    "stage": _stage,
    "relays": _relays,
    "duts": _duts,
}
