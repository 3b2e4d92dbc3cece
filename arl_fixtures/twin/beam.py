"""The illuminating beam: relative optical power over the field of view."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import Field

from arl_fixtures.yaml_model import FiniteModel

FloatArray = npt.NDArray[np.float64]


class BeamSettings(FiniteModel):
    """Super-Gaussian beam; the half widths are where the power has fallen to 1/e."""

    azimuth_half_width_deg: float = Field(default=75.0, gt=0, description="where the power has fallen to 1/e")
    elevation_half_width_deg: float = Field(default=18.0, gt=0, description="likewise")
    exponent: float = Field(default=4.0, gt=0, description="2 is a Gaussian, more is flatter")
    azimuth_shift_deg: float = Field(default=0.0, description="beam points to the right of the optical axis")
    elevation_shift_deg: float = Field(default=0.0, description="beam points above the optical axis")


class PowerPatch(FiniteModel):
    """A rectangle of pixels, both ends included, that gets `factor` of the power."""

    u: tuple[int, int]
    v: tuple[int, int]
    factor: float = Field(ge=0)


def relative_power(beam: BeamSettings, azimuth_rad: FloatArray, elevation_rad: FloatArray) -> FloatArray:
    """Relative optical power P_o in given directions; 1 in the beam's centre.

    P_o = exp(−|α/a|ⁿ − |β/b|ⁿ) with a, b the half widths and n the exponent.

    Args:
        beam: the beam.
        azimuth_rad: α, to the right.
        elevation_rad: β, upwards.

    Returns:
        P_o, shaped as the directions.
    """
    across = (np.degrees(azimuth_rad) - beam.azimuth_shift_deg) / beam.azimuth_half_width_deg
    along = (np.degrees(elevation_rad) - beam.elevation_shift_deg) / beam.elevation_half_width_deg
    power: FloatArray = np.exp(-(np.abs(across) ** beam.exponent) - np.abs(along) ** beam.exponent)
    return power


def with_patches(power: FloatArray, patches: tuple[PowerPatch, ...]) -> FloatArray:
    """P_o (rows, columns) with local losses or gains applied; parts of a patch outside the image are ignored."""
    patched = power.copy()
    for patch in patches:
        rows = slice(max(patch.v[0], 0), max(patch.v[1] + 1, 0))
        columns = slice(max(patch.u[0], 0), max(patch.u[1] + 1, 0))
        patched[rows, columns] *= patch.factor
    return patched
