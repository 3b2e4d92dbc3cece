"""The targets in the chamber, and where rays from the stage meet them.

Everything is computed in the stage's own frame (x along the boresight, y left, z up, origin on the rotation axis):
turning the stage by φ clockwise shifts every target's azimuth by +φ there, and the rays stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
import numpy.typing as npt
from pydantic import Field, field_validator

from arl_fixtures.yaml_model import FiniteModel

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

Reflectance = Annotated[float, Field(ge=0, le=2)]

WALL: Final = 0
"""Surface number of the wall; panels count from 1 in the scene's order."""


class CircleGrid(FiniteModel):
    """Circles on a panel, centred as a whole."""

    columns: int = Field(default=5, gt=0)
    rows: int = Field(default=5, gt=0)
    pitch_m: float = Field(default=0.11, gt=0)
    radius_m: float = Field(default=0.035, gt=0)
    reflectance: Reflectance = 0.85


class Panel(FiniteModel):
    """A plane rectangle that touches the circle of `radius_m` about the axis at its own azimuth."""

    name: str = Field(min_length=1)
    azimuth_deg: float
    radius_m: float = Field(default=1.1, gt=0)
    width_m: float = Field(gt=0)
    height_m: float = Field(gt=0)
    centre_z_m: float = 0.0
    reflectance: Reflectance
    circles: CircleGrid | None = None


class Wall(FiniteModel):
    """A cylinder about the axis, unbounded in z."""

    name: str = "wall"
    radius_m: float = Field(default=1.6, gt=0)
    reflectance: Reflectance = 0.06


def _stripe(percent: int, azimuth_deg: float) -> Panel:
    return Panel(
        name=f"stripe_{percent}",
        azimuth_deg=azimuth_deg,
        width_m=0.135,
        height_m=0.80,
        reflectance=percent / 100,
    )


def _board(name: str, azimuth_deg: float) -> Panel:
    return Panel(
        name=name, azimuth_deg=azimuth_deg, width_m=0.56, height_m=0.56, reflectance=0.05, circles=CircleGrid()
    )


NOMINAL_PANELS: Final = (
    _stripe(18, 7.5),
    _stripe(50, 0.0),
    _stripe(80, -7.5),
    _board("intrinsic_left", 45.0),
    _board("intrinsic_right", -45.0),
)


class SceneSettings(FiniteModel):
    """All surfaces of the chamber; azimuth counter-clockwise positive seen from above."""

    panels: tuple[Panel, ...] = NOMINAL_PANELS
    wall: Wall = Wall()

    @field_validator("panels")
    @classmethod
    def _names_differ(cls, panels: tuple[Panel, ...]) -> tuple[Panel, ...]:
        names = [panel.name for panel in panels]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            msg = f"two panels are called '{twice[0]}'"
            raise ValueError(msg)
        return panels

    @property
    def surface_names(self) -> tuple[str, ...]:
        """Name of each surface number."""
        return (self.wall.name, *(panel.name for panel in self.panels))


@dataclass(frozen=True, slots=True, kw_only=True)
class Hits:
    """Where rays meet a surface.

    Attributes:
        range_m: distance along the ray, infinite where it misses.
        cos_incidence: cosine of the angle between ray and the surface's normal.
        reflectance: reflectance at the point that is hit.
    """

    range_m: FloatArray
    cos_incidence: FloatArray
    reflectance: FloatArray


def hit_wall(wall: Wall, rays: FloatArray, origin_m: FloatArray) -> Hits:
    """Rays from inside the cylinder onto its wall; independent of the stage angle.

    Args:
        wall: the cylinder.
        rays: (3, ...) unit vectors in the stage frame.
        origin_m: (3,) optical centre in the stage frame, inside the cylinder.
    """
    x, y, _ = rays
    # |o + R d|² = r² in the horizontal plane, larger root
    square = x * x + y * y
    half = origin_m[0] * x + origin_m[1] * y
    inside = wall.radius_m**2 - origin_m[0] ** 2 - origin_m[1] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = np.where(square > 0, (np.sqrt(half * half + square * inside) - half) / square, np.inf)
        cosine = (half + range_m * square) / wall.radius_m
    cosine = np.where(square > 0, cosine, 0.0)
    return Hits(range_m=range_m, cos_incidence=cosine, reflectance=np.full_like(range_m, wall.reflectance))


def hit_panel(panel: Panel, azimuth_rad: float, rays: FloatArray, origin_m: FloatArray) -> Hits:
    """Rays onto one panel.

    Args:
        panel: the panel.
        azimuth_rad: its azimuth in the stage frame, that is its own plus the stage angle.
        rays: (3, ...) unit vectors in the stage frame.
        origin_m: (3,) optical centre in the stage frame.
    """
    x, y, z = rays
    cos_a, sin_a = np.cos(azimuth_rad), np.sin(azimuth_rad)
    cosine = x * cos_a + y * sin_a
    to_plane_m = panel.radius_m - (origin_m[0] * cos_a + origin_m[1] * sin_a)
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = to_plane_m / cosine
        aside_m = range_m * (y * cos_a - x * sin_a) + (origin_m[1] * cos_a - origin_m[0] * sin_a)
        up_m = range_m * z + (origin_m[2] - panel.centre_z_m)
    hit = (cosine > 0) & (np.abs(aside_m) <= panel.width_m / 2) & (np.abs(up_m) <= panel.height_m / 2)
    reflectance = np.full_like(range_m, panel.reflectance)
    if panel.circles is not None:
        reflectance[hit & _in_circle(panel.circles, aside_m, up_m)] = panel.circles.reflectance
    return Hits(range_m=np.where(hit, range_m, np.inf), cos_incidence=cosine, reflectance=reflectance)


def _in_circle(grid: CircleGrid, aside_m: FloatArray, up_m: FloatArray) -> BoolArray:
    return (
        _from_nearest(aside_m, grid.columns, grid.pitch_m) ** 2 + _from_nearest(up_m, grid.rows, grid.pitch_m) ** 2
        <= grid.radius_m**2
    )


def _from_nearest(position_m: FloatArray, count: int, pitch_m: float) -> FloatArray:
    """Distance along one axis to the nearest of `count` centres that are centred as a whole."""
    middle = (count - 1) / 2
    with np.errstate(invalid="ignore", over="ignore"):
        index = np.clip(np.rint(position_m / pitch_m + middle), 0, count - 1)
        nearest: FloatArray = position_m - (index - middle) * pitch_m
    return nearest
