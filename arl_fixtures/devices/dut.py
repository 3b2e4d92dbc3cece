"""Receiver of all DUTs' frames: HFL110 over UDP, three sensors on one port, told apart by sender address.

A frame counts at a stage angle only if its exposure began after the stage stood still. The sensor does not say when
that was; the receiver infers it from the arrival of a frame's first packet and `exposure_lead_s`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, final

import numpy as np
from pydantic import Field

from arl_fixtures.devices.dut_status import DutSilentError, DutStatus, FrozenFrameError
from arl_fixtures.devices.frozen_frames import repeats
from arl_fixtures.devices.idling import Breaks, Idle, nothing
from arl_fixtures.devices.interfaces import Identity
from arl_fixtures.devices.port import Clock, Datagram, DatagramPort
from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.protocols.frame_assembly import AssembledFrame, FrameAssembler
from arl_fixtures.protocols.hfl110 import FRAME_PERIOD_S, ROWS, Hfl110Wire, decode_frames
from arl_fixtures.protocols.hfl110_telemetry import Telemetry, decode_telemetry
from arl_fixtures.protocols.operating_record import OperatingRecord, decode_record

LONGEST_BACKLOG_S: Final = 1.0
"""Frames that lie unread longer than this are not worth reading: newer ones come at once."""
CATCH_UP_S: Final = 0.02
"""Whoever waited in vain may have overslept: the thread that empties the socket gets a turn before silence counts."""
LONGEST_ROW_S: Final = FRAME_PERIOD_S / ROWS
"""Rows of a frame follow each other no slower than this."""
SHOWN_STRANGERS: Final = 3
NANOSECONDS: Final = 1e9


class HflSettings(Hfl110Wire):
    """What the receiver believes about the sensors, beyond the bytes."""

    exposure_lead_s: float = Field(
        default=FRAME_PERIOD_S, ge=0, le=1,
        description="from the beginning of a frame's exposure to the arrival of its first packet",
    )  # fmt: skip
    frame_timeout_s: float = Field(
        default=0.250, gt=0, description="an incomplete frame is given up when nothing of it has come for this long"
    )
    fewest_rows: int = Field(default=8, ge=1, le=ROWS, description="a frame with fewer rows is dropped and counted")
    silence_s: float = Field(
        default=3.0,
        gt=0,
        description="a DUT of which nothing came for this long is silent; longer than it takes to start",
    )
    operating_max_age_s: float = Field(
        default=1.0, gt=0, description="operating data older than this are not recorded with a frame set"
    )
    refuse_frozen: bool = Field(
        default=True, description="whether a frame with the very pixels of the one before it is an error"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HflPorts:
    """Sockets of a receiver. Telemetry and operating data may be missing."""

    frames: DatagramPort
    telemetry: DatagramPort | None = None
    operating: DatagramPort | None = None


@dataclass(slots=True, kw_only=True)
class _Sensor:
    serial: str
    address: str
    assembler: FrameAssembler
    frames: list[AssembledFrame] = field(default_factory=list)
    previous: AssembledFrame | None = None
    last_packet_s: float = float("-inf")
    last_length: int = 0
    dropped_frames: int = 0
    corrupt_rows: int = 0
    telemetry: Telemetry | None = None
    operating: OperatingRecord | None = None
    operating_s: float = float("-inf")


@final
class HflReceiver:
    """All DUTs of a bench.

    Args:
        ports: sockets, shared by all DUTs.
        clock: bench clock.
        senders: sender address by serial number.
        settings: protocol and patience.

    Raises:
        LocalProtocolError: two DUTs have the same sender address.
    """

    def __init__(
        self, ports: HflPorts, clock: Clock, senders: Mapping[str, str], settings: HflSettings | None = None
    ) -> None:
        self._ports, self._clock = ports, clock
        self._settings = settings = settings or HflSettings()
        self._sensors = {
            serial: _Sensor(
                serial=serial,
                address=address,
                assembler=FrameAssembler(settings.packet_number_counts, timeout_s=settings.frame_timeout_s),
            )
            for serial, address in senders.items()
        }
        self._by_address = {sensor.address: sensor for sensor in self._sensors.values()}
        if len(self._by_address) < len(self._sensors):
            raise LocalProtocolError(f"HFL110 receiver: two DUTs send from the same address: {dict(senders)}")
        self._listened_s = float("-inf")
        self.unknown_senders: dict[str, int] = {}
        """Packets dropped because nobody configured their sender, by address."""
        self.malformed_records = 0
        """Telemetry and operating packets that could not be read."""

    @property
    def serials(self) -> tuple[str, ...]:
        """The configured DUTs."""
        return tuple(self._sensors)

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
        """The first frames of each DUT whose exposure began at or after a time, all DUTs in parallel.

        Frames with missing rows count: they are delivered with those rows masked. What arrived before the first
        exposure that counts is thrown away unread.

        Args:
            serials: the DUTs wanted.
            n_frames: frames of each.
            not_before_s: earliest exposure, bench time.
            timeout_s: from now, bench time.
            angle_index: goes into the blocks.
            stage_angle_deg: goes into the blocks.
            idle: what is done meanwhile, now and then; what arrives then is kept by the port.

        Returns:
            One block per serial number, with the latest operating data.

        Raises:
            DutSilentError: DUTs sent nothing or too little; names serial numbers and addresses.
            FrozenFrameError: DUTs repeat one frame.
            LocalProtocolError: a serial number is not configured, or no frame is asked for.
        """
        wanted = [self._sensor(serial) for serial in serials]
        if n_frames < 1:
            raise LocalProtocolError(f"cannot collect {n_frames} frames; at least 1 is needed")
        clock, settings = self._clock, self._settings
        start_s = clock.now_s
        not_before_s = max(not_before_s, start_s - LONGEST_BACKLOG_S)
        from_s = not_before_s + settings.exposure_lead_s
        deadline_s = start_s + timeout_s
        for sensor in self._sensors.values():
            sensor.assembler.reset()
            sensor.frames = []
        # no packet that comes before then belongs to a frame that counts
        breaks = Breaks(clock, idle)
        breaks.sleep(min(from_s, deadline_s) - start_s)
        self._ports.frames.discard(from_s)
        missing = wanted
        while missing:
            now_s = clock.now_s
            if now_s >= deadline_s or self._hopeless(missing, start_s, now_s):
                break
            self._hear(min(deadline_s - now_s, settings.frame_timeout_s), from_s)
            if breaks.take():
                # nobody is silent or late before all that has come meanwhile is read
                self._hear(0.0, from_s)
            missing = [sensor for sensor in missing if len(sensor.frames) < n_frames]
        self._read_records()
        late = tuple(sensor.serial for sensor in missing)
        blocks = {
            sensor.serial: self._block(sensor, n_frames, angle_index=angle_index, stage_angle_deg=stage_angle_deg)
            for sensor in wanted
            if sensor.serial not in late
        }
        if missing:
            said = "; ".join(self._silence(sensor, n_frames, start_s) for sensor in missing)
            raise DutSilentError(said, serials=late, blocks=blocks)
        self._refuse_frozen(wanted, n_frames, blocks)
        return blocks

    def listen(self, duration_s: float) -> dict[str, DutStatus]:
        """Listen to all DUTs for a while, as a check of the connection.

        Frames that have lain unread for long say nothing of it: they are thrown away.

        Returns:
            Status by serial number.
        """
        deadline_s = self._clock.now_s + duration_s
        if duration_s > 0.0:
            self._ports.frames.discard(self._clock.now_s - LONGEST_BACKLOG_S)
        while (now_s := self._clock.now_s) < deadline_s:
            self._hear(deadline_s - now_s, float("inf"))
        self._read_records()
        return self.status()

    def status(self) -> dict[str, DutStatus]:
        """What is known of each DUT, without waiting."""
        return {
            sensor.serial: DutStatus(
                serial=sensor.serial,
                address=sensor.address,
                last_packet_s=sensor.last_packet_s,
                counts=replace(sensor.assembler.counts),
                dropped_frames=sensor.dropped_frames,
                corrupt_rows=sensor.corrupt_rows,
                telemetry=sensor.telemetry,
                operating=sensor.operating,
                complaint=self._complaint(sensor),
            )
            for sensor in self._sensors.values()
        }

    def identify(self) -> Identity:
        """Serial numbers as the DUTs report them, as far as they have."""
        known = [sensor.telemetry for sensor in self._sensors.values() if sensor.telemetry is not None]
        revisions = sorted({str(telemetry.hardware_revision) for telemetry in known})
        return Identity(
            name="HFL110", firmware=", ".join(revisions), serial=", ".join(telemetry.serial for telemetry in known)
        )

    def close(self) -> None:
        """Release the sockets."""
        for port in (self._ports.frames, self._ports.telemetry, self._ports.operating):
            if port is not None:
                port.close()

    def _sensor(self, serial: str) -> _Sensor:
        sensor = self._sensors.get(serial)
        if sensor is None:
            raise LocalProtocolError(f"no DUT '{serial}' is configured; there are {', '.join(self._sensors)}")
        return sensor

    def _hear(self, timeout_s: float, from_s: float) -> None:
        port = self._ports.frames
        datagrams = port.receive(timeout_s) or port.receive(CATCH_UP_S)
        # what lies unread came after what was read: only up to there is it known who was silent
        self._sort(datagrams, from_s, heard_s=datagrams[-1].time_s if datagrams else self._clock.now_s)

    def _sort(self, datagrams: Iterable[Datagram], from_s: float, *, heard_s: float) -> None:
        """Hand packets to their sensors and keep frames that began at or after `from_s` by their first packet.

        All that arrived up to `heard_s` has been read.
        """
        packets: dict[str, list[tuple[bytes, float]]] = {address: [] for address in self._by_address}
        for payload, sender, time_s in datagrams:
            mine = packets.get(sender)
            if mine is None:
                self.unknown_senders[sender] = self.unknown_senders.get(sender, 0) + 1
            else:
                mine.append((payload, time_s))
        self._listened_s = self._clock.now_s
        for address, mine in packets.items():
            sensor = self._by_address[address]
            finished = sensor.assembler.feed(mine)
            if mine:
                sensor.last_packet_s = mine[-1][1]
                sensor.last_length = len(mine[-1][0])
            finished += sensor.assembler.expire(heard_s)
            for frame in finished:
                # rows that are missing may have been its first
                if frame.cut or frame.first_s - (ROWS - frame.arrived) * LONGEST_ROW_S < from_s:
                    continue
                if frame.arrived < self._settings.fewest_rows:
                    sensor.dropped_frames += 1
                else:
                    sensor.frames.append(frame)

    def _hopeless(self, missing: Iterable[_Sensor], start_s: float, now_s: float) -> bool:
        """Whether all DUTs that are waited for have been silent too long."""
        silence_s = self._settings.silence_s
        return all(now_s - max(sensor.last_packet_s, start_s) > silence_s for sensor in missing)

    def _block(self, sensor: _Sensor, n_frames: int, *, angle_index: int, stage_angle_deg: float) -> AngleBlock:
        taken = sensor.frames[:n_frames]
        frames = decode_frames([row for frame in taken for row in frame.rows], self._settings)
        sensor.corrupt_rows += frames.corrupt_rows
        epoch_ns = self._clock.utc_ns() - round(self._clock.now_s * NANOSECONDS)
        lead_s = self._settings.exposure_lead_s
        operating: Mapping[str, float] = {}
        fresh = taken and taken[-1].last_s - sensor.operating_s <= self._settings.operating_max_age_s
        if fresh and sensor.operating is not None:
            operating = sensor.operating.values
        return AngleBlock(
            dut=sensor.serial,
            angle_index=angle_index,
            stage_angle_deg=stage_angle_deg,
            time_ns=np.array(
                [epoch_ns + round((frame.first_s - lead_s) * NANOSECONDS) for frame in taken], dtype=np.int64
            ),
            intensity_counts=frames.intensity_counts,
            distance_m=frames.distance_m,
            row_valid=frames.row_valid,
            operating=operating,
        )

    def _read_records(self) -> None:
        for port, take in (
            (self._ports.telemetry, self._take_telemetry),
            (self._ports.operating, self._take_operating),
        ):
            if port is None:
                continue
            # only the last record of each DUT is of interest
            latest: dict[str, Datagram] = {}
            for datagram in port.receive(0.0):
                latest[datagram.sender] = datagram
            for sender, datagram in latest.items():
                sensor = self._by_address.get(sender)
                if sensor is None:
                    self.unknown_senders[sender] = self.unknown_senders.get(sender, 0) + 1
                    continue
                try:
                    take(sensor, datagram)
                except RemoteProtocolError:
                    self.malformed_records += 1

    def _take_telemetry(self, sensor: _Sensor, datagram: Datagram) -> None:
        sensor.telemetry = decode_telemetry(datagram.payload, self._settings)

    def _take_operating(self, sensor: _Sensor, datagram: Datagram) -> None:
        sensor.operating = decode_record(datagram.payload)
        sensor.operating_s = datagram.time_s

    def _refuse_frozen(self, wanted: Iterable[_Sensor], n_frames: int, blocks: Mapping[str, AngleBlock]) -> None:
        if not self._settings.refuse_frozen:
            return
        # a dark sensor is not frozen
        lit = [sensor for sensor in wanted if blocks[sensor.serial].intensity_counts.any()]
        frozen = [sensor for sensor in lit if repeats(sensor.previous, sensor.frames[:n_frames])]
        for sensor in lit:
            sensor.previous = sensor.frames[n_frames - 1]
        if frozen:
            said = "; ".join(
                f"DUT {sensor.serial} at {sensor.address}: frozen, frames that follow each other have the same pixels"
                for sensor in frozen
            )
            serials = tuple(sensor.serial for sensor in frozen)
            good = {serial: block for serial, block in blocks.items() if serial not in serials}
            raise FrozenFrameError(said, serials=serials, blocks=good)

    def _silence(self, sensor: _Sensor, n_frames: int, start_s: float) -> str:
        who = f"DUT {sensor.serial} at {sensor.address}"
        waited_s = self._clock.now_s - start_s
        if sensor.last_packet_s < start_s:
            strangers = ", ".join(sorted(self.unknown_senders)[:SHOWN_STRANGERS])
            instead = f"; packets came from {strangers}, which is no configured DUT" if strangers else ""
            return f"{who}: silent, no packet on {self._ports.frames.name} for {waited_s:.1f} s{instead}"
        malformed = sensor.assembler.counts.malformed
        why = (
            f"; {malformed} malformed packets so far, the last packet has {sensor.last_length} bytes"
            if malformed
            else ""
        )
        return f"{who}: {len(sensor.frames)} of {n_frames} frames in {waited_s:.1f} s{why}"

    def _complaint(self, sensor: _Sensor) -> str:
        silent_s = self._listened_s - sensor.last_packet_s
        if sensor.last_packet_s == float("-inf"):
            return "no packet yet"
        if silent_s > self._settings.silence_s:
            return f"silent for {silent_s:.1f} s"
        if sensor.telemetry is not None and sensor.telemetry.serial != sensor.serial:
            return f"calls itself '{sensor.telemetry.serial}'"
        return ""
