"""The bench file: which devices, where they are, and how the bench is run.

Errors carry file, line and column; unknown or duplicate keys are refused. The `settings` block of a device is
checked against the model of its driver, the `emulator` block against that of its emulator.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import date, datetime
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from arl_fixtures.bench.control import ControlSettings
from arl_fixtures.bench.drivers import Kind, find_driver, find_emulation
from arl_fixtures.bench.guard_settings import GuardSettings
from arl_fixtures.bench.settle import SettleSettings
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.plant import PlantSettings
from arl_fixtures.errors import ConfigError
from arl_fixtures.metrics.instruments import ACCEPT_EXPIRED, CALIBRATION_DUE
from arl_fixtures.metrics.step import BenchUncertainty
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings
from arl_fixtures.yaml_model import FileModel, fault_at, load_model, named_file, validate_tree

EMULATED: Final = "emulated"
BUILT_IN: Final = Path(__file__).parent.parent / "data" / "benches"


class DeviceEntry(FileModel):
    """One device: driver, where it is, and the settings of both sides."""

    driver: str
    url: str = Field(description="serial:///dev/NAME?baud=9600, tcp://HOST:PORT, socket://HOST:PORT or 'emulated'")
    settings: Any = None
    emulator: Any = None
    serial: str = ""
    calibration_due: str = Field(default="", description="the last day that counts, e.g. 2027-03-01")
    certificate: str = ""
    accept_expired: str = Field(
        default="", description="why it may be used after that day; without a reason what rests on it is INVALID"
    )

    @field_validator("calibration_due", mode="before")
    @classmethod
    def _a_day(cls, due: object) -> object:
        # YAML reads a bare 2027-03-01 as a date
        if isinstance(due, date) and not isinstance(due, datetime):
            return due.isoformat()
        if isinstance(due, str) and due:
            try:
                return datetime.strptime(due, "%Y-%m-%d").date().isoformat()
            except ValueError:
                raise ValueError("expected a day such as 2027-03-01") from None
        return due

    @field_validator("url")
    @classmethod
    def _known_scheme(cls, url: str) -> str:
        if url != EMULATED and not url.startswith(("serial://", "tcp://", "socket://", "udp://")):
            raise ValueError("expected serial://, tcp://, socket://, udp:// or 'emulated'")
        return url

    @property
    def emulated(self) -> bool:
        """Whether the other end is ours."""
        return self.url == EMULATED


class ThermometerEntry(DeviceEntry):
    """The logger, with the channel of each sensor."""

    ambient: int = Field(default=0, ge=0)
    plate: int = Field(default=1, ge=0)
    housings: tuple[int, ...] = (2, 3, 4)

    def named_channels(self) -> dict[str, int]:
        """Sensor name to channel: `ambient` (the paper's T0), `plate` (T1), then T2… for the housings."""
        named = {"ambient": self.ambient, "plate": self.plate}
        return named | dict(zip(self.housing_names(), self.housings, strict=True))

    def housing_names(self) -> tuple[str, ...]:
        """T2, T3, … in DUT order."""
        return tuple(f"T{index + 2}" for index in range(len(self.housings)))


class DutsEntry(DeviceEntry):
    """The DUTs' receiver, and one DUT file each (relative to the bench file), top to bottom."""

    units: tuple[str, ...] = Field(min_length=1)
    listen: str = Field(default="127.0.0.1", description="local address to bind; loopback unless said otherwise")


class SweepSettings(FileModel):
    """Time limits of a sweep, and how long the stage must rest before a frame counts."""

    rest_s: float = Field(default=0.0, ge=0, description="from 'reached' to the first exposure that counts")
    frame_period_s: float = Field(default=0.040, gt=0)
    move_timeout_s: float = Field(default=60.0, gt=0)
    frames_timeout_s: float = Field(default=5.0, gt=0, description="beyond the frames' own duration")


class EmulationSettings(FileModel):
    """What all emulators of the bench share."""

    plant: PlantSettings = PlantSettings()
    faults: tuple[Fault, ...] = ()
    effects: str = Field(default="", description="a model.yaml whose effects the emulated DUTs show")


class BenchConfig(FileModel):
    """A bench file."""

    name: str = Field(min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$")
    campaign: str = Field(default="campaign", min_length=1, pattern=r"^[A-Za-z0-9][A-Za-z0-9_.+-]*$")
    clock: Literal["virtual", "real"] = "real"
    safe_temperature_c: float = Field(default=23.0, ge=0, le=60)
    home_timeout_s: float = Field(default=120.0, gt=0)
    chiller: DeviceEntry
    thermometer: ThermometerEntry
    stage: DeviceEntry
    relays: DeviceEntry
    duts: DutsEntry
    control: ControlSettings = ControlSettings()
    settle: SettleSettings = SettleSettings()
    guard: GuardSettings = GuardSettings()
    sweep: SweepSettings = SweepSettings()
    scene: SceneSettings = SceneSettings()
    emulation: EmulationSettings = EmulationSettings()
    uncertainty: BenchUncertainty = BenchUncertainty()
    twin_effects: str = Field(default="", description="a model.yaml whose effects the twin shows")

    _dut_settings: tuple[DutSettings, ...] = PrivateAttr(default=())
    _device_settings: dict[str, FileModel] = PrivateAttr(default_factory=dict)
    _emulator_settings: dict[str, FileModel] = PrivateAttr(default_factory=dict)
    _sha256: str = PrivateAttr(default="")
    _folder: Path = PrivateAttr(default=Path())
    _files: tuple[Path, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if len(self.thermometer.housings) != len(self.duts.units):
            raise ValueError(
                f"thermometer.housings names {len(self.thermometer.housings)} channels "
                f"for {len(self.duts.units)} DUTs in duts.units"
            )
        real = [kind for kind, entry in self.devices().items() if not entry.emulated]
        if self.clock == "virtual" and real:
            url = self.devices()[real[0]].url
            raise ValueError(f"clock: virtual needs every device emulated, but {real[0]} is at {url}")
        return self

    @property
    def calibrations(self) -> dict[str, str]:
        """What is said of the devices' calibration, by role and key, as `expired_instruments` reads it."""
        return {
            f"{kind}.{key}": said
            for kind, entry in self.devices().items()
            for key, said in ((CALIBRATION_DUE, entry.calibration_due), (ACCEPT_EXPIRED, entry.accept_expired))
            if said
        }

    def devices(self) -> dict[Kind, DeviceEntry]:
        """All device entries by role."""
        return {
            "chiller": self.chiller,
            "thermometer": self.thermometer,
            "stage": self.stage,
            "relays": self.relays,
            "duts": self.duts,
        }

    @property
    def dut_settings(self) -> tuple[DutSettings, ...]:
        """The DUT files, in housing order."""
        return self._dut_settings

    @property
    def files(self) -> tuple[Path, ...]:
        """The bench file and its DUT files, as they were read."""
        return self._files

    @property
    def effects_path(self) -> Path | None:
        """The model whose effects the emulated DUTs show, relative to the bench file; None where there is none."""
        return self._folder / self.emulation.effects if self.emulation.effects else None

    @property
    def twin_effects_path(self) -> Path | None:
        """The model whose effects the twin shows, relative to the bench file; None where there is none."""
        return self._folder / self.twin_effects if self.twin_effects else None

    @property
    def sha256(self) -> str:
        """Hash over the bench file and its DUT files."""
        return self._sha256

    def device_settings(self, kind: Kind) -> Any:  # noqa: ANN401 - the model belongs to the driver
        """Validated `settings` of a device."""
        return self._device_settings[kind]

    def emulator_settings(self, kind: Kind) -> Any:  # noqa: ANN401 - the model belongs to the emulator
        """Validated `emulator` block of an emulated device."""
        return self._emulator_settings[kind]


def load_bench(name_or_path: str) -> BenchConfig:
    """Read a bench file with its DUT files, and check every block against the driver it is for.

    Args:
        name_or_path: a YAML file, or the name of a bench that comes with the package.

    Raises:
        ConfigError: with file, line and column of each fault.
    """
    return read_bench(bench_path(name_or_path))


def read_bench(path: Path, unit_paths: Sequence[Path] | None = None) -> BenchConfig:
    """Read a bench file.

    Args:
        path: the file.
        unit_paths: where its DUT files lie, in the order in which it names them; where it says if not given.

    Raises:
        ConfigError: with file, line and column of each fault.
    """
    config = load_model(path, BenchConfig)
    digest = hashlib.sha256(path.read_bytes())
    for kind, entry in config.devices().items():
        try:
            driver = find_driver(entry.driver, kind)
            emulation = find_emulation(entry.driver, kind) if entry.emulated else None
        except ConfigError as error:
            raise fault_at(path, [kind, "driver"], str(error)) from None
        config._device_settings[kind] = validate_tree(path, entry.settings or {}, driver.settings)
        if emulation is not None:
            config._emulator_settings[kind] = validate_tree(path, entry.emulator or {}, emulation.settings)
    paths = [path.parent / unit for unit in config.duts.units] if unit_paths is None else list(unit_paths)
    if len(paths) != len(config.duts.units):
        raise ConfigError(f"duts.units: {len(paths)} DUT files for {len(config.duts.units)} DUTs", path=path)
    units = []
    for unit_path in paths:
        units.append(load_model(unit_path, DutSettings))
        digest.update(unit_path.read_bytes())
    serials = [unit.serial for unit in units]
    if len(set(serials)) != len(serials):
        raise ConfigError(f"duts.units: two DUTs have the same serial number among {', '.join(serials)}", path=path)
    config._dut_settings = tuple(units)
    config._folder = path.parent
    config._files = (path, *paths)
    config._sha256 = digest.hexdigest()
    return config


def bench_path(name_or_path: str) -> Path:
    """The file that a bench name stands for."""
    return named_file(name_or_path, BUILT_IN, "bench")
