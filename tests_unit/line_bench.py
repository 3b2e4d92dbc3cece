"""The four emulated control lines with their drivers on a virtual clock, for tests."""

from __future__ import annotations

from typing import Any

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.links import Detachable, VirtualStreamPort
from arl_fixtures.devices.chiller import HuberChiller, HuberSettings
from arl_fixtures.devices.relays import ConradRelays, ConradSettings
from arl_fixtures.devices.stage import TmclSettings, TmclStage
from arl_fixtures.devices.thermometer import DconSettings, DconThermometer
from arl_fixtures.emulators.chiller import ChillerEmulator, ChillerEmulatorSettings
from arl_fixtures.emulators.device import Outgoing, StreamDevice
from arl_fixtures.emulators.faults import Fault, FaultBook
from arl_fixtures.emulators.faulty_wire import FaultyWire
from arl_fixtures.emulators.plant import Plant, PlantSettings
from arl_fixtures.emulators.relays import RelaysEmulator, RelaysEmulatorSettings
from arl_fixtures.emulators.stage import StageEmulator, StageEmulatorSettings
from arl_fixtures.emulators.thermometer import ThermometerEmulator, ThermometerEmulatorSettings
from arl_fixtures.errors import DeviceLostError


class SerialPort:
    """A line on which opening again forgets nothing, as on RS-232: what the device sends still arrives."""

    def __init__(self, name: str, device: StreamDevice, clock: VirtualClock) -> None:
        self.name = name
        self._device, self._clock = device, clock
        self._unread = bytearray()

    def write(self, data: bytes) -> None:
        self._require_line()
        for time_s, answer in self._device.receive(data, self._clock.now_s):
            self._clock.at(time_s, lambda answer=answer: self._unread.extend(answer))

    def read(self, timeout_s: float) -> bytes:
        self._require_line()
        self._clock.wait(lambda: bool(self._unread), timeout_s)
        self._require_line()
        return self.drain()

    def drain(self) -> bytes:
        data = bytes(self._unread)
        self._unread.clear()
        return data

    def reopen(self) -> None:
        self._require_line()

    def close(self) -> None:
        self._device.disconnect(self._clock.now_s)

    def _require_line(self) -> None:
        if isinstance(self._device, Detachable) and not self._device.is_connected(self._clock.now_s):
            raise DeviceLostError(f"{self.name}: the line is cut")


class LineBench:
    """Plant, clock, and one driver for each emulator; settings by keyword."""

    def __init__(
        self,
        *faults: Fault,
        seed: int = 0,
        plant: dict[str, Any] | None = None,
        chiller: dict[str, Any] | None = None,
        thermometer: dict[str, Any] | None = None,
        stage: dict[str, Any] | None = None,
        relays: dict[str, Any] | None = None,
        chiller_emulator: dict[str, Any] | None = None,
        thermometer_emulator: dict[str, Any] | None = None,
        stage_emulator: dict[str, Any] | None = None,
        relays_emulator: dict[str, Any] | None = None,
    ) -> None:
        self.clock = VirtualClock()
        self.plant = Plant(PlantSettings(seed=seed, **(plant or {})), faults=FaultBook(list(faults)))
        huber = HuberSettings(**(chiller or {}))
        dcon = DconSettings(**(thermometer or {}))
        tmcl = TmclSettings(**(stage or {}))
        conrad = ConradSettings(**(relays or {}))
        self.emulators: dict[str, Any] = {
            "chiller": ChillerEmulator(self.plant, huber, ChillerEmulatorSettings(**(chiller_emulator or {}))),
            "thermometer": ThermometerEmulator(
                self.plant, dcon, ThermometerEmulatorSettings(**(thermometer_emulator or {}))
            ),
            "stage": StageEmulator(self.plant, tmcl, StageEmulatorSettings(**(stage_emulator or {}))),
            "relays": RelaysEmulator(self.plant, conrad.loads, RelaysEmulatorSettings(**(relays_emulator or {}))),
        }
        self.wires = {name: FaultyWire(name, device, self.plant) for name, device in self.emulators.items()}
        self.ports = {
            name: (VirtualStreamPort if name == "chiller" else SerialPort)(f"emulated {name}", wire, self.clock)
            for name, wire in self.wires.items()
        }
        self.chiller = HuberChiller(self.ports["chiller"], self.clock, huber)
        self.thermometer = DconThermometer(self.ports["thermometer"], self.clock, dcon)
        self.stage = TmclStage(self.ports["stage"], self.clock, tmcl)
        self.relays = ConradRelays(self.ports["relays"], self.clock, conrad)

    def inject(self, device: str, kind: str, **more: Any) -> None:
        """A fault that begins now, unless `start_s` says otherwise."""
        self.plant.faults.inject(Fault(device=device, kind=kind, **({"start_s": self.clock.now_s} | more)))

    def clear(self) -> None:
        """End all faults."""
        self.plant.faults.clear()


class Scripted:
    """A device that answers its n-th message with the n-th line of a script, delays in seconds."""

    def __init__(self, *script: list[tuple[float, bytes]]) -> None:
        self.heard: list[bytes] = []
        self._script = list(script)

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        self.heard.append(data)
        answers = self._script.pop(0) if self._script else []
        return [Outgoing(now_s + delay_s, answer) for delay_s, answer in answers]

    def disconnect(self, now_s: float) -> None:
        return None


def ask_raw(device: StreamDevice, data: bytes, now_s: float = 0.0) -> bytes:
    """Everything a device answers to `data`."""
    return b"".join(outgoing.data for outgoing in device.receive(data, now_s))
