"""From a bench file to an opened bench: clock, ports, drivers, and the emulators where a device is emulated."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any, Protocol, final, runtime_checkable

from arl_fixtures.bench.bench import Bench, Duts
from arl_fixtures.bench.clock import RealClock, VirtualClock
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.drivers import Kind, find_driver, find_emulation
from arl_fixtures.bench.links import VirtualDatagramPort, VirtualNetwork, VirtualStreamPort
from arl_fixtures.bench.ports import UdpPort, open_stream
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.devices.interfaces import Chiller, Relays, Stage, Thermometer
from arl_fixtures.devices.port import Clock, DatagramPort, StreamPort
from arl_fixtures.emulators.device import DatagramDevice
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault, FaultBook
from arl_fixtures.emulators.faulty_wire import FaultyWire
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.errors import ArlError, ConfigError, DeviceError


@runtime_checkable
class Ageing(Protocol):
    """An emulated DUT that changes with the cycle count."""

    def enter_cycle(self, cycle: int, start_s: float) -> None:
        """The unit has done `cycle` cycles."""

    def enter_step(self, step: int, *, set_temperature_c: float, ramp: int) -> None:
        """The temperature step that begins."""


class Lines(Protocol):
    """Who owns clock and ports: the emulated bench of this process, a lab, or a guard."""

    @property
    def clock(self) -> Clock:
        """The bench clock."""

    def port(self, kind: Kind) -> StreamPort:
        """A port to one of the control lines."""

    def datagrams(self, port: int) -> DatagramPort:
        """What is sent to a UDP port."""

    def enter_step(self, step: CycleStep) -> None:
        """A temperature step begins; emulated DUTs must know, hardware does by itself."""


CONTROL_LINES: tuple[Kind, ...] = ("chiller", "thermometer", "stage", "relays")


@final
class Emulated:
    """The other side of an emulated bench: plant, emulators and virtual network on one clock.

    Args:
        config: the bench file.
        clock: the virtual clock they live on.
    """

    def __init__(self, config: BenchConfig, clock: VirtualClock) -> None:
        self.clock = clock
        self.plant = Plant(
            config.emulation.plant, faults=FaultBook(config.emulation.faults), start_s=clock.now_s
        )
        self.duts: tuple[DatagramDevice, ...] = make_duts(config, self.plant)
        self.network = VirtualNetwork(self.duts, clock)
        self._lines = {kind: make_line(config, kind, self.plant) for kind in CONTROL_LINES}
        self._cycle = -1
        self.plant.attach("bench", self._on_fault)

    def port(self, kind: Kind) -> VirtualStreamPort:
        """A port to one of the control lines."""
        return VirtualStreamPort(f"emulated {kind}", self._lines[kind], self.clock)

    def datagrams(self, port: int) -> VirtualDatagramPort:
        """What is sent to a UDP port."""
        return self.network.listen(port)

    def enter_step(self, step: CycleStep) -> None:
        """Tell the DUTs how old they are and where in the cycle they stand."""
        for dut in self.duts:
            if isinstance(dut, Ageing):
                if step.cycle != self._cycle:
                    dut.enter_cycle(step.cycle, self.clock.now_s)
                dut.enter_step(step.index, set_temperature_c=step.set_temperature_c, ramp=step.ramp)
        self._cycle = step.cycle

    def _on_fault(self, fault: Fault, begins: bool, _time_s: float) -> None:
        """The host's wall clock is set, and set right again when the fault is over."""
        if fault.kind is FaultKind.CLOCK_JUMP and fault.device == "bench":
            self.clock.jump_host(fault.amount if begins else -fault.amount)


def make_line(config: BenchConfig, kind: Kind, plant: Plant) -> FaultyWire:
    """The emulator of one control line, on a wire that faults can act on."""
    emulation = find_emulation(config.devices()[kind].driver, kind)
    device = emulation.make(plant, config.emulator_settings(kind), config.device_settings(kind))
    return FaultyWire(kind, device, plant)


def make_duts(config: BenchConfig, plant: Plant) -> tuple[DatagramDevice, ...]:
    """The emulated DUTs, top to bottom."""
    emulation = find_emulation(config.duts.driver, "duts")
    made: tuple[DatagramDevice, ...] = emulation.make(plant, config, config.device_settings("duts"))
    return made


@final
class Opened:
    """Devices of a bench, each opened when it is first asked for; a device that cannot be opened says why each time.

    Args:
        config: the bench file.
        lines: whoever owns clock and ports (a lab, a guard); by default they are opened here.
        start_s: bench time at which a virtual clock begins.
    """

    def __init__(self, config: BenchConfig, lines: Lines | None = None, *, start_s: float = 0.0) -> None:
        self.config = config
        self.clock: Clock
        self._lines = lines
        entries = config.devices()
        if self._lines is not None:
            self.clock = self._lines.clock
        elif config.clock == "virtual":
            self._lines = Emulated(config, VirtualClock(start_s=start_s))
            self.clock = self._lines.clock
        else:
            emulated = [kind for kind, entry in entries.items() if entry.emulated]
            if emulated:
                raise ConfigError(
                    f"bench '{config.name}': {emulated[0]} is emulated but the clock is real; "
                    "run `arl emulate --bench THIS --write-bench RUN.yaml` and use RUN.yaml, or set clock: virtual"
                )
            self.clock = RealClock()
        self._made: dict[Kind, Any] = {}

    def device(self, kind: Kind) -> Any:  # noqa: ANN401 - each role has its own interface
        """The device in a role.

        Raises:
            DeviceError: it cannot be opened.
        """
        if kind not in self._made:
            self._made[kind] = self._open(kind)
        return self._made[kind]

    @property
    def chiller(self) -> Chiller:
        """The chiller."""
        found: Chiller = self.device("chiller")
        return found

    @property
    def thermometer(self) -> Thermometer:
        """The thermocouple logger."""
        found: Thermometer = self.device("thermometer")
        return found

    @property
    def stage(self) -> Stage:
        """The rotary stage."""
        found: Stage = self.device("stage")
        return found

    @property
    def relays(self) -> Relays:
        """The relays."""
        found: Relays = self.device("relays")
        return found

    @property
    def duts(self) -> Duts:
        """The DUTs' receiver."""
        found: Duts = self.device("duts")
        return found

    def enter_step(self, step: CycleStep) -> None:
        """Tell emulated DUTs how old they are and where in the cycle they stand; hardware knows by itself."""
        if self._lines is not None:
            self._lines.enter_step(step)

    def close(self) -> None:
        """Release everything that was opened."""
        for device in reversed(list(self._made.values())):
            with contextlib.suppress(DeviceError):
                device.close()
        self._made.clear()

    def _open(self, kind: Kind) -> object:
        entry = self.config.devices()[kind]
        driver = find_driver(entry.driver, kind)
        settings = self.config.device_settings(kind)
        if kind == "duts":
            return driver.make(self._dut_ports(driver.udp_ports(settings)), self.clock, self.config)
        port: StreamPort
        if self._lines is not None:
            port = self._lines.port(kind)
        else:
            port = open_stream(entry.url, default_baud=driver.default_baud)
        try:
            return driver.make(port, self.clock, settings)
        except ArlError:
            port.close()
            raise

    def _dut_ports(self, numbers: Mapping[str, int]) -> Mapping[str, DatagramPort]:
        if self._lines is not None:
            return {name: self._lines.datagrams(number) for name, number in numbers.items()}
        host = self.config.duts.listen
        opened: dict[str, UdpPort] = {}
        try:
            for name, number in numbers.items():
                opened[name] = UdpPort(f"udp://{host}:{number}", host, number, self.clock)
        except ArlError:
            for port in opened.values():
                port.close()
            raise
        return opened


@contextlib.contextmanager
def open_devices(config: BenchConfig) -> Iterator[Opened]:
    """Devices of a bench for a look at them; released at the end, nothing is switched."""
    opened = Opened(config)
    try:
        yield opened
    finally:
        opened.close()


def open_bench(config: BenchConfig, lines: Lines | None = None, *, start_s: float = 0.0) -> Bench:
    """Open every device of a bench.

    Args:
        config: the bench file.
        lines: whoever owns clock and ports; by default they are opened here.

    Raises:
        DeviceError: some cannot be opened; the message names each, one a line.
    """
    opened = Opened(config, lines, start_s=start_s)
    faults = []
    for kind in config.devices():
        try:
            opened.device(kind)
        except DeviceError as error:
            faults.append(f"{kind}: {error}")
    if faults:
        opened.close()
        raise DeviceError("\n".join(faults))
    return Bench(
        config,
        opened.clock,
        chiller=opened.chiller,
        thermometer=opened.thermometer,
        stage=opened.stage,
        relays=opened.relays,
        duts=opened.duts,
        on_step=opened.enter_step,
    )
