"""The chamber as surfaces, and rays through it: range, incidence, reflectance and surface at every hit.

Frames as in the bench's description: chamber x to the centre of the target arc, y left, z up; optical x right,
y down, z forward. All lengths in metres, all angles at the interface in degrees.
"""

from dataclasses import dataclass

import numpy as np

SURFACES = ("wall", "stripe_18", "stripe_50", "stripe_80", "intrinsic_left", "intrinsic_right")
FIRST_BOARD = 4  # surfaces from here on carry circles
ARC_M = 1.1
WALL_M = 1.6
DUT_HEIGHT_M = (0.10, 0.0, -0.10)
WIDTH_PX, HEIGHT_PX = 128, 32
FX, FY, CX, CY, K4 = 58.1, 66.0, 63.5, 15.5, 0.198


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """A planar target tangent to the arc; `dots` puts the calibration circles on it."""

    name: str
    azimuth_deg: float
    width_m: float
    height_m: float
    reflectance: float
    dots: bool = False


PANELS = (
    Panel(name="stripe_18", azimuth_deg=7.5, width_m=0.135, height_m=0.80, reflectance=0.18),
    Panel(name="stripe_50", azimuth_deg=0.0, width_m=0.135, height_m=0.80, reflectance=0.50),
    Panel(name="stripe_80", azimuth_deg=-7.5, width_m=0.135, height_m=0.80, reflectance=0.80),
    Panel(name="intrinsic_left", azimuth_deg=45.0, width_m=0.56, height_m=0.56, reflectance=0.05, dots=True),
    Panel(name="intrinsic_right", azimuth_deg=-45.0, width_m=0.56, height_m=0.56, reflectance=0.05, dots=True),
)
WALL_REFLECTANCE = 0.06
DOT_REFLECTANCE, DOT_RADIUS_M, DOT_PITCH_M = 0.85, 0.035, 0.11


@dataclass(frozen=True, slots=True, kw_only=True)
class Hits:
    """What rays meet; every array has the rays' shape.

    `point_m` (…, 3) and `normal` (…, 3) are in the chamber frame, the normal towards the sensor's side; `share` is
    the part of the ray's light that the hit stands for.
    """

    range_m: np.ndarray
    cos_incidence: np.ndarray
    reflectance: np.ndarray
    surface: np.ndarray
    point_m: np.ndarray
    normal: np.ndarray
    share: np.ndarray


def pixel_rays(u: np.ndarray, v: np.ndarray, focal_scale: np.ndarray | float = 1.0) -> np.ndarray:
    """Unit rays of pixels in the optical frame, shape of the broadcast of `u`, `v` and `focal_scale` plus (3,)."""
    x, y = (u - CX) / (FX * focal_scale), (v - CY) / (FY * focal_scale)
    squared = np.minimum(K4 * (x * x + y * y), 0.249)
    stretch = 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * squared))
    x, y = np.broadcast_arrays(x * stretch, y * stretch)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def field_angles_deg(rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth (positive right) and elevation (positive up) of unit rays in the optical frame."""
    return np.degrees(np.arctan2(rays[..., 0], rays[..., 2])), np.degrees(-np.arcsin(rays[..., 1]))


def turn(rays: np.ndarray, roll_deg: np.ndarray, pitch_deg: np.ndarray, yaw_deg: np.ndarray) -> np.ndarray:
    """Rays of a tilted sensor, still in the optical frame: roll about z, then pitch (up), then yaw (right)."""
    x, y, z = rays[..., 0], rays[..., 1], rays[..., 2]
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    x, y = c * x - s * y, s * x + c * y
    c, s = np.cos(np.radians(pitch_deg)), np.sin(np.radians(pitch_deg))
    y, z = c * y - s * z, s * y + c * z
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    x, z = c * x + s * z, -s * x + c * z
    return np.stack([x, y, z], axis=-1)


def to_chamber(vectors: np.ndarray, stage_angle_deg: np.ndarray) -> np.ndarray:
    """Vectors of the optical frame in the chamber frame at a stage angle (clockwise positive seen from above)."""
    forward, left, up = vectors[..., 2], -vectors[..., 0], -vectors[..., 1]
    c, s = np.cos(np.radians(-stage_angle_deg)), np.sin(np.radians(-stage_angle_deg))
    return np.stack([c * forward - s * left, s * forward + c * left, up], axis=-1)


def _dot_share(across: np.ndarray, up: np.ndarray, blur_m: np.ndarray | float) -> np.ndarray:
    """Share of a footprint of width `blur_m` that lies on a calibration circle; 0 or 1 where the width is zero."""
    column = np.clip(np.round(across / DOT_PITCH_M), -2, 2) * DOT_PITCH_M
    row = np.clip(np.round(up / DOT_PITCH_M), -2, 2) * DOT_PITCH_M
    return _inside(DOT_RADIUS_M - np.hypot(across - column, up - row), blur_m)


def _inside(depth_m: np.ndarray, blur_m: np.ndarray | float) -> np.ndarray:
    """Share of a footprint inside of an edge, from its depth behind the edge: a ramp as wide as the footprint."""
    if np.ndim(blur_m) == 0 and blur_m == 0:
        return (depth_m >= 0).astype(float)
    return np.clip(0.5 + depth_m / blur_m, 0.0, 1.0)


def trace(origin_m: np.ndarray, direction: np.ndarray, footprint_rad: float = 0.0) -> Hits:
    """Surfaces along each ray.

    Args:
        origin_m: optical centres in the chamber frame, broadcastable to `direction`.
        direction: unit rays in the chamber frame, shape (…, S, 3) or (…, 3).
        footprint_rad: width of the beamlet that a ray stands for. Zero: the nearest surface counts wholly, the last
            axis of the answer is the rays'. Else a ray at a panel's edge is shared between panel and wall, and the
            answer's last axis is twice as long: panels first, what lies behind them second.
    """
    origin_m = np.broadcast_to(origin_m, direction.shape)
    ox, oy = origin_m[..., 0], origin_m[..., 1]
    dx, dy = direction[..., 0], direction[..., 1]
    a, b, c = dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - WALL_M**2
    wall_m = (-b + np.sqrt(b * b - a * c)) / a
    point = origin_m + wall_m[..., None] * direction
    wall_normal = np.stack([-point[..., 0] / WALL_M, -point[..., 1] / WALL_M, np.zeros_like(wall_m)], axis=-1)
    best, normal, share = wall_m.copy(), wall_normal.copy(), np.zeros_like(wall_m)
    reflectance, surface = np.full(best.shape, WALL_REFLECTANCE), np.zeros(best.shape, dtype=np.int8)
    for panel in PANELS:
        azimuth = np.radians(panel.azimuth_deg)
        nx, ny = np.cos(azimuth), np.sin(azimuth)
        closing = dx * nx + dy * ny
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(closing > 0.05, (ARC_M - (ox * nx + oy * ny)) / closing, 50.0)
        across = -(ox + distance * dx) * ny + (oy + distance * dy) * nx
        up = origin_m[..., 2] + distance * direction[..., 2]
        depth = np.minimum(panel.width_m / 2 - np.abs(across), panel.height_m / 2 - np.abs(up))
        blur = footprint_rad * distance if footprint_rad else 0.0
        cover = _inside(depth, blur) * (distance < wall_m)
        hit = cover > share
        value: np.ndarray | float = panel.reflectance
        if panel.dots:
            value = panel.reflectance + (DOT_REFLECTANCE - panel.reflectance) * _dot_share(across, up, blur)
        best = np.where(hit, distance, best)
        reflectance = np.where(hit, value, reflectance)
        surface = np.where(hit, SURFACES.index(panel.name), surface).astype(np.int8)
        normal = np.where(hit[..., None], np.array([-nx, -ny, 0.0]), normal)
        share = np.where(hit, cover, share)
    if not footprint_rad:
        return _hits(origin_m, direction, best, normal, reflectance, surface, np.ones_like(best))
    front = _hits(origin_m, direction, best, normal, reflectance, surface, share)
    behind = _hits(
        origin_m,
        direction,
        wall_m,
        wall_normal,
        np.full_like(best, WALL_REFLECTANCE),
        np.zeros_like(surface),
        1.0 - share,
    )
    return Hits(
        **{
            name: np.concatenate([getattr(front, name), getattr(behind, name)], axis=direction.ndim - 2)
            for name in Hits.__slots__
        }
    )


def _hits(
    origin_m: np.ndarray,
    direction: np.ndarray,
    range_m: np.ndarray,
    normal: np.ndarray,
    reflectance: np.ndarray,
    surface: np.ndarray,
    share: np.ndarray,
) -> Hits:
    cosine = np.abs(np.sum(direction * normal, axis=-1))
    point = origin_m + range_m[..., None] * direction
    return Hits(
        range_m=range_m,
        cos_incidence=cosine,
        reflectance=reflectance,
        surface=surface,
        point_m=point,
        normal=normal,
        share=share,
    )


def block_centres(stride_u: int = 4, stride_v: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Pixel coordinates of a coarse grid over the frame, flat: a cheap stand-in for every pixel in frame sums."""
    u, v = np.meshgrid(np.arange(stride_u / 2, WIDTH_PX, stride_u), np.arange(stride_v / 2, HEIGHT_PX, stride_v))
    return u.ravel(), v.ravel()
