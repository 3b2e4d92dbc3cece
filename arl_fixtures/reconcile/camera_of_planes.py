"""Where pixels look, in a table that does not say so, or only how far aside: the planes that they see show it.

1/range is linear in a ray's direction on a plane, in every stop of a stage and for every surface. The azimuths give a
lens across; its height in the image, and how wide pixels are upwards, are those for which the simulated ranges of
surfaces with a name lie on planes. Without azimuths that tells how wide a pixel is, the middle of the image being
taken as the camera's axis and its pixels as square. Which way the image's rows run no plane tells: they are taken to
run downwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.reconcile.effects_common import distances, per_table, pure_rows, simulated_range_m
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
Seen = tuple[FloatArray, FloatArray, FloatArray]
"""Columns and rows of pixels, and one over their ranges."""

_SAME_PIXEL = 0.05
"""Pixels by which a lens may miss the azimuths."""
_FEWEST_ROWS, _FEWEST_RAYS = 4, 12
_MOST_SURFACES = 60
_FLAT, _SQUARE = 2e-3, 0.5
"""Median relative error of ranges on planes, at most; and how much less it must be for pixels that are not square."""
_BETTER = 0.5
"""Of the error of a camera that looks level in all rows, or whose pixels are of another size."""
_PITCHES_DEG = np.geomspace(0.05, 8.0, 100)
_OTHER = 0.2
"""How much larger or smaller pixels are of another size."""


def camera_of_planes(view: View) -> Camera | None:
    """Camera that sees planes, and whose azimuths are the table's if it has them; None where the table shows none."""
    groups = _seen(view)
    if not groups:
        return None
    numbers = view.columns.numbers
    if "azimuth_deg" not in numbers:
        return _alone(_middle(view), groups)
    across = _lens_across(numbers["pixel_u"], numbers["azimuth_deg"])
    if across is None:
        return None
    v = numbers["pixel_v"]
    top, bottom = float(np.nanmin(v)), float(np.nanmax(v))  # rows of a log among the images have none
    middle, height = 0.5 * (top + bottom), bottom - top
    start = replace(across, cy=middle)

    def camera(place: FloatArray) -> Camera:
        return replace(start, cy=middle + height * float(place[0]), fy=start.fx * float(np.exp(place[1])))

    def bend(place: FloatArray) -> float:
        return _bend(camera(place), groups) if np.all(np.abs(place) < 1.0) else np.inf

    def square(place: FloatArray) -> float:
        return bend(np.array([place[0], 0.0]))

    at = _least(square, np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]])) * [1.0, 0.0]
    free = _least(bend, at + np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]))
    if bend(free) < _SQUARE * bend(at):
        at = free
    level = _bend(replace(start, fy=1e6 * start.fx), groups)
    found = bend(at)
    return camera(at) if found < min(_FLAT, _BETTER * level) else None


def bend_of(view: View, camera: Camera) -> float:
    """Median of how far ranges are from planes with a camera, relative; infinite where the table shows none."""
    groups = _seen(view)
    return _bend(camera, groups) if groups else np.inf


def _alone(centre: tuple[float, float], groups: list[Seen]) -> Camera | None:
    """A pinhole of square pixels about the middle of the image, or another lens where planes clearly show that."""

    def camera(place: FloatArray) -> Camera:
        f = float(np.exp(place[0]))
        return Camera(fx=f, fy=f, cx=centre[0], cy=centre[1], k4=float(place[1]))

    widest = max(float(np.max(np.abs(u - centre[0]))) for u, _, _ in groups)

    def bend(place: FloatArray) -> float:
        one = camera(place)
        return _bend(one, groups) if one.is_possible(widest) else np.inf

    def pinhole(place: FloatArray) -> float:
        return bend(np.array([place[0], 0.0]))

    scales = [-float(np.log(np.radians(p))) for p in _PITCHES_DEG]
    first = min(scales, key=lambda scale: pinhole(np.array([scale, 0.0])))
    at = _least(pinhole, np.array([[first, 0.0], [first + 0.02, 0.0], [first, 0.1]])) * [1.0, 0.0]
    free = _least(bend, at + np.array([[0.0, 0.0], [0.02, 0.0], [0.0, 0.05]]))
    if bend(free) < _SQUARE * bend(at):
        at = free
    found = bend(at)
    others = min(bend(at + np.array([side, 0.0])) for side in (-_OTHER, _OTHER))
    return camera(at) if found < min(_FLAT, _BETTER * others) else None


def _seen(view: View) -> list[Seen]:
    """What the table's pixels see of planes; empty without an image of surfaces that have names and ranges."""
    numbers = view.columns.numbers
    if not {"pixel_u", "pixel_v"} <= set(numbers) or "surface" not in view.columns.categories or not distances(view):
        return []
    u, v = numbers["pixel_u"], numbers["pixel_v"]
    if np.unique(v[np.isfinite(v)]).size < _FEWEST_ROWS:
        return []
    return per_table(view, "planes of pixels", lambda: _surfaces(view, u, v, simulated_range_m(view)))


def _middle(view: View) -> tuple[float, float]:
    u, v = (view.columns.numbers[name] for name in ("pixel_u", "pixel_v"))
    return 0.5 * float(np.nanmin(u) + np.nanmax(u)), 0.5 * float(np.nanmin(v) + np.nanmax(v))


def _least(misfit: Callable[[FloatArray], float], simplex: FloatArray) -> FloatArray:
    found = minimize(
        misfit, simplex[0], method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxiter": 80, "xatol": 1e-4, "fatol": 1e-7},
    )  # fmt: skip
    return np.asarray(found.x, dtype=np.float64)


def _lens_across(u: FloatArray, azimuth_deg: FloatArray) -> Camera | None:
    """A pinhole of these azimuths; None where they are another lens's."""
    good = np.isfinite(u) & np.isfinite(azimuth_deg) & (np.abs(azimuth_deg) < 85.0)
    if good.sum() < _FEWEST_RAYS or np.ptp(u[good]) == 0.0:
        return None
    x = np.tan(np.radians(azimuth_deg[good]))
    slope, cx = np.polyfit(x, u[good], 1)
    if slope <= 0.0 or float(np.max(np.abs(slope * x + cx - u[good]))) > _SAME_PIXEL:
        return None
    return Camera(fx=float(slope), fy=float(slope), cx=float(cx), cy=0.0, k4=0.0)


def _surfaces(view: View, u: FloatArray, v: FloatArray, far: FloatArray) -> list[Seen]:
    """Pixels and inverse ranges of each surface in an image, of the ones that show enough of it."""
    codes = view.columns.categories["surface"][0]
    good = pure_rows(view) & np.isfinite(u) & np.isfinite(v) & np.isfinite(far) & (far > 0.0) & (codes >= 0)
    rows = np.flatnonzero(good)
    whole = view.columns.group(*view.columns.image_columns, "surface")[rows]
    order = np.argsort(whole, kind="stable")
    parts = np.split(rows[order], np.flatnonzero(np.diff(whole[order])) + 1)
    wide = [p for p in parts if p.size >= _FEWEST_RAYS and np.ptp(u[p]) > 1 and np.unique(v[p]).size >= _FEWEST_ROWS]
    largest = sorted(wide, key=lambda p: -p.size)[:_MOST_SURFACES]
    return [(u[p], v[p], 1.0 / far[p]) for p in largest]


def _bend(camera: Camera, groups: list[Seen]) -> float:
    """Median of how far inverse ranges are from planes, relative."""
    misses = []
    for u, v, inverse in groups:
        d = np.stack(camera.rays(u, v), axis=1)
        slope = np.linalg.lstsq(d, inverse, rcond=None)[0]
        misses.append(np.abs(d @ slope / inverse - 1.0))
    return float(np.median(np.concatenate(misses)))
