"""The drivers and emulators that come with the package, as `pyproject.toml` announces them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from arl_fixtures.bench.drivers import Driver, Emulation
from arl_fixtures.devices.chiller import HuberChiller, HuberSettings
from arl_fixtures.devices.dut import HflPorts, HflReceiver, HflSettings
from arl_fixtures.devices.port import Clock, DatagramPort
from arl_fixtures.devices.relays import ConradRelays, ConradSettings
from arl_fixtures.devices.stage import TmclSettings, TmclStage
from arl_fixtures.devices.thermometer import DconSettings, DconThermometer
from arl_fixtures.emulators.chiller import ChillerEmulator, ChillerEmulatorSettings
from arl_fixtures.emulators.device import DatagramDevice
from arl_fixtures.emulators.dut import DutEmulator, DutEmulatorSettings
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.emulators.relays import RelaysEmulator, RelaysEmulatorSettings
from arl_fixtures.emulators.stage import StageEmulator, StageEmulatorSettings
from arl_fixtures.emulators.thermometer import ThermometerEmulator, ThermometerEmulatorSettings
from arl_fixtures.reconcile.twin_model import FoundEffects

if TYPE_CHECKING:
    from arl_fixtures.bench.config import BenchConfig


def _receiver(ports: Mapping[str, DatagramPort], clock: Clock, config: BenchConfig) -> HflReceiver:
    sockets = HflPorts(frames=ports["frames"], telemetry=ports.get("telemetry"), operating=ports.get("operating"))
    senders = {dut.serial: dut.sender_address for dut in config.dut_settings}
    return HflReceiver(sockets, clock, senders, config.device_settings("duts"))


def _udp_ports(settings: HflSettings) -> Mapping[str, int]:
    return {
        "frames": settings.frame_port,
        "telemetry": settings.telemetry_port,
        "operating": settings.operating_port,
    }


HUBER_PB: Final = Driver(kind="chiller", settings=HuberSettings, make=HuberChiller)
DCON: Final = Driver(kind="thermometer", settings=DconSettings, make=DconThermometer)
TMCL: Final = Driver(kind="stage", settings=TmclSettings, make=TmclStage)
CONRAD: Final = Driver(kind="relays", settings=ConradSettings, make=ConradRelays, default_baud=19200)
HFL110: Final = Driver(kind="duts", settings=HflSettings, make=_receiver, udp_ports=_udp_ports)


def _chiller(plant: Plant, settings: ChillerEmulatorSettings, driver: HuberSettings) -> ChillerEmulator:
    return ChillerEmulator(plant, driver, settings)


def _thermometer(plant: Plant, settings: ThermometerEmulatorSettings, driver: DconSettings) -> ThermometerEmulator:
    return ThermometerEmulator(plant, driver, settings)


def _stage(plant: Plant, settings: StageEmulatorSettings, driver: TmclSettings) -> StageEmulator:
    return StageEmulator(plant, driver, settings)


def _relays(plant: Plant, settings: RelaysEmulatorSettings, driver: ConradSettings) -> RelaysEmulator:
    return RelaysEmulator(plant, driver.loads, settings)


def _duts(plant: Plant, config: BenchConfig, driver: HflSettings) -> tuple[DatagramDevice, ...]:
    settings: DutEmulatorSettings = config.emulator_settings("duts")
    model = config.effects_path
    return tuple(
        DutEmulator(
            plant,
            index,
            dut,
            config.scene,
            settings=settings,
            wire=driver,
            models=() if model is None else (FoundEffects(model, dut, config.scene),),
        )
        for index, dut in enumerate(config.dut_settings)
    )


HUBER_PB_EMULATOR: Final = Emulation(kind="chiller", settings=ChillerEmulatorSettings, make=_chiller)
DCON_EMULATOR: Final = Emulation(kind="thermometer", settings=ThermometerEmulatorSettings, make=_thermometer)
TMCL_EMULATOR: Final = Emulation(kind="stage", settings=StageEmulatorSettings, make=_stage)
CONRAD_EMULATOR: Final = Emulation(kind="relays", settings=RelaysEmulatorSettings, make=_relays)
HFL110_EMULATOR: Final = Emulation(kind="duts", settings=DutEmulatorSettings, make=_duts)
