"""Where the circles of the intrinsic targets appear in the image, as a function of everything that may be off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from arl_fixtures.twin.frame import to_stage
from arl_fixtures.twin.projection import Intrinsics, project
from arl_fixtures.twin.settings import DutSettings

Float64Array = npt.NDArray[np.float64]
Int64Array = npt.NDArray[np.int64]

FOCAL: Final = ("fx", "fy")
PRINCIPAL: Final = ("cx", "cy")
DISTORTION: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MOUNT_ANGLES: Final = ("yaw_deg", "pitch_deg", "roll_deg")
MOUNT_POSITION: Final = ("forward_m", "left_m", "up_m")
TARGET_POSITION: Final = ("radial_m", "aside_m", "up_m")


def free_intrinsics(intrinsics: Intrinsics) -> tuple[str, ...]:
    """Names of the intrinsic parameters to estimate: K, and the distortion coefficients the DUT file gives.

    Coefficients that the file leaves at zero stay there: with a field of 128 × 32 pixels more of them than needed
    only trade places with each other. Where all are zero, k1 is estimated.
    """
    used = tuple(name for name in DISTORTION if getattr(intrinsics, name) != 0.0)
    return FOCAL + PRINCIPAL + (used or ("k1",))


@dataclass(frozen=True)
class CircleField:
    """Circles seen in a sweep, m of them over all angles.

    Attributes:
        dut: the DUT as assumed.
        circle: (m,) which circle of which target it is; the same one is seen at many angles.
        angle: (m,) index of the stage angle.
        stage_angle_deg: (m,).
        board: (m,) index of the target.
        boards: names of the targets.
        azimuth_deg: (m,) azimuth of the target in the chamber.
        radius_m: (m,) distance of the target from the axis.
        aside_m: (m,) circle centre on the target, counter-clockwise.
        up_m: (m,) circle centre above the middle DUT.
    """

    dut: DutSettings
    circle: Int64Array
    angle: Int64Array
    stage_angle_deg: Float64Array
    board: Int64Array
    boards: tuple[str, ...]
    azimuth_deg: Float64Array
    radius_m: Float64Array
    aside_m: Float64Array
    up_m: Float64Array

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameters besides the stage angles: intrinsics, mount, target positions."""
        targets = tuple(f"{board}.{axis}" for board in self.boards for axis in TARGET_POSITION)
        mount = tuple(f"mount.{axis}" for axis in MOUNT_ANGLES + MOUNT_POSITION)
        return free_intrinsics(self.dut.intrinsics) + mount + targets

    def pixels(self, offsets: Mapping[str, float] | None = None, turned_deg: float = 0.0) -> Float64Array:
        """Image positions of the circle centres, (m, 2) of u and v.

        Args:
            offsets: deviation of named parameters from what is assumed.
            turned_deg: deviation of all stage angles.
        """
        off = offsets or {}
        intrinsics, mount = self.dut.intrinsics, self.dut.mount
        camera = intrinsics.model_copy(
            update={name: getattr(intrinsics, name) + off[name] for name in off if hasattr(intrinsics, name)}
        )
        tilted = mount.model_copy(
            update={axis: getattr(mount, axis) + off.get(f"mount.{axis}", 0.0) for axis in MOUNT_ANGLES}
        )
        place = np.array([mount.forward_m, mount.left_m, self.dut.height_m])
        place = place + [off.get(f"mount.{axis}", 0.0) for axis in MOUNT_POSITION]
        moved = np.array([[off.get(f"{board}.{axis}", 0.0) for axis in TARGET_POSITION] for board in self.boards])
        radial_m, aside_m, up_m = (moved[self.board] + np.stack([self.radius_m, self.aside_m, self.up_m], axis=1)).T
        cosine, sine = self._facing if turned_deg == 0.0 else self._turned(turned_deg)
        points = np.stack([radial_m * cosine - aside_m * sine, radial_m * sine + aside_m * cosine, up_m], axis=1)
        return project(camera, (points - place) @ to_stage(tilted))

    @cached_property
    def _facing(self) -> tuple[Float64Array, Float64Array]:
        return self._turned(0.0)

    def _turned(self, turned_deg: float) -> tuple[Float64Array, Float64Array]:
        """Cosine and sine of each target's azimuth in the stage's frame, (m,) each."""
        azimuth = np.radians(self.azimuth_deg + self.stage_angle_deg + turned_deg)
        return np.cos(azimuth), np.sin(azimuth)

    @cached_property
    def jacobian(self) -> Float64Array:
        """Derivatives of the image positions by `names`, (m, 2, p); central differences."""
        columns = []
        for name in self.names:
            step = 1e-3 if name in FOCAL + PRINCIPAL or name.endswith("_deg") else 1e-5
            columns.append((self.pixels({name: step}) - self.pixels({name: -step})) / (2.0 * step))
        return np.stack(columns, axis=2)

    @cached_property
    def stage_jacobian(self) -> Float64Array:
        """Derivatives by the own stage angle in degrees, (m, 2)."""
        step = 1e-3
        slope: Float64Array = (self.pixels(turned_deg=step) - self.pixels(turned_deg=-step)) / (2.0 * step)
        return slope
