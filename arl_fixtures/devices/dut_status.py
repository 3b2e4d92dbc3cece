"""What is known of the DUTs and what can be wrong with them, apart from how their frames are received."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from arl_fixtures.errors import DeviceError, DeviceTimeoutError, RemoteProtocolError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.protocols.frame_assembly import AssemblyCounts
from arl_fixtures.protocols.hfl110_telemetry import Telemetry
from arl_fixtures.protocols.operating_record import OperatingRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class DutStatus:
    """What is known of one DUT.

    Attributes:
        serial: as configured.
        address: sender address as configured.
        last_packet_s: bench time of its last frame packet; −infinity while none came.
        counts: of its packets and frames since the receiver was made.
        dropped_frames: frames with too few rows.
        corrupt_rows: rows with impossible pixels.
        telemetry: its last telemetry packet.
        operating: its last operating record.
        complaint: what is wrong with it, in words; empty when nothing is.
    """

    serial: str
    address: str
    last_packet_s: float
    counts: AssemblyCounts
    dropped_frames: int
    corrupt_rows: int
    telemetry: Telemetry | None
    operating: OperatingRecord | None
    complaint: str


class DutError(DeviceError):
    """Some DUTs did not deliver what was asked for; the others did.

    Attributes:
        serials: DUTs that did not.
        blocks: what the others delivered.
    """

    def __init__(self, message: str, *, serials: tuple[str, ...], blocks: Mapping[str, AngleBlock]) -> None:
        super().__init__(message)
        self.serials, self.blocks = serials, blocks


class OtherDutError(DeviceError):
    """A DUT is not the one that the bench file says."""


class DutSilentError(DutError, DeviceTimeoutError):
    """DUTs sent nothing, or too few frames, in time."""


class FrozenFrameError(DutError, RemoteProtocolError):
    """DUTs send the same pixels again and again."""
