"""The camera of a table: the nominal one (or its binned image), or K and one distortion coefficient from its rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from arl_fixtures.reconcile.effects_common import per_table
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.projection import Intrinsics

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BEAM_DEG = (75.0, 18.0)
_SAME_RAY_DEG = 0.02
_SAME_PIXEL = 0.03
_MOST_DISTORTION = 0.6
_MOST_LIKELY, _FOLDED = 0.5, 0.24
"""k4 of a lens, and that times the square of the angle, beyond which none is looked for: the image would fold."""
_BINS = (1, 2, 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """K and k4 of OpenCV's rational model (the inverse of which is exact with k4 alone)."""

    fx: float
    fy: float
    cx: float
    cy: float
    k4: float

    def is_possible(self, reach_px: float) -> bool:
        """Whether a lens like this is made, and does not fold the image within so many pixels of its axis."""
        return self.fx > 0.0 and 0.0 <= self.k4 <= _MOST_LIKELY and self.k4 * (reach_px / self.fx) ** 2 < _FOLDED

    def rays(
        self, u: FloatArray, v: FloatArray, focal: FloatArray | float = 1.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Unit rays through image positions in the stage's frame: ahead, left, up."""
        x, y = (u - self.cx) / (self.fx * focal), (v - self.cy) / (self.fy * focal)
        folded = np.minimum(4.0 * self.k4 * (x * x + y * y), 0.996)
        stretch = 2.0 / (1.0 + np.sqrt(1.0 - folded))
        x, y = x * stretch, y * stretch
        ahead = 1.0 / np.sqrt(1.0 + x * x + y * y)
        return ahead, -x * ahead, -y * ahead

    def angles_deg(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Azimuth to the right and elevation of the rays."""
        ahead, left, up = self.rays(u, v)
        return np.degrees(np.arctan2(-left, ahead)), np.degrees(np.arcsin(up))

    def places_of(self, azimuth_deg: FloatArray, elevation_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Image positions of rays, the inverse of `angles_deg`."""
        x = np.tan(np.radians(azimuth_deg))
        y = -np.tan(np.radians(elevation_deg)) * np.sqrt(1.0 + x * x)
        shrink = 1.0 / (1.0 + self.k4 * (x * x + y * y))
        return self.cx + self.fx * x * shrink, self.cy + self.fy * y * shrink

    def pixel_rad(self, pixels: FloatArray | float) -> tuple[FloatArray | float, FloatArray | float]:
        """Angle of a length in pixels in the middle of the image, across and upwards."""
        return pixels / self.fx, pixels / self.fy

    def log_beam(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Logarithm of the nominal illumination of pixels."""
        return self.log_beam_at(*self.angles_deg(u, v))

    @staticmethod
    def log_beam_at(azimuth_deg: FloatArray, elevation_deg: FloatArray) -> FloatArray:
        """Logarithm of the nominal illumination in directions."""
        return np.asarray(-((azimuth_deg / _BEAM_DEG[0]) ** 4) - (elevation_deg / _BEAM_DEG[1]) ** 4)


def cameras_of(view: View) -> tuple[Camera, ...]:
    """Cameras that a table may have been simulated with, the likeliest first.

    The one whose rays the table's azimuths and elevations are; where it has none the nominal one, and that one with
    its pixels binned by two and by four.
    """
    return per_table(view, "cameras", lambda: _find(view))


def places_in_image(view: View, camera: Camera, first: IntArray) -> tuple[FloatArray, FloatArray]:
    """Where in a camera's image rows look: at their pixels, or where rays of devices with other cameras would lie.

    Args:
        view: of the table; camera: of one of its devices; first: rows of the whole table.
    """
    table = view.columns
    u, v = (table.numbers[name][first].astype(np.float64) for name in ("pixel_u", "pixel_v"))
    if not {"azimuth_deg", "elevation_deg"} <= set(table.numbers):
        return u, v
    across, along = camera.places_of(*(table.numbers[name][first] for name in ("azimuth_deg", "elevation_deg")))
    device = np.unique(table.group("dut")[first], return_inverse=True)[1]
    miss = np.nan_to_num(np.hypot(across - u, along - v))
    worst = np.zeros(int(device.max()) + 1)
    np.maximum.at(worst, device, miss)
    other = (worst > _SAME_PIXEL)[device] & np.isfinite(across) & np.isfinite(along)
    return np.where(other, across, u), np.where(other, along, v)


def _find(view: View) -> tuple[Camera, ...]:
    numbers = view.columns.numbers
    rows = np.unique(view.columns.group("pixel_u", "pixel_v"), return_index=True)[1]
    u, v = (numbers[name][rows] for name in ("pixel_u", "pixel_v"))
    given = [numbers[name][rows] if name in numbers else None for name in ("azimuth_deg", "elevation_deg")]
    found = tuple(
        camera
        for camera in (_nominal(bins) for bins in _BINS)
        if all(
            angle is None or np.nanmax(np.abs(angle - mine), initial=0.0) < _SAME_RAY_DEG
            for angle, mine in zip(given, camera.angles_deg(u, v), strict=True)
        )
    )
    if found or given[0] is None or given[1] is None:
        return found
    fitted = _fitted(u, v, given[0], given[1])
    return () if fitted is None else (fitted,)


def _nominal(bins: int) -> Camera:
    """The nominal camera with squares of pixels read as one."""
    nominal = Intrinsics()
    cx, cy = ((c - 0.5 * (bins - 1)) / bins for c in (nominal.cx, nominal.cy))
    return Camera(fx=nominal.fx / bins, fy=nominal.fy / bins, cx=cx, cy=cy, k4=nominal.k4)


def _fitted(u: FloatArray, v: FloatArray, azimuth_deg: FloatArray, elevation_deg: FloatArray) -> Camera | None:
    x = np.tan(np.radians(azimuth_deg))
    y = -np.tan(np.radians(elevation_deg)) * np.sqrt(1.0 + x * x)
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 8 or np.ptp(x[good]) == 0.0 or np.ptp(y[good]) == 0.0:
        return None
    u, v, x, y = u[good], v[good], x[good], y[good]

    def lines(k4: float) -> tuple[FloatArray, FloatArray, float]:
        shrink = 1.0 / (1.0 + k4 * (x * x + y * y))
        across, along = np.polyfit(x * shrink, u, 1), np.polyfit(y * shrink, v, 1)
        miss = np.hypot(np.polyval(across, x * shrink) - u, np.polyval(along, y * shrink) - v)
        return across, along, float(np.max(miss))

    found = minimize_scalar(lambda k4: lines(float(k4))[2], bounds=(0.0, _MOST_DISTORTION), method="bounded")
    across, along, miss = lines(float(found.x))
    if miss > _SAME_PIXEL or across[0] <= 0.0 or along[0] <= 0.0:
        return None
    return Camera(fx=float(across[0]), fy=float(along[0]), cx=float(across[1]), cy=float(along[1]), k4=float(found.x))
