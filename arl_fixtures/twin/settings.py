"""Everything that makes one DUT this DUT: the model behind a DUT file."""

from __future__ import annotations

import ipaddress
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator

from arl_fixtures.twin.aging import AgingSettings
from arl_fixtures.twin.beam import BeamSettings, PowerPatch
from arl_fixtures.twin.noise import NoiseSettings
from arl_fixtures.twin.operating import OperatingSettings
from arl_fixtures.twin.projection import Intrinsics
from arl_fixtures.yaml_model import FiniteModel

SERIAL_BYTES = 26
"""Room for a serial number in the sensor's telemetry."""


class Mount(FiniteModel):
    """How the DUT sits on the stage, relative to its nominal place."""

    yaw_deg: float = Field(default=0.0, ge=-45, le=45, description="optical axis turned to the left")
    pitch_deg: float = Field(default=0.0, ge=-45, le=45, description="optical axis turned upwards")
    roll_deg: float = Field(default=0.0, ge=-180, le=180, description="turned clockwise as the DUT sees it")
    forward_m: float = Field(default=0.0, description="optical centre before the rotation axis")
    left_m: float = Field(default=0.0, description="optical centre left of the rotation axis")


class DutSettings(FiniteModel):
    """One LiDAR. The defaults are the nominal sensor; only the serial number has none."""

    serial: str = Field(min_length=1, max_length=SERIAL_BYTES, description="serial number, printable ASCII")
    model: str = Field(default="hfl110", description="sensor type; limits may apply to one type only")
    sender_address: str = Field(default="127.0.0.1", description="IPv4 address its packets come from")
    height_m: float = Field(default=0.0, description="optical centre above the middle DUT")
    mount: Mount = Field(default=Mount(), description="how it sits on the stage")
    columns: int = Field(default=128, gt=0, description="width of the image")
    rows: int = Field(default=32, gt=0, description="height of the image")
    field_samples: Literal[1, 3, 5, 7, 9] = Field(
        default=3, description="a pixel's field is sampled by this many rays along each side"
    )
    intrinsics: Intrinsics = Field(default=Intrinsics(), description="K and δ")
    full_scale_counts: float = Field(
        default=4000.0,
        gt=0,
        description="G, counts of a white target at `reference_range_m`, seen perpendicularly",
    )
    reference_range_m: float = Field(default=1.1, gt=0, description="range to which G refers")
    gain: float = Field(default=1.0, ge=0, description="g, this unit's factor on G")
    offset_counts: float = Field(default=0.0, description="I_off, added to every expected intensity")
    dead_pixels: tuple[tuple[int, int], ...] = Field(default=(), description="[u, v] of pixels that never answer")
    beam: BeamSettings = Field(default=BeamSettings(), description="relative optical power over the field of view")
    patches: tuple[PowerPatch, ...] = Field(
        default=(), description="rectangles of pixels, `u` and `v` from and to, that get `factor` of the power"
    )
    noise: NoiseSettings = Field(default=NoiseSettings(), description="noise and coding")
    operating: OperatingSettings = Field(default=OperatingSettings(), description="nominal operating data")
    aging: AgingSettings = Field(default=AgingSettings(), description="change per cycle, of emulated DUTs")
    seed: int = Field(default=0, ge=0, description="of this unit's noise, where it is emulated")

    @field_validator("serial")
    @classmethod
    def _is_printable(cls, serial: str) -> str:
        if not (serial.isascii() and serial.isprintable()):
            msg = "a serial number is printable ASCII"
            raise ValueError(msg)
        # files are named by it
        if "/" in serial or "\\" in serial or serial.startswith("."):
            msg = "a serial number has no slash and does not begin with a dot"
            raise ValueError(msg)
        return serial

    @field_validator("sender_address")
    @classmethod
    def _is_ipv4(cls, address: str) -> str:
        try:
            return str(ipaddress.IPv4Address(address))
        except ValueError:
            msg = "expected an IPv4 address such as 192.168.10.21"
            raise ValueError(msg) from None

    @field_validator("dead_pixels")
    @classmethod
    def _pixels_lie_in_the_image(
        cls, pixels: tuple[tuple[int, int], ...], info: ValidationInfo
    ) -> tuple[tuple[int, int], ...]:
        columns, rows = info.data.get("columns", 0), info.data.get("rows", 0)
        for u, v in pixels:
            if not (0 <= u < columns and 0 <= v < rows):
                msg = f"dead pixel (u {u}, v {v}) lies outside the image of {columns} x {rows}"
                raise ValueError(msg)
        return pixels
