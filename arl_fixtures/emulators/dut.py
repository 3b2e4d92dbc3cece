"""An emulated HFL110: while it has power it exposes at 25 Hz, sees what the twin sees, and sends its bytes by UDP.

Everything about a frame follows from the bench time of its exposure: the stage angle, the temperatures and, with
the seed, the noise. So nothing is computed for frames that nobody hears, and leaving them out changes no other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, Self, final

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from arl_fixtures.emulators.device import Outgoing
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.plant import Plant
from arl_fixtures.emulators.row_faults import RowFaults
from arl_fixtures.errors import ConfigError
from arl_fixtures.protocols.hfl110 import (
    COLUMNS,
    FRAME_PERIOD_S,
    ROWS,
    Calibration,
    FrameEncoder,
    Hfl110Wire,
    PixelFlag,
)
from arl_fixtures.protocols.hfl110_telemetry import Telemetry, encode_telemetry
from arl_fixtures.protocols.operating_record import NUMBERS, OperatingRecord, encode_record
from arl_fixtures.twin.aging import aged
from arl_fixtures.twin.conditions import Conditions, FrameModel, altered
from arl_fixtures.twin.expected import Expected
from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import CountedNoise, FrameCoder, scatter
from arl_fixtures.twin.operating import operating_data
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings
from arl_fixtures.yaml_model import FiniteModel

Pixels = tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8]]
"""Intensity, range codes and flags of one frame, (H, W) each."""

Sent = tuple[int, Outgoing]
"""Destination port and datagram."""

TICKS_PER_S: Final = 1e6
"""Frame numbers of the noise are exposure times in microseconds, so that a restart does not repeat the noise."""


class DutEmulatorSettings(FiniteModel):
    """How an emulated sensor behaves in time."""

    frame_period_s: float = Field(default=FRAME_PERIOD_S, gt=0, description="from exposure to exposure")
    exposure_s: float = Field(default=0.010, gt=0, description="duration of an exposure")
    readout_delay_s: float = Field(
        default=0.012, gt=0, description="from the beginning of an exposure to the first packet"
    )
    readout_s: float = Field(default=0.012, gt=0, description="in which the 32 packets leave, evenly spaced")
    boot_s: float = Field(default=2.0, ge=0, description="from power-up to the first exposure")
    phase_s: float = Field(
        default=0.001,
        ge=0,
        description="further delay of the first exposure, times the DUT's position; sensors do not run in step",
    )
    telemetry_period_s: float = Field(default=1.0, gt=0, description="from telemetry packet to telemetry packet")
    operating_every_frames: int = Field(
        default=1, ge=0, description="an operating record follows every so many frames; 0 for none"
    )
    model_refresh_s: float = Field(
        default=1.0, gt=0, description="frame models see conditions at most this old while the stage stands"
    )
    hardware_revision: int = Field(default=3, ge=0, lt=2**32, description="in the telemetry")
    battery_v: float = Field(default=12.0, description="in the telemetry")

    @model_validator(mode="after")
    def _fits_into_its_period(self) -> Self:
        if self.exposure_s > self.readout_delay_s:
            raise ValueError(
                "exposure_s is longer than readout_delay_s: packets would leave before the exposure ends"
            )
        if self.readout_s > self.frame_period_s:
            raise ValueError("readout_s is longer than frame_period_s: frames would overlap on the wire")
        return self


@final
class DutEmulator:
    """One emulated sensor on the bench.

    Args:
        plant: the bench it is part of.
        index: its position there, from 0; the plant calls it `dut_{index + 1}`.
        dut: the unit, when new.
        scene: the chamber.
        settings: its timing.
        wire: ports, layout and disputed fields of its packets.
        models: effects that the nominal model lacks.
        cycle: cycles it has done, for its aging.

    Raises:
        ConfigError: the unit has another number of pixels than the sensor, or an unknown supply rail.
    """

    def __init__(
        self,
        plant: Plant,
        index: int,
        dut: DutSettings,
        scene: SceneSettings | None = None,
        *,
        settings: DutEmulatorSettings | None = None,
        wire: Hfl110Wire | None = None,
        models: Sequence[FrameModel] = (),
        cycle: int = 0,
    ) -> None:
        if (dut.columns, dut.rows) != (COLUMNS, ROWS):
            raise ConfigError(
                f"DUT {dut.serial}: an HFL110 has {COLUMNS} x {ROWS} pixels, not {dut.columns} x {dut.rows}"
            )
        self._plant, self._index, self._dut = plant, index, dut
        self._scene = scene or SceneSettings()
        self._settings = settings or DutEmulatorSettings()
        self._wire = wire or Hfl110Wire()
        self._models = tuple(models)
        self._name = f"dut_{index + 1}"
        self._seed = plant.settings.seed * 2**32 + dut.seed
        for signal in operating_data(dut.operating, dut.operating.reference_c):
            if signal not in NUMBERS:
                raise ConfigError(f"DUT {dut.serial}: no operating record can carry a signal '{signal}'")
        self._encoder = FrameEncoder(self._wire, _calibration(dut, self._wire))
        self._noise = dut.noise.model_copy(
            update={"range_step_m": self._wire.range_step_m, "no_return_code": self._wire.no_return_code}
        )
        self._row_faults = RowFaults(plant.faults, self._name, self._seed)
        self._operating_noise = CountedNoise(self._seed)
        self._spacing_s = self._settings.readout_s / ROWS
        self._restart_s = -math.inf
        self._circumstances = Conditions(dut=dut.serial, cycle=cycle)
        self._cycle_start_s = 0.0
        self._renderer = Renderer(aged(dut, cycle), self._scene)
        self._coder: tuple[float, float, FrameCoder] | None = None
        self._last: tuple[float, list[Sent]] | None = None
        self._pixels: Pixels | None = None
        plant.attach(self._name, self._on_fault)

    @property
    def address(self) -> str:
        """Sender address, as the host sees it."""
        return self._dut.sender_address

    @property
    def renderer(self) -> Renderer:
        """The unit as it is now, aged."""
        return self._renderer

    def enter_cycle(self, cycle: int, start_s: float) -> None:
        """The unit has done `cycle` cycles, and the next one begins at `start_s`."""
        self._circumstances = replace(self._circumstances, cycle=cycle)
        self._cycle_start_s = start_s
        unit = aged(self._dut, cycle)
        if unit != self._renderer.dut:
            self._renderer = Renderer(unit, self._scene)
        self._coder = self._last = None

    def enter_step(self, step: int, *, set_temperature_c: float, ramp: int) -> None:
        """Tell frame models which temperature step this is; the nominal unit does not care."""
        self._circumstances = replace(self._circumstances, step=step, set_temperature_c=set_temperature_c, ramp=ramp)
        self._coder = None

    def next_time_s(self, now_s: float) -> float:
        """Time of the next packet; infinity while the sensor has no power."""
        first_s = self._first_packet_s()
        if math.isinf(first_s) or now_s <= first_s:
            return first_s
        settings = self._settings
        into_s = (now_s - first_s) % settings.frame_period_s
        row = math.ceil(into_s / self._spacing_s - 1e-9)
        wait_s = settings.frame_period_s if row >= ROWS else row * self._spacing_s
        return max(now_s, now_s - into_s + wait_s)

    def send(self, now_s: float, until_s: float) -> list[Sent]:
        """Everything that leaves in `now_s` < time <= `until_s`."""
        sent = self.send_bulk(now_s, until_s) + self.send_rest(now_s, until_s)
        sent.sort(key=_time_s)
        return sent

    @property
    def bulk_port(self) -> int:
        """Where frames go: each has to be rendered."""
        return self._wire.frame_port

    def send_bulk(self, now_s: float, until_s: float) -> list[Sent]:
        """The rows of frames that leave in `now_s` < time <= `until_s`."""
        sent: list[Sent] = []
        for count, packet_s in self._frames(now_s, until_s):
            last_s = packet_s + (ROWS - 1) * self._spacing_s
            if last_s > now_s and packet_s <= until_s:
                rows = self._packets_of(count, packet_s)
                whole = now_s < packet_s and last_s <= until_s
                sent += rows if whole else [item for item in rows if now_s < item[1].time_s <= until_s]
        return sent

    def send_rest(self, now_s: float, until_s: float) -> list[Sent]:
        """Operating data and telemetry that leave in `now_s` < time <= `until_s`."""
        settings, port = self._settings, self._wire.operating_port
        every, sent = settings.operating_every_frames, self._telemetry(now_s, until_s)
        if every:
            for count, packet_s in self._frames(now_s, until_s):
                record_s = packet_s + settings.readout_s
                if count % every == 0 and now_s < record_s <= until_s:
                    sent.append((port, Outgoing(record_s, self._record(count, packet_s))))
            sent.sort(key=_time_s)
        return sent

    # -- parts of what is sent

    def _frames(self, now_s: float, until_s: float) -> Iterator[tuple[int, float]]:
        """Number and time of the first packet of each frame of which anything may leave then."""
        self._plant.advance(until_s)
        first_s, period_s = self._first_packet_s(), self._settings.frame_period_s
        if first_s > until_s:
            return
        # the record after the rows leaves one spacing later than the last of them
        begin = max(0, math.floor((now_s - first_s - self._settings.readout_s) / period_s))
        end = math.floor((until_s - first_s) / period_s + 1e-9)
        for count in range(begin, end + 1):
            packet_s = first_s + count * period_s
            if not self._is_mute(packet_s):
                yield count, packet_s

    def _packets_of(self, count: int, packet_s: float) -> list[Sent]:
        """All packets of a frame. A window may end in the middle of one, so the last frame's are kept."""
        if self._last is None or self._last[0] != packet_s:
            times_s = [packet_s + row * self._spacing_s for row in range(ROWS)]
            rows = self._row_faults.apply(self._rows(count, packet_s), times_s)
            port = self._wire.frame_port
            self._last = (packet_s, [(port, Outgoing(time_s, row)) for time_s, row in rows])
        return self._last[1]

    def _rows(self, count: int, packet_s: float) -> list[bytes]:
        """The 32 payloads of a frame."""
        exposure_s = packet_s - self._settings.readout_delay_s
        frozen = self._plant.faults.active(self._name, FaultKind.FROZEN_FRAME, packet_s)
        if frozen is None or self._pixels is None:
            self._pixels = self._expose(exposure_s)
        intensity, codes, flags = self._pixels
        return self._encoder.encode(
            frame_number=count,
            timestamp=round(self._own_time_s(exposure_s) / self._wire.timestamp_step_s),
            intensity_counts=intensity,
            range_codes=codes,
            flags=flags,
        )

    def _expose(self, exposure_s: float) -> Pixels:
        """Pixels of one exposure."""
        middle_s = exposure_s + self._settings.exposure_s / 2
        if not self._plant.laser_on(self._index, middle_s):
            shape = (self._dut.rows, self._dut.columns)
            dark = np.full(shape, self._wire.no_return_code, np.uint16)
            return np.zeros(shape, np.uint16), dark, np.zeros(shape, np.uint8)
        angle_deg = self._plant.stage_angle_deg(middle_s)
        number = round(exposure_s * TICKS_PER_S)
        coder = self._coder_at(angle_deg, middle_s)
        intensity, codes = coder.code(self._seed, (number,))
        flags = coder.returns * np.uint8(PixelFlag.VALID)
        if int(intensity.max()) >= self._noise.full_counts:
            flags |= (intensity[0] >= self._noise.full_counts) * np.uint8(PixelFlag.SATURATED)
        return intensity[0], codes[0], flags

    def _coder_at(self, angle_deg: float, time_s: float) -> FrameCoder:
        known = self._coder
        if known is not None and known[0] == angle_deg:
            fresh = not self._models or 0 <= time_s - known[1] <= self._settings.model_refresh_s
            if fresh:
                return known[2]
        expected: Expected = self._renderer.expected(angle_deg)
        if self._models:
            expected = altered(expected, self._conditions(angle_deg, time_s), self._models)
        coder = FrameCoder(scatter(expected, self._renderer.dut.noise), self._noise)
        self._coder = (angle_deg, time_s, coder)
        return coder

    def _conditions(self, angle_deg: float, time_s: float) -> Conditions:
        plant = self._plant
        housing_c = plant.housing_c[self._index]
        return replace(
            self._circumstances,
            stage_angle_deg=angle_deg,
            time_s=time_s - self._cycle_start_s,
            housing_temperature_c=housing_c,
            plate_temperature_c=plant.plate_c,
            coolant_temperature_c=plant.coolant_c,
            ambient_temperature_c=plant.ambient_c,
            operating=operating_data(self._dut.operating, housing_c),
        )

    def _record(self, count: int, packet_s: float) -> bytes:
        generator = self._operating_noise.at(round(packet_s * TICKS_PER_S))
        values = operating_data(self._dut.operating, self._plant.housing_c[self._index], generator)
        return encode_record(
            OperatingRecord(
                serial=self._dut.serial,
                frame_counter=count,
                timestamp_us=round(self._own_time_s(packet_s) * TICKS_PER_S),
                values=values,
            )
        )

    def _telemetry(self, now_s: float, until_s: float) -> list[Sent]:
        self._plant.advance(until_s)
        settings, first_s = self._settings, self._first_packet_s()
        if first_s > until_s:
            return []
        period_s = settings.telemetry_period_s
        begin = max(0, math.floor((now_s - first_s) / period_s))
        sent: list[Sent] = []
        for count in range(begin, math.floor((until_s - first_s) / period_s + 1e-9) + 1):
            time_s = first_s + count * period_s
            if not now_s < time_s <= until_s or self._is_mute(time_s):
                continue
            tof_c = operating_data(self._dut.operating, self._plant.housing_c[self._index])["tof_temperature_c"]
            telemetry = Telemetry(
                serial=self._dut.serial,
                hardware_revision=settings.hardware_revision,
                sensor_temperature_c=tof_c,
                frame_counter=int((time_s - first_s) / settings.frame_period_s),
                battery_switched_v=settings.battery_v,
                battery_v=settings.battery_v,
                acquisition_period_ms=settings.frame_period_s * 1e3,
            )
            sent.append((self._wire.telemetry_port, Outgoing(time_s, encode_telemetry(telemetry, self._wire))))
        return sent

    # -- power and faults

    def _powered_s(self) -> float:
        """When it last began to start."""
        return max(self._plant.powered_since_s(self._index), self._restart_s)

    def _own_time_s(self, time_s: float) -> float:
        """What its own clock says, which counts from its start."""
        jumped = self._plant.faults.active(self._name, FaultKind.CLOCK_JUMP, time_s)
        jump_s = 0.0 if jumped is None or jumped.role != "dut" else jumped.amount
        return time_s - self._powered_s() + jump_s

    def _first_packet_s(self) -> float:
        settings = self._settings
        start_s = self._powered_s() + settings.boot_s + self._index * settings.phase_s
        return start_s + settings.readout_delay_s

    def _is_mute(self, time_s: float) -> bool:
        active = self._plant.faults.active
        return (
            active(self._name, FaultKind.DUT_SILENT, time_s) is not None
            or active(self._name, FaultKind.BROWN_OUT, time_s) is not None
        )

    def _on_fault(self, fault: Fault, begins: bool, time_s: float) -> None:
        restarts = (fault.kind is FaultKind.RESET and begins) or (fault.kind is FaultKind.BROWN_OUT and not begins)
        if restarts:
            self._restart_s = time_s
            self._last = None


def _time_s(sent: Sent) -> float:
    return sent[1].time_s


def _calibration(dut: DutSettings, wire: Hfl110Wire) -> Calibration:
    """What the sensor believes of itself: its factory calibration, which does not age with it."""
    k = dut.intrinsics
    return Calibration(
        fx=k.fx,
        fy=k.fy,
        cx=k.cx,
        cy=k.cy,
        k1=k.k1,
        k2=k.k2,
        p1=k.p1,
        p2=k.p2,
        r4=k.k4 if wire.calibration_term == "k4" else k.k3,
        mount_z_m=dut.height_m,
    )
