"""The nominal bench rendered about each pixel's direction, where the table's simulation is seen to be that bench.

A table of a few scattered pixels does not hold what a ray sees that points a little elsewhere. Where pixels, stage
angles and simulated channels agree with the nominal scene (checked on the table, nothing is assumed), it is rendered:
for every pixel and stage angle a short curve over the bearing and one over the elevation. Each of 3 x 3 rays is a
beamlet as wide as its share of the pixel, so that edges pass smoothly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from arl_fixtures.reconcile.effects_common import distances, per_table, per_view, signals
from arl_fixtures.reconcile.view import View
from arl_fixtures.twin.projection import Intrinsics, azimuth_elevation, pixel_rays
from arl_fixtures.twin.scene import Panel, SceneSettings, hit_wall

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_HEIGHTS_M = (0.10, 0.0, -0.10)
_MOST_VIEWS = 8_000
_TURNS_DEG = np.linspace(-1.5, 1.5, 31)
_LIFTS_DEG = np.linspace(-1.5, 1.5, 21)
_VARIANCES_PX2 = np.linspace(0.0, 1.5, 31)
_SAME_RAY_DEG = 0.1
_CHECKED = 400


@dataclass(frozen=True, slots=True)
class Rendering:
    """What every view (a pixel of a DUT at a stage angle) sees beside its own direction.

    Attributes:
        index: view of every row of the whole table.
        unit: distance unit over a metre.
        light, moment: (views, turns) relative light and light-weighted range over a turn of the bearing.
        light_up, moment_up: (views, lifts) the same over a lift of the elevation.
        fullness: (views,) mean light of the whole image over the mean of those pixels that the table holds.
    """

    index: IntArray
    unit: float
    light: FloatArray
    moment: FloatArray
    light_up: FloatArray
    moment_up: FloatArray
    fullness: FloatArray


def _soft(inside: FloatArray, width: FloatArray) -> FloatArray:
    """Covered share of a beamlet of `width` whose centre lies `inside` an edge."""
    return np.clip(inside / width + 0.5, 0.0, 1.0)


def _panel(
    panel: Panel, turn_rad: FloatArray, rays: FloatArray, height_m: FloatArray, spread: FloatArray
) -> FloatArray:
    """(coverage, light, range) of one panel; `spread` is the beamlet's angle across and upwards, (2, …)."""
    x, y, z = rays
    angle = np.radians(panel.azimuth_deg) + turn_rad
    cosine_a, sine_a = np.cos(angle), np.sin(angle)
    cosine = x * cosine_a + y * sine_a
    ahead = cosine > 0.05
    range_m = panel.radius_m / np.where(ahead, cosine, 1.0)
    aside, up = range_m * (y * cosine_a - x * sine_a), range_m * z + height_m - panel.centre_z_m
    wide, tall = spread[0] * range_m / np.maximum(cosine, 0.05), spread[1] * range_m
    cover = _soft(panel.width_m / 2 - np.abs(aside), wide) * _soft(panel.height_m / 2 - np.abs(up), tall) * ahead
    reflectance = np.full_like(cover, panel.reflectance)
    if panel.circles is not None:
        grid = panel.circles
        away = []
        for place, count in ((aside, grid.columns), (up, grid.rows)):
            middle = (count - 1) / 2
            away.append(
                place - (np.clip(np.rint(place / grid.pitch_m + middle), 0, count - 1) - middle) * grid.pitch_m
            )
        disc = _soft(grid.radius_m - np.hypot(*away), 0.5 * (wide + tall))
        reflectance = reflectance + disc * (grid.reflectance - panel.reflectance)
    return np.stack([cover, cover * reflectance * np.maximum(cosine, 0.0) / range_m**2, range_m])


def _see(
    rays: FloatArray, stage_deg: FloatArray, height_m: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Light and light-weighted range of rays (3, …) in the stage's frame: x ahead, y left, z up."""
    bench = SceneSettings()
    wall = hit_wall(bench.wall, rays, np.zeros(3))
    open_, light, moment = np.ones(rays.shape[1:]), np.zeros(rays.shape[1:]), np.zeros(rays.shape[1:])
    for panel in bench.panels:
        cover, share, range_m = _panel(panel, np.radians(stage_deg), rays, height_m, spread)
        open_ = open_ - cover
        light = light + share
        moment = moment + share * range_m
    behind = np.maximum(open_, 0.0) * bench.wall.reflectance * wall.cos_incidence / wall.range_m**2
    return light + behind, moment + behind * wall.range_m


def _subrays(u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(3, views, 9) rays in the stage's frame and (2, views, 9) angular size of a beamlet."""
    offsets = np.array([-1.0, 0.0, 1.0]) / 3.0
    across, along = (part.ravel() for part in np.meshgrid(offsets, offsets, indexing="ij"))
    rays = pixel_rays(Intrinsics(), u[:, None] + across, v[:, None] + along)
    spread = np.array([1.0 / Intrinsics().fx, 1.0 / Intrinsics().fy]) / 3.0
    return np.stack([rays[..., 2], -rays[..., 0], -rays[..., 1]]), np.broadcast_to(
        spread[:, None, None], (2, u.size, 9)
    )


def _turned(rays: FloatArray, turn_deg: float, lift_deg: float) -> FloatArray:
    """Rays that point `turn_deg` to the right and `lift_deg` higher."""
    x, y, z = rays
    level, angle = np.hypot(x, y), np.arctan2(y, x) - np.radians(turn_deg)
    height = np.arctan2(z, level) + np.radians(lift_deg)
    return np.stack([np.cos(height) * np.cos(angle), np.cos(height) * np.sin(angle), np.sin(height)])


def rendering(view: View) -> Rendering | None:
    """Rendering of the table's views; None where its simulation is not the nominal bench, or has too many views."""
    return per_table(view, "rendering", lambda: _make(view))


def _make(view: View) -> Rendering | None:
    table = view.columns
    needed = ("pixel_u", "pixel_v", "stage_angle_deg")
    if any(name not in table.numbers for name in needed) or not distances(view) or not signals(view):
        return None
    code = table.group("dut", *needed)
    first = np.zeros(int(code.max()) + 1, dtype=np.int64)
    if first.size > _MOST_VIEWS:
        return None
    first[code] = np.arange(table.n)
    u, v, stage = (table.numbers[name][first] for name in needed)
    if not (np.isfinite(u) & np.isfinite(v) & np.isfinite(stage)).all() or not _same_camera(view, first, u, v):
        return None
    unit = 1e3 if distances(view)[0].endswith("_mm") else 1.0
    device = table.group("dut")[first]
    heights = np.zeros(first.size)
    for dut in range(int(device.max()) + 1):
        mine = np.flatnonzero(device == dut)
        height = _height(view, first[mine], u[mine], v[mine], stage[mine], unit)
        if height is None:
            return None
        heights[mine] = height
    rays, spread = _subrays(u, v)
    angle, up = stage[:, None], heights[:, None]
    light, moment = np.zeros((first.size, _TURNS_DEG.size)), np.zeros((first.size, _TURNS_DEG.size))
    light_up, moment_up = np.zeros((first.size, _LIFTS_DEG.size)), np.zeros((first.size, _LIFTS_DEG.size))
    for place, turn in enumerate(_TURNS_DEG):
        seen = _see(_turned(rays, float(turn), 0.0), angle, up, spread)
        light[:, place], moment[:, place] = seen[0].mean(axis=1), seen[1].mean(axis=1)
    for place, lift in enumerate(_LIFTS_DEG):
        seen = _see(_turned(rays, 0.0, float(lift)), angle, up, spread)
        light_up[:, place], moment_up[:, place] = seen[0].mean(axis=1), seen[1].mean(axis=1)
    middle = light[:, _TURNS_DEG.size // 2]
    fullness = _fullness(
        np.unique(device * 1_000_000 + np.round(stage * 100.0), return_inverse=True)[1], u, v, stage, heights, middle
    )
    return Rendering(code, unit, light, moment, light_up, moment_up, fullness)


def _beam(u: FloatArray, v: FloatArray) -> FloatArray:
    az, el = (np.degrees(angle) for angle in azimuth_elevation(pixel_rays(Intrinsics(), u, v)))
    return np.asarray(np.exp(-((az / 75.0) ** 4) - (el / 18.0) ** 4))


def _fullness(
    frame: IntArray, u: FloatArray, v: FloatArray, stage: FloatArray, heights: FloatArray, light: FloatArray
) -> FloatArray:
    """Mean light of the nominal image (every fourth pixel) over the mean of the views of the same frame."""
    held = np.bincount(frame, light * _beam(u, v)) / np.bincount(frame)
    across, along = (
        part.ravel() for part in np.meshgrid(np.arange(1.5, 128, 4), np.arange(1.5, 32, 4), indexing="ij")
    )
    rays, spread = _subrays(across, along)
    rays, spread, beam = rays[:, :, 4], 12.0 * spread[:, :, 4], _beam(across, along)
    whole = np.zeros(held.size)
    for index in range(held.size):
        one = int(np.flatnonzero(frame == index)[0])
        seen, _ = _see(rays, np.full(across.size, stage[one]), np.full(across.size, heights[one]), spread)
        whole[index] = float(np.mean(seen * beam))
    return np.asarray((whole / np.maximum(held, 1e-300))[frame])


def _same_camera(view: View, rows: IntArray, u: FloatArray, v: FloatArray) -> bool:
    angles = azimuth_elevation(pixel_rays(Intrinsics(), u, v))
    for name, angle in zip(("azimuth_deg", "elevation_deg"), angles, strict=True):
        if name in view.columns.numbers:
            away = np.abs(view.columns.numbers[name][rows] - np.degrees(angle))
            if not np.nanmax(away) < _SAME_RAY_DEG:
                return False
    return True


def _height(view: View, rows: IntArray, u: FloatArray, v: FloatArray, stage: FloatArray, unit: float) -> float | None:
    """Height of a DUT at which the nominal bench looks like its simulation; None where at none."""
    pick = np.linspace(0, rows.size - 1, min(_CHECKED, rows.size)).astype(np.int64)
    rays, spread = _subrays(u[pick], v[pick])
    distance = view.columns.numbers[f"sim_{distances(view)[0]}"][rows[pick]] / unit
    signal = view.columns.numbers[f"sim_{signals(view)[0]}"][rows[pick]]
    az, el = (np.degrees(angle) for angle in azimuth_elevation(pixel_rays(Intrinsics(), u[pick], v[pick])))
    best: tuple[float, float] | None = None
    for height in _HEIGHTS_M:
        light, moment = (
            part.mean(axis=1) for part in _see(rays, stage[pick][:, None], np.full((pick.size, 1), height), spread)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            bright = np.log(signal / light) + (az / 75.0) ** 4 + (el / 18.0) ** 4
            away = np.abs(moment / light - distance)
        seen = np.isfinite(bright) & np.isfinite(away)
        if seen.sum() < 20:
            continue
        uneven = np.abs(bright - np.median(bright[seen]))[seen]
        if np.median(away[seen]) > 3e-3 or np.quantile(away[seen], 0.85) > 0.03 or np.median(uneven) > 0.03:
            continue
        misfit = float(np.mean(np.minimum(uneven, 0.5)) + np.mean(np.minimum(away[seen], 0.05)))
        best = (misfit, height) if best is None or misfit < best[0] else best
    return None if best is None else best[1]


def _between(curves: FloatArray, index: IntArray, nodes: FloatArray, wanted: FloatArray | float) -> FloatArray:
    place = np.clip((np.asarray(wanted) - nodes[0]) / (nodes[1] - nodes[0]), 0.0, nodes.size - 1.001)
    low = place.astype(np.int64)
    part = place - low
    flat, start = curves.ravel(), index * nodes.size + low
    left = flat[start]
    return np.asarray(left + part * (flat[start + 1] - left))


def rendered_elsewhere(
    view: View, turn: FloatArray | float, lift: FloatArray | float
) -> dict[str, FloatArray] | None:
    """Relative light and range of the rows' pixels with the bearing turned and the elevation lifted, by channel.

    Returns:
        Signals in a unit of their own, distances in theirs; None where nothing can be rendered.
    """
    found = rendering(view)
    if found is None:
        return None
    index = per_view(view, "rendered view", lambda: found.index[view.rows])
    light = _between(found.light, index, _TURNS_DEG, turn)
    moment = _between(found.moment, index, _TURNS_DEG, turn)
    if np.any(lift):
        middle = found.light[:, _TURNS_DEG.size // 2], found.moment[:, _TURNS_DEG.size // 2]
        light = light + _between(found.light_up, index, _LIFTS_DEG, lift) - middle[0][index]
        moment = moment + _between(found.moment_up, index, _LIFTS_DEG, lift) - middle[1][index]
    light = np.maximum(light, 1e-6)
    seen = dict.fromkeys(signals(view), light)
    return seen | dict.fromkeys(distances(view), moment / light * found.unit)


def blurred_render(view: View, variance_px2: FloatArray) -> dict[str, FloatArray] | None:
    """Relative light and range of the rows' pixels blurred by a Gaussian over the scene, by channel.

    Args:
        view: rows under work.
        variance_px2: variance of the blur in pixels squared, of every row.

    Returns:
        As `rendered_elsewhere`; None where nothing can be rendered.
    """
    found = rendering(view)
    if found is None:
        return None
    index = per_view(view, "rendered view", lambda: found.index[view.rows])
    parts = []
    for curves, lifted in ((found.light, found.light_up), (found.moment, found.moment_up)):
        wide, tall = _blurred(view, curves, _TURNS_DEG), _blurred(view, lifted, _LIFTS_DEG)
        middle = curves[:, _TURNS_DEG.size // 2][index]
        across = _between(wide, index, _VARIANCES_PX2, variance_px2)
        along = _between(tall, index, _VARIANCES_PX2, variance_px2)
        parts.append(across + along - middle)
    light = np.maximum(parts[0], 1e-6)
    seen = dict.fromkeys(signals(view), light)
    return seen | dict.fromkeys(distances(view), parts[1] / light * found.unit)


def _blurred(view: View, curves: FloatArray, nodes: FloatArray) -> FloatArray:
    return per_table(view, ("blurred", id(curves)), lambda: _blurs(curves, nodes))


def _blurs(curves: FloatArray, nodes: FloatArray) -> FloatArray:
    """(views, variances) curves blurred about their middle; a pixel is as wide as in the middle of the image."""
    pixel_deg = float(np.degrees(1.0 / Intrinsics().fx))
    step, middle = float(nodes[1] - nodes[0]) / pixel_deg, nodes.size // 2
    weights = []
    for variance in _VARIANCES_PX2:
        weight = ive(np.abs(np.arange(nodes.size) - middle), variance / step**2)
        weights.append(weight / weight.sum())
    return np.asarray(curves @ np.array(weights).T)


def whole_image(view: View) -> FloatArray | float:
    """Mean light of each row's whole image over that of the pixels that the table holds of it; 1 where not known."""
    found = rendering(view)
    return 1.0 if found is None else found.fullness[found.index[view.rows]]


def nearest_rendered(view: View) -> FloatArray | None:
    """Shortest range within a pixel's width of bearing, in the distances' unit; None where nothing can be "
    "rendered."""
    found = rendering(view)
    if found is None:
        return None
    near = np.abs(_TURNS_DEG) < 0.75
    shortest = (found.moment[:, near] / found.light[:, near]).min(axis=1) * found.unit
    return np.asarray(shortest[found.index[view.rows]])
