"""HFL110 frame packets: bytes to pixel arrays and back.

One UDP payload is one image row, 32 make a frame. Integers are big-endian, floats little-endian, nothing carries a
checksum or a length. Two layouts exist under the same version and are told apart by their length: 1372 bytes
(driver 0.1.0, flags at 1244) and 1244 bytes (up to 0.0.20, flags at 1116). Row number 0 comes first and is the bottom
row of the image. What is not publicly known about the sensor is a named setting of `Hfl110Wire`.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from functools import lru_cache
from typing import Final, Literal, final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.yaml_model import FiniteModel

UInt8Array = npt.NDArray[np.uint8]
UInt16Array = npt.NDArray[np.uint16]
Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

COLUMNS: Final = 128
ROWS: Final = 32
RETURNS: Final = 2
FRAME_PERIOD_S: Final = 0.040

Layout = Literal["0.1.0", "0.0.20"]

_HEADER: Final = [
    ("udp_version", ">u2"),
    ("pca_version", ">u2"),
    ("timestamp", ">u8"),
    ("packet_number", ">u4"),
    ("row_number", ">u4"),
    *[(name, "<f4") for name in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "r4", "yaw", "pitch")],
    *[(f"mount_{name}", "<f4") for name in ("yaw_rad", "pitch_rad", "roll_rad", "z_m", "y_m", "x_m")],
    ("status", ">u4"),
]
_PIXELS: Final = [("ranges", ">u2", (COLUMNS, RETURNS)), ("intensities", ">u2", (COLUMNS, RETURNS))]

PACKETS: Final[dict[str, np.dtype[np.void]]] = {
    "0.1.0": np.dtype([*_HEADER, *_PIXELS, ("reserved", "u1", (COLUMNS,)), ("flags", "u1", (COLUMNS,))]),
    "0.0.20": np.dtype([*_HEADER, *_PIXELS, ("flags", "u1", (COLUMNS,))]),
}
LAYOUT_BY_LENGTH: Final[dict[int, Layout]] = {1372: "0.1.0", 1244: "0.0.20"}
NUMBERS: Final = struct.Struct(">II")
NUMBERS_OFFSET: Final = 12
CALIBRATION: Final = slice(20, 92)
"""Bytes that are the same in all rows of a frame."""


class PixelFlag(IntFlag):
    """Flags of return 1; those of return 2 are the same four bits higher. Bit 2 is inferred, not documented."""

    CROSSTALK = 1
    SATURATED = 2
    VALID = 4
    SUPERIMPOSED = 8


class Hfl110Wire(FiniteModel):
    """Where packets go, and what the public sources leave open, or dispute, about their bytes."""

    frame_port: int = Field(default=57410, gt=0, lt=65536, description="UDP port of frame packets")
    telemetry_port: int = Field(default=57413, gt=0, lt=65536, description="UDP port of telemetry")
    operating_port: int = Field(default=57420, gt=0, lt=65536, description="UDP port of operating records")
    layout: Layout = Field(
        default="0.1.0", description="packet layout a simulator sends; a receiver takes both, by length"
    )
    packet_number_counts: Literal["frames", "packets", "unknown"] = Field(
        default="frames", description="whether the field at offset 12 counts frames, packets, or nothing to rely on"
    )
    range_step_m: float = Field(default=1 / 256, gt=0, description="metres per range code")
    range_limit_m: float = Field(default=49.0, gt=0, description="a longer range is no return")
    range_offset_m: float = Field(default=0.0, ge=-10, le=10, description="added to every range before that test")
    no_return_code: int = Field(
        default=65535, ge=0, le=65535, description="range code of a pixel without a return; also caught by the limit"
    )
    full_counts: int = Field(
        default=8191,
        gt=0,
        le=65535,
        description="an intensity above this cannot be (13 bits by the vendor's constant): its row is corrupt",
    )
    calibration_term: Literal["k3", "k4"] = Field(
        default="k4",
        description="which coefficient the float at offset 52 is: k4 (driver 0.1.0) or k3 (struct, 0.0.9)",
    )
    udp_version: int = Field(default=1, ge=0, le=65535, description="header field")
    pca_version: int = Field(default=1, ge=0, le=65535, description="header field")
    timestamp_step_s: float = Field(default=1e-6, gt=0, description="unit of the header's time stamp")
    status: int = Field(default=0, ge=0, lt=2**32, description="header field")
    heater_sign: Literal[-1, 1] = Field(default=-1, description="factor from wire to physical heater temperature")


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Intrinsics and mounting as the header carries them; `r4` is the disputed term at offset 52."""

    fx: float = 0.0
    fy: float = 0.0
    cx: float = 0.0
    cy: float = 0.0
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    r4: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0
    mount_yaw_rad: float = 0.0
    mount_pitch_rad: float = 0.0
    mount_roll_rad: float = 0.0
    mount_z_m: float = 0.0
    mount_y_m: float = 0.0
    mount_x_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RowHeader:
    """Header of one frame packet."""

    layout: Layout
    udp_version: int
    pca_version: int
    timestamp: int
    packet_number: int
    row_number: int
    calibration: Calibration
    status: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Decoded frames, top row first.

    Attributes:
        intensity_counts: (n, 2, H, W) both returns; 0 in missing rows.
        distance_m: (n, 2, H, W); NaN without a return and in missing rows.
        flags: (n, H, W) the packet's flag byte; 0 in missing rows.
        row_valid: (n, H) False for rows that are missing or corrupt.
        corrupt_rows: how many rows were there but cannot be.
    """

    intensity_counts: UInt16Array
    distance_m: Float32Array
    flags: UInt8Array
    row_valid: BoolArray
    corrupt_rows: int


@final
class FrameEncoder:
    """Makes the 32 payloads of a frame.

    Args:
        wire: layout and header fields.
        calibration: goes into every row.
    """

    def __init__(self, wire: Hfl110Wire, calibration: Calibration) -> None:
        self._wire = wire
        self._rows = rows = np.zeros(ROWS, dtype=PACKETS[wire.layout])
        self._length = rows.dtype.itemsize
        rows["row_number"] = np.arange(ROWS)
        for name in ("udp_version", "pca_version", "status"):
            rows[name] = getattr(wire, name)
        for name in Calibration.__slots__:
            rows[name] = getattr(calibration, name)
        rows["ranges"] = wire.no_return_code

    def encode(
        self,
        *,
        frame_number: int,
        timestamp: int,
        intensity_counts: UInt16Array,
        range_codes: UInt16Array,
        flags: UInt8Array | None = None,
    ) -> list[bytes]:
        """The payloads in the order in which they are sent (bottom row first).

        Args:
            frame_number: count of frames since the sensor started; wraps at 32 bits.
            timestamp: in units of `timestamp_step_s`; wraps at 64 bits.
            intensity_counts: (H, W) of the first return, or (2, H, W) of both.
            range_codes: shaped likewise. Without a second return that one is empty.
            flags: (H, W), 0 where not given.

        Raises:
            LocalProtocolError: the arrays are no 128 × 32 frame.
        """
        if intensity_counts.shape[-2:] != (ROWS, COLUMNS) or intensity_counts.shape != range_codes.shape:
            shapes = f"{intensity_counts.shape} and {range_codes.shape}"
            raise LocalProtocolError(f"HFL110 frame: expected two arrays of 32 x 128 pixels, got {shapes}")
        rows = self._rows
        first = frame_number * ROWS if self._wire.packet_number_counts == "packets" else frame_number
        step = self._wire.packet_number_counts == "packets"
        rows["packet_number"] = (first + step * np.arange(ROWS)) % 2**32
        rows["timestamp"] = timestamp % 2**64
        if intensity_counts.ndim == 2:
            rows["intensities"][:, :, 0] = intensity_counts[::-1]
            rows["ranges"][:, :, 0] = range_codes[::-1]
        else:
            rows["intensities"] = np.moveaxis(intensity_counts, 0, -1)[::-1]
            rows["ranges"] = np.moveaxis(range_codes, 0, -1)[::-1]
        rows["flags"] = 0 if flags is None else flags[::-1]
        whole = rows.tobytes()
        if intensity_counts.ndim == 3:
            # a frame with one return that follows finds its second one empty
            rows["intensities"], rows["ranges"] = 0, self._wire.no_return_code
        length = self._length
        return [whole[start : start + length] for start in range(0, ROWS * length, length)]


def layout_of(payload: bytes) -> Layout:
    """The layout of a frame packet.

    Raises:
        RemoteProtocolError: no known layout has this length.
    """
    layout = LAYOUT_BY_LENGTH.get(len(payload))
    if layout is None:
        raise RemoteProtocolError(f"HFL110 frame packet of {len(payload)} bytes; expected 1372 or 1244")
    return layout


def decode_header(payload: bytes) -> RowHeader:
    """The header of one frame packet.

    Raises:
        RemoteProtocolError: wrong length, or a row number beyond 31.
    """
    layout = layout_of(payload)
    row = np.frombuffer(payload, dtype=PACKETS[layout])[0]
    if row["row_number"] >= ROWS:
        raise RemoteProtocolError(f"HFL110 frame packet of row {int(row['row_number'])}; rows count from 0 to 31")
    return RowHeader(
        layout=layout,
        udp_version=int(row["udp_version"]),
        pca_version=int(row["pca_version"]),
        timestamp=int(row["timestamp"]),
        packet_number=int(row["packet_number"]),
        row_number=int(row["row_number"]),
        calibration=Calibration(**{name: float(row[name]) for name in Calibration.__slots__}),
        status=int(row["status"]),
    )


def decode_frames(rows: Sequence[bytes | None], wire: Hfl110Wire) -> Frames:
    """Pixels of whole frames.

    Args:
        rows: n × 32 payloads in order of frame and row number; None for a row that never came.
        wire: coding.

    Raises:
        LocalProtocolError: the number of rows is no multiple of 32.
        RemoteProtocolError: a payload has no known length.
    """
    if len(rows) % ROWS:
        raise LocalProtocolError(f"HFL110 frames consist of 32 rows, got {len(rows)} rows")
    count = len(rows) // ROWS
    payloads = [row for row in rows if row is not None]
    lengths = set(map(len, payloads))
    if wrong := lengths - set(LAYOUT_BY_LENGTH):
        raise RemoteProtocolError(f"HFL110 frame packet of {min(wrong)} bytes; expected 1372 or 1244")
    packet = PACKETS[LAYOUT_BY_LENGTH[max(lengths, default=1372)]]
    present = np.ones(len(rows), dtype=bool)
    if len(payloads) < len(rows) or len(lengths) > 1:
        present = np.array([row is not None for row in rows], dtype=bool)
        payloads = [bytes(packet.itemsize) if row is None else _in_layout(row, packet.itemsize) for row in rows]
    table = np.frombuffer(b"".join(payloads), dtype=packet)
    shape = (count, ROWS, COLUMNS, RETURNS)
    # bottom row first on the wire, returns side by side: turned to (n, 2, H, W), top row first
    intensity = np.ascontiguousarray(
        table["intensities"].reshape(shape)[:, ::-1].transpose(0, 3, 1, 2), dtype=np.uint16
    )
    codes = np.ascontiguousarray(table["ranges"].reshape(shape)[:, ::-1].transpose(0, 3, 1, 2), dtype=np.uint16)
    distance = _metres(wire).take(codes)
    flags = table["flags"].reshape(count, ROWS, COLUMNS)[:, ::-1].copy()
    valid = present.reshape(count, ROWS)[:, ::-1].copy()
    corrupt = (intensity.max(axis=(1, 3)) > wire.full_counts) & valid
    bad = corrupt | ~valid
    if bad.any():
        frame, row = np.nonzero(bad)
        intensity[frame, :, row] = 0
        distance[frame, :, row] = np.nan
        flags[frame, row] = 0
        valid &= ~corrupt
    return Frames(
        intensity_counts=intensity,
        distance_m=distance,
        flags=flags,
        row_valid=valid,
        corrupt_rows=int(corrupt.sum()),
    )


def _in_layout(row: bytes, length: int) -> bytes:
    """A row of the other layout, its flags dropped, so that both fit into one table."""
    return row if len(row) == length else row[:1116].ljust(length, b"\0")


@lru_cache(maxsize=16)
def _metres(wire: Hfl110Wire) -> Float32Array:
    """Range of every code, metres; NaN where it is no return."""
    codes = np.arange(65536)
    metres = codes * wire.range_step_m + wire.range_offset_m
    metres[(metres > wire.range_limit_m) | (codes == wire.no_return_code)] = np.nan
    return metres.astype(np.float32)
