"""Mocked fixtures for unit tests: the bench's devices in memory, no bytes, no socket, no physics.

Import the fixtures you need into a `conftest.py`; they bear the names of the real ones::

    from arl_fixtures.testing import bench, chiller, clock, duts, relays, stage, thermometer, twin

A mock does what it is told, remembers its calls in `calls`, and raises what `fails_with` holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.twins import Twin, twins_of
from arl_fixtures.devices.dut_status import DutStatus
from arl_fixtures.devices.idling import Idle, nothing
from arl_fixtures.devices.interfaces import ChillerStatus, Identity, Reading
from arl_fixtures.errors import DeviceError
from arl_fixtures.metrics.block import AngleBlock


class Mock:
    """What all mocks share: a call log and a fault to raise."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.fails_with: DeviceError | None = None
        self.closed = False

    def _called(self, *call: object) -> None:
        self.calls.append(call)
        if self.fails_with is not None:
            raise self.fails_with

    def identify(self) -> Identity:
        """The mock's class name."""
        return Identity(name=type(self).__name__)

    def close(self) -> None:
        """Remember that it was closed."""
        self.closed = True


class MockChiller(Mock):
    """A chiller whose bath is at its set-point at once."""

    def __init__(self) -> None:
        super().__init__()
        self.setpoint, self.running = 23.0, False

    def set_setpoint_c(self, setpoint_c: float) -> float:
        """Take any set-point."""
        self._called("set_setpoint_c", setpoint_c)
        self.setpoint = setpoint_c
        return setpoint_c

    def setpoint_c(self) -> float:
        """The last set-point."""
        return self.setpoint

    def bath_c(self) -> float:
        """The same."""
        self._called("bath_c")
        return self.setpoint

    def status(self) -> ChillerStatus:
        """Healthy."""
        return ChillerStatus(
            controlling=self.running,
            circulating=self.running,
            error_code=0,
            warning_code=0,
            level_percent=80.0,
            pump_mbar=1300.0,
        )

    def start(self) -> None:
        """Run."""
        self._called("start")
        self.running = True

    def stop(self) -> None:
        """Rest."""
        self._called("stop")
        self.running = False

    def clear_error(self) -> None:
        """Nothing to clear."""


class MockThermometer(Mock):
    """A logger that reads `values_c`; None is an open thermocouple."""

    def __init__(self, values_c: Sequence[float | None] = (23.0, 23.0, 23.0, 23.0, 23.0)) -> None:
        super().__init__()
        self.values_c: list[float | None] = list(values_c)

    def read_c(self) -> tuple[Reading, ...]:
        """What `values_c` holds."""
        self._called("read_c")
        return tuple(Reading(value, "" if value is not None else "open") for value in self.values_c)


class MockStage(Mock):
    """A stage that arrives at once."""

    def __init__(self) -> None:
        super().__init__()
        self.angle_deg = 0.0

    def home(self, timeout_s: float, idle: Idle = nothing) -> None:
        """Be at zero."""
        self._called("home", timeout_s)
        self.angle_deg = 0.0

    def move_to_deg(self, angle_deg: float) -> None:
        """Be there."""
        self._called("move_to_deg", angle_deg)
        self.angle_deg = angle_deg

    def wait_until_reached(self, timeout_s: float, idle: Idle = nothing) -> float:
        """It has been there since the clock began."""
        self._called("wait_until_reached", timeout_s)
        return 0.0

    def position_deg(self) -> float:
        """Where it was sent."""
        return self.angle_deg

    def moving(self) -> bool:
        """Never."""
        return False

    def stop(self) -> None:
        """Remember."""
        self._called("stop")

    def fault(self) -> str:
        """None."""
        return ""


class MockRelays(Mock):
    """Relays that do what they are told."""

    def __init__(self, loads: Sequence[str] = ("dut_1", "dut_2", "dut_3", "laser_1", "laser_2", "laser_3")) -> None:
        super().__init__()
        self.on = dict.fromkeys(loads, False)

    def loads(self) -> Sequence[str]:
        """Names given at the start."""
        return tuple(self.on)

    def set(self, load: str, on: bool) -> None:
        """Switch."""
        self._called("set", load, on)
        self.on[load] = on

    def states(self) -> Mapping[str, bool]:
        """As switched."""
        return dict(self.on)

    def all_off(self) -> None:
        """Everything off."""
        self._called("all_off")
        self.on = dict.fromkeys(self.on, False)


class MockDuts(Mock):
    """DUTs that see a uniform wall at 1.1 m."""

    def __init__(self, *, height: int = 32, width: int = 128) -> None:
        super().__init__()
        self.height, self.width = height, width

    def collect(
        self,
        serials: Sequence[str],
        n_frames: int,
        *,
        not_before_s: float,
        timeout_s: float,
        angle_index: int = 0,
        stage_angle_deg: float = 0.0,
        idle: Idle = nothing,
    ) -> dict[str, AngleBlock]:
        """The same frames for every DUT."""
        self._called("collect", tuple(serials), n_frames, not_before_s, timeout_s)
        shape = (n_frames, 2, self.height, self.width)
        return {
            serial: AngleBlock(
                dut=serial,
                angle_index=angle_index,
                stage_angle_deg=stage_angle_deg,
                time_ns=np.arange(n_frames, dtype=np.int64) * 40_000_000,
                intensity_counts=np.full(shape, 1000, np.uint16),
                distance_m=np.full(shape, 1.1, np.float32),
                row_valid=np.ones((n_frames, self.height), np.bool_),
            )
            for serial in serials
        }


    def listen(self, duration_s: float) -> Mapping[str, DutStatus]:
        """Hear nobody."""
        self._called("listen", duration_s)
        return {}


@pytest.fixture
def clock() -> VirtualClock:
    """A virtual clock at zero."""
    return VirtualClock()


@pytest.fixture
def chiller() -> MockChiller:
    """A mocked chiller."""
    return MockChiller()


@pytest.fixture
def thermometer() -> MockThermometer:
    """A mocked logger."""
    return MockThermometer()


@pytest.fixture
def stage() -> MockStage:
    """A mocked stage."""
    return MockStage()


@pytest.fixture
def relays() -> MockRelays:
    """Mocked relays."""
    return MockRelays()


@pytest.fixture
def duts() -> MockDuts:
    """Mocked DUTs."""
    return MockDuts()


@pytest.fixture
def bench(
    clock: VirtualClock,
    chiller: MockChiller,
    thermometer: MockThermometer,
    stage: MockStage,
    relays: MockRelays,
    duts: MockDuts,
) -> Iterator[Bench]:
    """A bench of mocks, with the settings of the bench that comes with the package."""
    bench = Bench(
        load_bench("emulated"),
        clock,
        chiller=chiller,
        thermometer=thermometer,
        stage=stage,
        relays=relays,
        duts=duts,
    )
    yield bench
    bench.close()


@pytest.fixture
def twin(bench: Bench) -> dict[str, Twin]:
    """The twin of each DUT, by serial number."""
    return twins_of(bench.config)
