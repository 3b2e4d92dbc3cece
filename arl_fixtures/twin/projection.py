"""OpenCV's rational camera model and its exact inverse.

The inverse solves the radial part from a table up to the model's fold (where distorted radius stops growing with
the true one) and polishes it by Newton steps on both coordinates. OpenCV's own `undistortPoints` iterates a fixed
point, which with its default of five iterations is degrees wrong near the edge of a wide field of view.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
from pydantic import Field

from arl_fixtures.yaml_model import FiniteModel

FloatArray = npt.NDArray[np.float64]

STEEPEST_RAY_DEG: Final = 87.0
"""Rays further off axis than this are not looked for; a perspective model has none at 90°."""
TABLE_NODES: Final = 4096
NEWTON_STEPS: Final = 50
NEWTON_TOLERANCE: Final = 1e-13
SHORTEST_PACE: Final = 1e-6


class Intrinsics(FiniteModel):
    """Matrix K (pixels; an integer is a pixel's centre) and distortion δ in OpenCV's order and sense.

    The defaults are the nominal sensor of about ±60° × ±13.75°.
    """

    fx: float = Field(default=58.1, gt=0)
    fy: float = Field(default=66.0, gt=0)
    cx: float = 63.5
    cy: float = 15.5
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.198
    k5: float = 0.0
    k6: float = 0.0

    @property
    def matrix(self) -> FloatArray:
        """K, (3, 3)."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> FloatArray:
        """δ = (k1 k2 p1 p2 k3 k4 k5 k6), (8,)."""
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3, self.k4, self.k5, self.k6])


def radial_factor(intrinsics: Intrinsics, r2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Radial factor of the rational model and its derivative by r².

    Args:
        intrinsics: the camera.
        r2: squared undistorted radius.

    Returns:
        q and dq/d(r²), shaped as `r2`, with q = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶).
    """
    k = intrinsics
    above = 1 + r2 * (k.k1 + r2 * (k.k2 + r2 * k.k3))
    below = 1 + r2 * (k.k4 + r2 * (k.k5 + r2 * k.k6))
    above_slope = k.k1 + r2 * (2 * k.k2 + r2 * 3 * k.k3)
    below_slope = k.k4 + r2 * (2 * k.k5 + r2 * 3 * k.k6)
    return above / below, (above_slope * below - above * below_slope) / below**2


def distort(intrinsics: Intrinsics, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distort normalised image coordinates (x/z, y/z).

    Returns:
        Distorted normalised coordinates, shaped as the input.
    """
    r2 = x * x + y * y
    q, _ = radial_factor(intrinsics, r2)
    p1, p2 = intrinsics.p1, intrinsics.p2
    return (
        x * q + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * q + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def project(intrinsics: Intrinsics, points: FloatArray) -> FloatArray:
    """Pixel coordinates of points in the optical frame (x right, y down, z forward).

    Args:
        intrinsics: the camera.
        points: (..., 3) with z > 0.

    Returns:
        (..., 2) of u and v.
    """
    xd, yd = distort(intrinsics, points[..., 0] / points[..., 2], points[..., 1] / points[..., 2])
    return np.stack([intrinsics.fx * xd + intrinsics.cx, intrinsics.fy * yd + intrinsics.cy], axis=-1)


def undistort(intrinsics: Intrinsics, xd: FloatArray, yd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Exact inverse of `distort`.

    Beyond the fold of the radial part there is no inverse; a point there gets the ray at the fold in its
    direction, which is what the outermost corners of a sensor see whose K and δ just cover it.

    Args:
        intrinsics: the camera.
        xd: distorted normalised coordinate.
        yd: likewise.

    Returns:
        Undistorted normalised coordinates, shaped as the input.
    """
    radii, distorted = _radial_table(intrinsics)
    fold = radii[-1]
    rho = np.hypot(xd, yd)
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(rho > 0, np.interp(rho, distorted, radii) / rho, 1.0)
    shape = np.shape(xd * scale)
    x, y, xd, yd = ((array * np.ones(shape)).ravel() for array in (xd * scale, yd * scale, xd, yd))
    miss_x, miss_y = _miss(intrinsics, x, y, xd, yd)
    pace = np.ones_like(x)
    # all but the outermost points need a step or two: only who is not there yet goes on
    going = np.arange(x.size)
    for _ in range(NEWTON_STEPS):
        distance = np.hypot(miss_x[going], miss_y[going])
        going = going[(distance > NEWTON_TOLERANCE) & (pace[going] > SHORTEST_PACE)]
        if not going.size:
            break
        at_x, at_y, paces = x[going], y[going], pace[going]
        step_x, step_y = _newton_step(intrinsics, at_x, at_y, miss_x[going], miss_y[going])
        next_x, next_y = _within(fold, at_x + paces * step_x, at_y + paces * step_y)
        next_miss_x, next_miss_y = _miss(intrinsics, next_x, next_y, xd[going], yd[going])
        # near the fold a full step may leap across the image: only steps that come nearer are taken
        nearer = np.hypot(next_miss_x, next_miss_y) < np.hypot(miss_x[going], miss_y[going])
        taken = going[nearer]
        x[taken], y[taken] = next_x[nearer], next_y[nearer]
        miss_x[taken], miss_y[taken] = next_miss_x[nearer], next_miss_y[nearer]
        pace[going] = np.where(nearer, np.minimum(2 * paces, 1.0), paces / 2)
    return x.reshape(shape), y.reshape(shape)


def pixel_rays(intrinsics: Intrinsics, u: FloatArray, v: FloatArray) -> FloatArray:
    """Unit rays in the optical frame through image positions.

    Args:
        intrinsics: the camera.
        u: image position to the right, pixels.
        v: image position downwards, pixels, shaped as `u`.

    Returns:
        (..., 3) of x right, y down, z forward.
    """
    x, y = undistort(intrinsics, (u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    unit: FloatArray = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return unit


def azimuth_elevation(rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction of unit rays in the sensor frame.

    Args:
        rays: (..., 3) in the optical frame.

    Returns:
        Azimuth α = atan2(x, z), to the right, and elevation β = −asin(y), upwards; radians.
    """
    return np.arctan2(rays[..., 0], rays[..., 2]), -np.arcsin(np.clip(rays[..., 1], -1.0, 1.0))


def _radial_table(intrinsics: Intrinsics) -> tuple[FloatArray, FloatArray]:
    """True and distorted radius from the axis to the fold, both increasing."""
    radii = np.tan(np.radians(np.linspace(0.0, STEEPEST_RAY_DEG, TABLE_NODES)))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        q, q_slope = radial_factor(intrinsics, radii**2)
        growth = q + 2 * radii**2 * q_slope
    grows = np.isfinite(growth) & (growth > 0) & (q > 0)
    last = int(np.argmin(grows)) if not grows.all() else TABLE_NODES
    if last < TABLE_NODES:
        fold = _fold_between(intrinsics, float(radii[last - 1]), float(radii[last]))
        radii = np.append(radii[:last], fold)
    q, _ = radial_factor(intrinsics, radii**2)
    distorted = radii * q
    keep = np.concatenate([[True], np.diff(distorted) > 0])
    return radii[keep], distorted[keep]


def _fold_between(intrinsics: Intrinsics, low: float, high: float) -> float:
    """Largest radius in [low, high] up to which the distorted radius grows."""
    for _ in range(80):
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore", invalid="ignore"):
            q, q_slope = radial_factor(intrinsics, np.array(middle**2))
        if float(q + 2 * middle**2 * q_slope) > 0 and float(q) > 0:
            low = middle
        else:
            high = middle
    return low


def _miss(
    intrinsics: Intrinsics, x: FloatArray, y: FloatArray, xd: FloatArray, yd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    found_x, found_y = distort(intrinsics, x, y)
    return xd - found_x, yd - found_y


def _within(radius: float, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points moved towards the axis until they are within a radius."""
    held = radius / np.maximum(np.hypot(x, y), radius)
    return x * held, y * held


def _newton_step(
    intrinsics: Intrinsics, x: FloatArray, y: FloatArray, miss_x: FloatArray, miss_y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    q, slope = radial_factor(intrinsics, x * x + y * y)
    p1, p2 = intrinsics.p1, intrinsics.p2
    xx = q + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    yy = q + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    xy = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    determinant = xx * yy - xy * xy
    # at the fold the Jacobian is singular; the wild step that follows is not taken
    determinant = np.where(np.abs(determinant) < 1e-12, 1e-12, determinant)
    return (yy * miss_x - xy * miss_y) / determinant, (xx * miss_y - xy * miss_x) / determinant
