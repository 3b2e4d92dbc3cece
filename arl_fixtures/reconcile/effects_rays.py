"""The surfaces of the nominal bench through the rays that sample a pixel, for any pose of the sensor.

Nine sharp rays make a pixel at an edge jump by a ninth of its light when a ray crosses the edge. A displacement then
shows in those few rows, each by many standard errors, and nothing that renders edges smoothly predicts them: so the
same rays are traced again, exactly, which is cheap enough for every trial of a fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.twin.scene import CircleGrid, Panel, SceneSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Number = FloatArray | float

_CHUNK = 1024
_REACH_DEG = 1.5
"""How far from its centre a pixel's rays may end, degrees, for the choice of panels to trace."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """How the rows' rays differ from the nominal ones; numbers, or one per row.

    Attributes:
        turn_deg: bearing to the right, about the vertical axis.
        tilt_deg: yaw to the right, pitch up, roll clockwise of the sensor; applied roll first, yaw last.
        forward_m, right_m: optical centre in the stage's frame.
        focal: focal length over the nominal one.
        blur_px: standard deviation of a Gaussian about each ray.
    """

    turn_deg: Number = 0.0
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    forward_m: Number = 0.0
    right_m: Number = 0.0
    focal: Number = 1.0
    blur_px: Number = 0.0

    def on(self, rows: IntArray | slice) -> Pose:
        """The pose on some rows."""

        def cut(value: Number) -> Number:
            return value[rows] if isinstance(value, np.ndarray) else value

        return Pose(
            turn_deg=cut(self.turn_deg), tilt_deg=self.tilt_deg, forward_m=cut(self.forward_m),
            right_m=cut(self.right_m), focal=cut(self.focal), blur_px=cut(self.blur_px),
        )  # fmt: skip

    def arrays(self) -> list[FloatArray]:
        """The attributes that are given row by row."""
        return [value for value in self._numbers() if isinstance(value, np.ndarray)]

    def digest(self) -> bytes:
        """What tells this pose from others."""
        found = blake2b(repr(self.tilt_deg).encode(), digest_size=16)
        for value in self._numbers():
            found.update(b"rows" + value.tobytes() if isinstance(value, np.ndarray) else repr(float(value)).encode())
        return found.digest()

    def _numbers(self) -> tuple[Number, ...]:
        return self.turn_deg, self.forward_m, self.right_m, self.focal, self.blur_px


NOMINAL = Pose()


@dataclass(frozen=True, slots=True, kw_only=True)
class Spots:
    """Pixels at stage angles: what is looked at; all of equal length."""

    u: FloatArray
    v: FloatArray
    stage_deg: FloatArray
    height_m: FloatArray

    def take(self, rows: IntArray | slice) -> Spots:
        """Some of them."""
        return Spots(u=self.u[rows], v=self.v[rows], stage_deg=self.stage_deg[rows], height_m=self.height_m[rows])

    def beside(self, du: float, dv: float) -> Spots:
        """The pixels `du` columns and `dv` rows further."""
        return Spots(u=self.u + du, v=self.v + dv, stage_deg=self.stage_deg, height_m=self.height_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """Through what is looked, and at what.

    Attributes:
        camera: of the pixels.
        rays: per side of a pixel.
        soft_rad: width of the beamlet that a ray stands for; zero for sharp rays.
        scene: surfaces.
        filled: width over which the rays are spread, in pixels.
        spread_px: standard deviation of the point spread of the simulation itself, in pixels.
    """

    camera: Camera
    rays: int
    soft_rad: float
    scene: SceneSettings
    filled: float = 1.0
    spread_px: float = 0.0


def _offsets(rays: int) -> tuple[FloatArray, FloatArray]:
    places = (np.arange(rays) - (rays - 1) / 2.0) / rays
    across, along = np.meshgrid(places, places, indexing="ij")
    return across.ravel(), along.ravel()


def _column(value: Number) -> Number:
    return value[:, None] if isinstance(value, np.ndarray) else value


Rays = tuple[FloatArray, FloatArray, FloatArray]
"""Ahead, left and up of unit rays in the stage's frame, (spots, rays) each."""


def rays_of(optics: Optics, spots: Spots, focal: Number = 1.0) -> Rays:
    """The rays that sample each spot."""
    du, dv = (optics.filled * offset for offset in _offsets(optics.rays))
    return optics.camera.rays(spots.u[:, None] + du, spots.v[:, None] + dv, _column(focal))


def look(
    optics: Optics, spots: Spots, pose: Pose = NOMINAL, rays: Rays | None = None
) -> tuple[FloatArray, FloatArray]:
    """Mean light and light-weighted range (metres) of spots; see `Pose` for what differs from the nominal bench.

    Light is ρ·cos θ / R² per ray; the mean range is moment over light. `rays` are those of `rays_of`, if at hand.
    """
    light, moment = np.empty(spots.u.size), np.empty(spots.u.size)
    for start in range(0, spots.u.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        some, own = spots.take(part), pose.on(part)
        known = rays_of(optics, some, own.focal) if rays is None else (rays[0][part], rays[1][part], rays[2][part])
        light[part], moment[part] = _look(optics, some, own, known)
    return light, moment


def echoes(optics: Optics, spots: Spots) -> tuple[FloatArray, FloatArray]:
    """Light and range (metres) of each ray of spots, (spots, rays): what `look` takes the mean of."""
    light, moment = _traced(optics, spots, NOMINAL, rays_of(optics, spots))
    return light, moment / np.maximum(light, 1e-300)


def _look(optics: Optics, spots: Spots, pose: Pose, rays: Rays) -> tuple[FloatArray, FloatArray]:
    light, moment = _traced(optics, spots, pose, rays)
    return light.mean(axis=1), moment.mean(axis=1)


def _traced(optics: Optics, spots: Spots, pose: Pose, rays: Rays) -> tuple[FloatArray, FloatArray]:
    """Light, and light times range, of each ray."""
    scene = optics.scene
    x, y, z = _tilted(rays, pose)
    if np.any(pose.turn_deg):
        angle = np.radians(_column(pose.turn_deg))
        c, s = np.cos(angle), np.sin(angle)
        x, y = x * c + y * s, y * c - x * s
    ahead, left = _column(pose.forward_m), -_column(pose.right_m)
    level = x * x + y * y
    radius = scene.wall.radius_m
    if np.any(ahead) or np.any(left):
        half = ahead * x + left * y
        range_m = (np.sqrt(half * half + level * (radius**2 - ahead**2 - left**2)) - half) / level
        weight = scene.wall.reflectance * (half + range_m * level) / radius / range_m**2
        moment = weight * range_m
    else:
        moment = scene.wall.reflectance / radius * level
        weight = moment * np.sqrt(level) / radius
    middle = optics.rays * optics.rays // 2
    bearing = np.degrees(np.arctan2(y[:, middle], x[:, middle]))
    blurred = float(np.max(pose.blur_px)) + optics.spread_px
    reach = _REACH_DEG + float(np.degrees(np.max(np.hypot(ahead, left)))) + 3.0 * blurred
    edge = _edge_width(optics, pose)
    for panel in scene.panels:
        away = np.abs((bearing - panel.azimuth_deg - spots.stage_deg + 180.0) % 360.0 - 180.0)
        near = np.flatnonzero(away < np.degrees(np.arctan(0.5 * panel.width_m / panel.radius_m)) + reach)
        if not near.size:
            continue
        own = pose.on(near)
        cover, share, far = _panel(
            panel,
            np.radians(panel.azimuth_deg + spots.stage_deg[near])[:, None],
            (x[near], y[near], z[near]),
            (_column(own.forward_m), -_column(own.right_m), spots.height_m[near][:, None]),
            _cut(edge, near),
        )
        open_ = 1.0 - cover
        weight[near] = weight[near] * open_ + share
        moment[near] = moment[near] * open_ + share * far
    return weight, moment


def _tilted(rays: Rays, pose: Pose) -> Rays:
    x, y, z = rays  # ahead, left, up
    yaw, pitch, roll = (np.radians(angle) for angle in pose.tilt_deg)
    if roll:
        y, z = np.cos(roll) * y - np.sin(roll) * z, np.cos(roll) * z + np.sin(roll) * y
    if pitch:
        x, z = np.cos(pitch) * x - np.sin(pitch) * z, np.cos(pitch) * z + np.sin(pitch) * x
    if yaw:
        x, y = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
    return x, y, z


@dataclass(frozen=True, slots=True, kw_only=True)
class _Edge:
    """How an edge passes over a ray: angle of its box, and standard deviation across and upwards of its Gaussian.

    Without a Gaussian (None) the box alone; both are per row where the blur is.
    """

    box: float
    across: Number | None = None
    upwards: Number | None = None


def _edge_width(optics: Optics, pose: Pose) -> _Edge | None:
    if isinstance(pose.blur_px, float) and pose.blur_px == 0.0 and optics.spread_px == 0.0:
        return _Edge(box=optics.soft_rad) if optics.soft_rad else None
    blur = _column(np.hypot(pose.blur_px, optics.spread_px))
    across, upwards = (np.maximum(blur / f, _LEAST_RAD) for f in (optics.camera.fx, optics.camera.fy))
    return _Edge(box=optics.soft_rad, across=across, upwards=upwards)


_LEAST_RAD = 1e-9


def _cut(edge: _Edge | None, rows: IntArray) -> _Edge | None:
    if edge is None or not isinstance(edge.across, np.ndarray) or not isinstance(edge.upwards, np.ndarray):
        return edge
    if edge.across.ndim == 0:
        return edge
    return _Edge(box=edge.box, across=edge.across[rows], upwards=edge.upwards[rows])


def _panel(
    panel: Panel,
    angle: FloatArray,
    rays: Rays,
    origin: tuple[Number, Number, FloatArray],
    edge: _Edge | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(coverage, light, range) of one panel on rays."""
    (x, y, z), (ahead, left, up) = rays, origin
    c, s = np.cos(angle), np.sin(angle)
    cosine = np.maximum(x * c + y * s, 1e-3)
    range_m = (panel.radius_m - (ahead * c + left * s)) / cosine
    aside = range_m * (y * c - x * s) + (left * c - ahead * s)
    raised = range_m * z + up - panel.centre_z_m
    depths = panel.width_m / 2 - np.abs(aside), panel.height_m / 2 - np.abs(raised)
    level_m = range_m / cosine
    wide, tall = _on(edge, level_m, range_m)
    cover = _inside(depths[0], wide) * _inside(depths[1], tall) * (cosine > 0.05)
    reflectance: Number = panel.reflectance
    if panel.circles is not None:
        disc = _inside(_depth_in_circle(panel.circles, aside, raised), _between(wide, tall))
        reflectance = panel.reflectance + disc * (panel.circles.reflectance - panel.reflectance)
    return cover, cover * reflectance * cosine / range_m**2, range_m


def _depth_in_circle(grid: CircleGrid, aside: FloatArray, up: FloatArray) -> FloatArray:
    away = []
    for place, count in ((aside, grid.columns), (up, grid.rows)):
        middle = (count - 1) / 2
        away.append(place - (np.clip(np.rint(place / grid.pitch_m + middle), 0, count - 1) - middle) * grid.pitch_m)
    return np.asarray(grid.radius_m - np.hypot(*away))


@dataclass(frozen=True, slots=True)
class _Width:
    """Width of a ray's box on a surface, metres, and standard deviation of its Gaussian, if any."""

    box: Number = 0.0
    sigma: Number | None = None


def _on(edge: _Edge | None, level_m: FloatArray, range_m: FloatArray) -> tuple[_Width, _Width]:
    """Widths of rays across and upwards on a surface, slanted by its incidence as far as `level_m` is longer."""
    if edge is None:
        return _Width(), _Width()
    if edge.across is None or edge.upwards is None:
        return _Width(edge.box * level_m), _Width(edge.box * range_m)
    return _Width(edge.box * level_m, edge.across * level_m), _Width(edge.box * range_m, edge.upwards * range_m)


def _between(wide: _Width, tall: _Width) -> _Width:
    sigma = None if wide.sigma is None or tall.sigma is None else 0.5 * (wide.sigma + tall.sigma)
    return _Width(0.5 * (wide.box + tall.box), sigma)


def _inside(depth: FloatArray, width: _Width) -> FloatArray:
    """Share of a ray that lies inside an edge `depth` away: a step, a ramp, or these under a Gaussian blur."""
    ramp = bool(np.any(width.box))
    if width.sigma is None:
        return np.asarray(np.clip(depth / width.box + 0.5, 0.0, 1.0) if ramp else (depth >= 0.0).astype(np.float64))
    if not ramp:
        return np.asarray(ndtr(depth / width.sigma))
    half, sigma = 0.5 * width.box, width.sigma
    return np.asarray((_ramped((depth + half) / sigma) - _ramped((depth - half) / sigma)) * sigma / width.box)


def _ramped(x: FloatArray) -> FloatArray:
    """Integral of the normal distribution up to `x`."""
    return np.asarray(x * ndtr(x) + np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi))
