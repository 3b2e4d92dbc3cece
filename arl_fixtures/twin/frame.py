"""What a DUT is expected to see at a stage angle: noise-free frames of the nominal model.

Rays depend on K, δ and the mount only, and the wall looks the same from every angle. So an angle costs the few
image columns that panels cover there; columns are found from the azimuth span of their rays.
"""

from __future__ import annotations

from collections import OrderedDict
from functools import cached_property
from typing import Final, TypeVar, final

import numpy as np
import numpy.typing as npt

from arl_fixtures.twin.beam import relative_power, with_patches
from arl_fixtures.twin.expected import BoolArray, Expected, Float32Array, Int8Array
from arl_fixtures.twin.projection import azimuth_elevation, pixel_rays
from arl_fixtures.twin.scene import WALL, Hits, Panel, SceneSettings, hit_panel, hit_wall
from arl_fixtures.twin.settings import DutSettings, Mount

FloatArray = npt.NDArray[np.float64]
ScalarT = TypeVar("ScalarT", bound=np.generic)

REMEMBERED_ANGLES: Final = 256
"""A sweep visits the same angles in every temperature step; one expected frame takes some 90 kB."""


@final
class Renderer:
    """Expected frames of one DUT in one scene.

    Args:
        dut: the DUT as it is (aged by `aging.aged` where that matters).
        scene: the chamber.
        remembered_angles: how many expected frames are kept.
    """

    def __init__(
        self, dut: DutSettings, scene: SceneSettings | None = None, *, remembered_angles: int = REMEMBERED_ANGLES
    ) -> None:
        self.dut = dut
        self.scene = scene or SceneSettings()
        self._remembered_angles = remembered_angles
        self._frames: OrderedDict[float, Expected] = OrderedDict()

    @cached_property
    def rays(self) -> FloatArray:
        """Unit rays in the stage frame, (3, W, n·n, H): x along the nominal boresight, y left, z up."""
        n = self.dut.field_samples
        offsets = (np.arange(n) - (n - 1) / 2) / n
        u, aside, v, below = np.meshgrid(
            np.arange(self.dut.columns, dtype=float),
            offsets,
            np.arange(self.dut.rows, dtype=float),
            offsets,
            indexing="ij",
        )
        u, v = (u + aside).transpose(0, 1, 3, 2), (v + below).transpose(0, 1, 3, 2)
        optical = pixel_rays(self.dut.intrinsics, u, v).reshape(self.dut.columns, n * n, self.dut.rows, 3)
        rays = to_stage(self.dut.mount) @ optical.reshape(-1, 3).T
        return np.ascontiguousarray(rays.reshape(3, self.dut.columns, n * n, self.dut.rows))

    @cached_property
    def centre_directions_rad(self) -> tuple[FloatArray, FloatArray]:
        """Azimuth and elevation of each pixel's centre ray in the sensor frame, (H, W) each, radians."""
        v, u = np.meshgrid(np.arange(float(self.dut.rows)), np.arange(float(self.dut.columns)), indexing="ij")
        return azimuth_elevation(pixel_rays(self.dut.intrinsics, u, v))

    @cached_property
    def power(self) -> FloatArray:
        """P_o of each pixel with local losses, (H, W)."""
        return with_patches(relative_power(self.dut.beam, *self.centre_directions_rad), self.dut.patches)

    def expected(self, stage_angle_deg: float) -> Expected:
        """The expected frame at a stage angle; angles seen before are remembered."""
        frames = self._frames
        known = frames.get(stage_angle_deg)
        if known is not None:
            frames.move_to_end(stage_angle_deg)
            return known
        frame = self._render(stage_angle_deg)
        frames[stage_angle_deg] = frame
        if len(frames) > self._remembered_angles:
            frames.popitem(last=False)
        return frame

    @cached_property
    def _origin_m(self) -> FloatArray:
        return np.array([self.dut.mount.forward_m, self.dut.mount.left_m, self.dut.height_m])

    @cached_property
    def _empty_room(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Range, cosine of incidence and reflectance of all rays where there are no panels."""
        hits = hit_wall(self.scene.wall, self.rays, self._origin_m)
        return hits.range_m, hits.cos_incidence, hits.reflectance

    @cached_property
    def _column_span_rad(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest azimuth of the rays of each column, to the left, (W,) each."""
        azimuth = np.arctan2(self.rays[1], self.rays[0])
        return azimuth.min(axis=(1, 2)), azimuth.max(axis=(1, 2))

    @cached_property
    def _constants(self) -> tuple[Float32Array, Float32Array, BoolArray]:
        """Azimuth, elevation (degrees) and dead pixels."""
        azimuth_rad, elevation_rad = self.centre_directions_rad
        dead = np.zeros((self.dut.rows, self.dut.columns), dtype=bool)
        for u, v in self.dut.dead_pixels:
            dead[v, u] = True
        return _frozen(np.degrees(azimuth_rad)), _frozen(np.degrees(elevation_rad)), _read_only(dead)

    def _columns_of(self, panel: Panel, azimuth_rad: float) -> slice:
        """The image columns whose rays can meet a panel, as one range."""
        # seen from an origin off the axis the panel's edges shift by at most asin(offset / radius)
        shift = np.arcsin(min(1.0, float(np.hypot(*self._origin_m[:2])) / panel.radius_m))
        half = np.arctan2(panel.width_m / 2, panel.radius_m) + shift + 1e-9
        low, high = self._column_span_rad
        centre = (azimuth_rad + np.pi) % (2 * np.pi) - np.pi
        seen = np.flatnonzero((high >= centre - half) & (low <= centre + half))
        return slice(int(seen[0]), int(seen[-1]) + 1) if seen.size else slice(0)

    def _render(self, stage_angle_deg: float) -> Expected:
        ranges, cosines, reflectances = (array.copy() for array in self._empty_room)
        surfaces = np.full(ranges.shape, WALL, dtype=np.int8)
        for number, panel in enumerate(self.scene.panels, start=1):
            azimuth_rad = float(np.radians(panel.azimuth_deg + stage_angle_deg))
            columns = self._columns_of(panel, azimuth_rad)
            hits = hit_panel(panel, azimuth_rad, self.rays[:, columns], self._origin_m)
            _keep_nearest(hits, number, ranges[columns], cosines[columns], reflectances[columns], surfaces[columns])
        reference_m = self.dut.reference_range_m
        weights = reflectances * cosines * (reference_m / ranges) ** 2
        total = weights.sum(axis=1)
        with np.errstate(invalid="ignore"):
            distance_m = (weights * ranges).sum(axis=1) / total
        centre = self.dut.field_samples**2 // 2
        # a black pixel has no weighted range; its geometric one is as good as any, nothing returns from there
        distance_m = np.where(total > 0, distance_m, ranges[:, centre])
        scale = self.dut.full_scale_counts * self.dut.gain / self.dut.field_samples**2
        intensity = scale * self.power * total.T + self.dut.offset_counts
        azimuth_deg, elevation_deg, dead = self._constants
        return Expected(
            stage_angle_deg=stage_angle_deg,
            intensity_counts=_frozen(intensity),
            distance_m=_frozen(distance_m.T),
            surface=_read_only(np.ascontiguousarray(surfaces[:, centre].T)),
            mixed=_read_only(np.ascontiguousarray((surfaces != surfaces[:, :1]).any(axis=1).T)),
            true_range_m=_frozen(ranges[:, centre].T),
            incidence_deg=_frozen(np.degrees(np.arccos(np.clip(cosines[:, centre].T, -1.0, 1.0)))),
            reflectance=_frozen(reflectances[:, centre].T),
            azimuth_deg=azimuth_deg,
            elevation_deg=elevation_deg,
            dead=dead,
        )


def to_stage(mount: Mount) -> FloatArray:
    """Rotation from the optical frame of a DUT (x right, y down, z forward) to the stage frame, (3, 3)."""
    yaw, pitch, roll = np.radians([mount.yaw_deg, mount.pitch_deg, mount.roll_deg])
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    about_x = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    about_y = np.array([[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]])
    about_z = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    rotation: FloatArray = about_z @ about_y @ about_x @ optical
    return rotation


def _keep_nearest(
    hits: Hits,
    number: int,
    ranges: FloatArray,
    cosines: FloatArray,
    reflectances: FloatArray,
    surfaces: Int8Array,
) -> None:
    nearer = hits.range_m < ranges
    np.copyto(ranges, hits.range_m, where=nearer)
    np.copyto(cosines, hits.cos_incidence, where=nearer)
    np.copyto(reflectances, hits.reflectance, where=nearer)
    surfaces[nearer] = number


def _frozen(array: FloatArray) -> Float32Array:
    return _read_only(np.ascontiguousarray(array, dtype=np.float32))


def _read_only(array: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
    array.flags.writeable = False
    return array
