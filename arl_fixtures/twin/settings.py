"""Everything that makes one DUT this DUT: the model behind a DUT file."""

from __future__ import annotations

import ipaddress
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from arl_fixtures.twin.aging import AgingSettings
from arl_fixtures.twin.beam import BeamSettings, PowerPatch
from arl_fixtures.twin.noise import NoiseSettings
from arl_fixtures.twin.operating import OperatingSettings
from arl_fixtures.twin.projection import Intrinsics
from arl_fixtures.yaml_model import FileModel

SERIAL_BYTES = 26
"""Room for a serial number in the sensor's telemetry."""


class Mount(FileModel):
    """How the DUT sits on the stage, relative to its nominal place.

    Angles turn the optical axis: yaw to the left, pitch upwards, roll clockwise as the DUT sees it.
    """

    yaw_deg: float = Field(default=0.0, ge=-45, le=45)
    pitch_deg: float = Field(default=0.0, ge=-45, le=45)
    roll_deg: float = Field(default=0.0, ge=-180, le=180)
    forward_m: float = 0.0
    left_m: float = 0.0


class DutSettings(FileModel):
    """One LiDAR. The defaults are the nominal sensor; only the serial number has none.

    Attributes:
        serial: serial number, printable ASCII.
        model: sensor type; limits may apply to one type only.
        sender_address: IPv4 address its packets come from.
        height_m: optical centre above the middle DUT.
        full_scale_counts: G, counts of a white target at `reference_range_m` under perpendicular incidence.
        gain: g, this unit's factor on G.
        offset_counts: I_off.
        dead_pixels: (u, v) of pixels that never answer.
        patches: local losses of power in the image.
        field_samples: a pixel's field is sampled by this many rays along each side.
        seed: of this unit's noise.
    """

    serial: str = Field(min_length=1, max_length=SERIAL_BYTES)
    model: str = "hfl110"
    sender_address: str = "127.0.0.1"
    height_m: float = 0.0
    mount: Mount = Mount()
    columns: Annotated[int, Field(gt=0)] = 128
    rows: Annotated[int, Field(gt=0)] = 32
    field_samples: Literal[1, 3, 5, 7, 9] = 3
    intrinsics: Intrinsics = Intrinsics()
    full_scale_counts: Annotated[float, Field(gt=0)] = 4000.0
    reference_range_m: Annotated[float, Field(gt=0)] = 1.1
    gain: Annotated[float, Field(ge=0)] = 1.0
    offset_counts: float = 0.0
    dead_pixels: tuple[tuple[int, int], ...] = ()
    beam: BeamSettings = BeamSettings()
    patches: tuple[PowerPatch, ...] = ()
    noise: NoiseSettings = NoiseSettings()
    operating: OperatingSettings = OperatingSettings()
    aging: AgingSettings = AgingSettings()
    seed: Annotated[int, Field(ge=0)] = 0

    @field_validator("serial")
    @classmethod
    def _is_printable(cls, serial: str) -> str:
        if not (serial.isascii() and serial.isprintable()):
            msg = "a serial number is printable ASCII"
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
