"""How a DUT changes with the number of cycles: a DUT's settings in, the aged DUT's settings out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from pydantic import Field

from arl_fixtures.yaml_model import FiniteModel

if TYPE_CHECKING:
    from arl_fixtures.twin.settings import DutSettings

DEAD_PIXEL_STREAM: Final = 1_000_003
"""Keeps the choice of failing pixels apart from the unit's other random numbers."""


class AgingSettings(FiniteModel):
    """Change per cycle, all zero by default: a DUT ages only where its file says so."""

    power_per_cycle: float = Field(default=0.0, gt=-1, description="relative change of the optical power")
    beam_width_per_cycle: float = Field(default=0.0, gt=-1, description="relative change of both half widths")
    beam_azimuth_deg_per_cycle: float = Field(default=0.0, description="shift of the beam to the right")
    beam_elevation_deg_per_cycle: float = Field(default=0.0, description="shift of the beam upwards")
    dead_pixels_per_cycle: float = Field(
        default=0.0, ge=0, description="pixels that fail, on average; which and when follows from the unit's seed"
    )
    fx_per_cycle: float = Field(default=0.0, gt=-1, description="relative change of fx")
    fy_per_cycle: float = Field(default=0.0, gt=-1, description="relative change of fy")
    cx_px_per_cycle: float = Field(default=0.0, description="shift of the image to the right")
    cy_px_per_cycle: float = Field(default=0.0, description="shift of the image downwards")
    distance_noise_per_cycle: float = Field(default=0.0, gt=-1, description="relative change of σ_D")


def aged(dut: DutSettings, cycle: int) -> DutSettings:
    """`dut` after `cycle` cycles.

    Args:
        dut: the DUT when new.
        cycle: cycles completed, at least 0.

    Returns:
        A DUT with changed gain, beam, pixels, intrinsics and noise, and the same identity.
    """
    aging = dut.aging
    if cycle <= 0 or aging == AgingSettings():
        return dut
    beam, intrinsics = dut.beam, dut.intrinsics
    width = (1 + aging.beam_width_per_cycle) ** cycle
    return dut.model_copy(
        update={
            "gain": dut.gain * (1 + aging.power_per_cycle) ** cycle,
            "beam": beam.model_copy(
                update={
                    "azimuth_half_width_deg": beam.azimuth_half_width_deg * width,
                    "elevation_half_width_deg": beam.elevation_half_width_deg * width,
                    "azimuth_shift_deg": beam.azimuth_shift_deg + aging.beam_azimuth_deg_per_cycle * cycle,
                    "elevation_shift_deg": beam.elevation_shift_deg + aging.beam_elevation_deg_per_cycle * cycle,
                }
            ),
            "intrinsics": intrinsics.model_copy(
                update={
                    "fx": intrinsics.fx * (1 + aging.fx_per_cycle) ** cycle,
                    "fy": intrinsics.fy * (1 + aging.fy_per_cycle) ** cycle,
                    "cx": intrinsics.cx + aging.cx_px_per_cycle * cycle,
                    "cy": intrinsics.cy + aging.cy_px_per_cycle * cycle,
                }
            ),
            "noise": dut.noise.model_copy(
                update={"distance_factor": dut.noise.distance_factor * (1 + aging.distance_noise_per_cycle) ** cycle}
            ),
            "dead_pixels": (*dut.dead_pixels, *_failed_pixels(dut, cycle)),
        }
    )


def _failed_pixels(dut: DutSettings, cycle: int) -> list[tuple[int, int]]:
    """Pixels that failed in the first `cycle` cycles; those of fewer cycles are always among them."""
    generator = np.random.default_rng((dut.seed, DEAD_PIXEL_STREAM))
    alive = generator.permutation(dut.columns * dut.rows)
    known = {v * dut.columns + u for u, v in dut.dead_pixels}
    order = [int(pixel) for pixel in alive if int(pixel) not in known]
    failed = int(generator.poisson(dut.aging.dead_pixels_per_cycle, cycle).sum())
    return [(pixel % dut.columns, pixel // dut.columns) for pixel in order[:failed]]
