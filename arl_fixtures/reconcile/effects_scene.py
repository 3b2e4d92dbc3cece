"""What the simulation says a ray sees when it points elsewhere: illumination and scene, taken apart.

A pixel's signal is illumination(azimuth, elevation) times scene(bearing, row). The illumination is fitted as a smooth
exp(polynomial); the scene is what remains, as a curve over bearing (azimuth + stage angle) for each image row. Pixels
see the same bearing at many stage angles, each at another phase of the pixel grid: together they sample the scene
much finer than one sweep. Signals are divided by cos³(elevation) and distances multiplied by cos(elevation), which
leaves curves that depend on bearing alone for vertical surfaces. No re-rendering, no simulator needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import (
    distances,
    light_channels,
    per_table,
    per_view,
    set_light,
    signals,
)
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation, illumination, log_profile, ray_column
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FINEST_DEG = 0.05
_CELLS = 4_000_000
_BLOCKS = (4, 6, 8, 12, 16, 24, 32, 48, 64)
_CLOSE_DEG = 0.1


@dataclass(frozen=True, slots=True)
class Scene:
    """The simulated scene as curves over bearing.

    Attributes:
        bearing: of every row of the whole table, degrees.
        line: curve that a row lies on (an image row of one DUT).
        above, below: curve of the image row with the next higher and next lower elevation, −1 where there is none.
        pitch_deg: elevation between image rows.
        step_deg: bearing between points of a curve.
        sign: +1 where bearing = azimuth + stage angle, −1 where it is azimuth − stage angle.
    """

    bearing: FloatArray
    line: IntArray
    above: IntArray
    below: IntArray
    pitch_deg: float
    step_deg: float
    sign: float
    curves: dict[str, FloatArray]


def scene(view: View) -> Scene | None:
    """Scene of the table; None where nothing scans it (neither azimuth nor stage angle vary)."""
    return per_table(view, "scene", lambda: _make_scene(view))


def _make_scene(view: View) -> Scene | None:
    table = view.columns
    moving, rays = view.varies("stage_angle_deg"), view.varies("azimuth_deg")
    if not (moving or rays):
        return None
    az, el = ray_column(view, "azimuth_deg"), ray_column(view, "elevation_deg")
    stage = np.nan_to_num(table.numbers["stage_angle_deg"]) if moving else np.zeros(table.n)
    line = table.group("dut", "pixel_v") if rays else table.group("dut", "pixel_u", "pixel_v")
    device = _first_of(line, table.group("dut"))
    flat = {name: _flattened(view, name, el) for name in (*signals(view), *distances(view))}
    sign = 1.0
    if moving and rays and flat:
        test = next(iter(flat.values()))
        if _roughness(line, az - stage, test) < 0.8 * _roughness(line, az + stage, test):
            sign = -1.0
    bearing = az + sign * stage
    bearing = bearing - bearing.min()
    if moving and rays and "pixel_u" in table.numbers:
        row = line
        line = _blocks(row, table.numbers["pixel_u"], bearing)
        device = device[_first_of(line, row)]
    lines = int(line.max()) + 1
    step = max(_FINEST_DEG, float(bearing.max()) * lines / _CELLS)
    height = np.bincount(line, el, lines) / np.maximum(np.bincount(line, minlength=lines), 1)
    across = np.bincount(line, az, lines) / np.maximum(np.bincount(line, minlength=lines), 1)
    above, below, pitch = _stacked(height, across, device)
    weight = next((flat[name] for name in signals(view)), None)
    if weight is not None:  # light and light-weighted range are straight lines across an edge, the range is not
        flat |= {name: flat[name] * weight for name in distances(view)}
    curves = {name: curves_over_bearing(line, bearing / step, values, lines) for name, values in flat.items()}
    return Scene(bearing, line, above, below, pitch, step, sign, curves)


def _flattened(view: View, name: str, el: FloatArray) -> FloatArray:
    """A simulated channel without what the field of view does to it: a function of bearing for vertical surfaces."""
    values = view.columns.numbers[f"sim_{name}"]
    cos = np.cos(np.radians(el))
    if name in distances(view):
        return np.asarray(values * cos)
    profile = illumination(view, name)
    if profile is None:
        return np.asarray(values / cos**3)
    return np.asarray(values / (cos**3 * np.exp(profile.log(ray_column(view, "azimuth_deg"), el))))


def _roughness(line: IntArray, bearing: FloatArray, values: FloatArray) -> float:
    """Median absolute step between neighbours on a curve: small where the bearing is the right one."""
    good = np.flatnonzero(np.isfinite(values))
    order = good[np.lexsort((bearing[good], line[good]))]
    same = line[order][1:] == line[order][:-1]
    steps = np.abs(np.diff(values[order]))[same]
    return float(np.mean(steps)) if steps.size else 0.0


def _first_of(code: IntArray, values: IntArray) -> IntArray:
    """One value for every code 0…k−1."""
    found = np.zeros(int(code.max()) + 1, dtype=np.int64)
    found[code] = values
    return found


def _blocks(row: IntArray, column: FloatArray, bearing: FloatArray) -> IntArray:
    """Image rows cut into blocks of neighbouring columns, as narrow as a close sampling of the bearing allows.

    Pixels at the edge of the field are not as wide as those in the middle; within a block they are alike.
    """
    start = float(np.nanmin(column))
    wide = float(np.nanmax(column)) - start + 1.0
    sample = np.flatnonzero(row == np.bincount(row).argmax())
    for width in _BLOCKS:
        if width >= wide:
            break
        block = ((column[sample] - start) // width).astype(np.int64)
        order = np.lexsort((bearing[sample], block))
        same = np.diff(block[order]) == 0
        gaps = np.diff(bearing[sample][order])[same]
        gaps = gaps[gaps > 1e-6]
        if gaps.size and float(np.quantile(gaps, 0.9)) < _CLOSE_DEG:
            block = np.nan_to_num((column - start) // width).astype(np.int64)
            code: IntArray = np.unique(row * (int(wide / width) + 2) + block, return_inverse=True)[1].astype(np.int64)
            return code
    return row


def _stacked(height: FloatArray, across: FloatArray, device: IntArray) -> tuple[IntArray, IntArray, float]:
    """Lines next above and below each line of one device (within the same block of columns), and their distance."""
    place = np.round(across).astype(np.int64)
    order = np.lexsort((height, place, device))
    same = (device[order][1:] == device[order][:-1]) & (place[order][1:] == place[order][:-1])
    above = np.full(height.size, -1, dtype=np.int64)
    below = np.full(height.size, -1, dtype=np.int64)
    above[order[:-1][same]] = order[1:][same]
    below[order[1:][same]] = order[:-1][same]
    gaps = np.diff(height[order])[same]
    gaps = gaps[gaps > 1e-6]
    return above, below, float(np.median(gaps)) if gaps.size else 0.0


def curves_over_bearing(line: IntArray, place: FloatArray, values: FloatArray, lines: int) -> FloatArray:
    """Every line's curve on a regular grid, linear between the means of the samples that fall on one grid point."""
    good = np.flatnonzero(np.isfinite(values))
    width = int(np.ceil(place.max())) + 2
    cell = line[good] * width + np.rint(place[good]).astype(np.int64)
    count = np.bincount(cell, minlength=lines * width)
    at = np.bincount(cell, place[good], lines * width)
    total = np.bincount(cell, values[good], lines * width)
    grid = np.full((lines, width), np.nan)
    points = np.arange(width, dtype=float)
    for index in range(lines):
        part = slice(index * width, (index + 1) * width)
        known = np.flatnonzero(count[part])
        if known.size:
            weight = count[part][known]
            grid[index] = np.interp(points, at[part][known] / weight, total[part][known] / weight)
    return grid


def _look(found: Scene, line: IntArray, bearing: FloatArray) -> dict[str, FloatArray]:
    """All curves at the rows' line and bearing; beyond a curve's ends its last value."""
    width = next(iter(found.curves.values())).shape[1]
    place = np.clip(bearing * (1.0 / found.step_deg), 0.0, width - 1.001)
    low: IntArray = place.astype(np.int64)
    part = place - low
    low += line * width
    seen = {}
    for name, grid in found.curves.items():
        values = grid.ravel()
        left = values[low]
        seen[name] = left + part * (values[low + 1] - left)
    return seen


def _at(found: Scene, view: View, turn: FloatArray | float, lift: FloatArray | float) -> dict[str, FloatArray]:
    """Flattened channels at the rows' bearing + turn and elevation + lift (degrees)."""
    line, bearing = per_view(view, "scene place", lambda: (found.line[view.rows], found.bearing[view.rows]))
    seen = _look(found, line, bearing + turn)
    if found.pitch_deg > 0.0 and np.any(lift):
        rows = np.broadcast_to(np.asarray(lift) / found.pitch_deg, bearing.shape)
        other = np.where(rows > 0.0, found.above[line], found.below[line])
        beyond = _look(found, np.where(other < 0, line, other), bearing + turn)
        share = np.minimum(np.abs(rows), 2.0)
        for name, values in seen.items():
            mixed = values + share * (beyond[name] - values)
            seen[name] = np.where(np.isfinite(mixed), mixed, values)
    light = next((seen[name] for name in signals(view) if name in seen), None)
    if light is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            seen |= {name: seen[name] / light for name in distances(view) if name in seen}
    return seen


def footprint_share(view: View, belongs: FloatArray) -> FloatArray | None:
    """Share of each row's pixel, on the rows under work, in which something holds along the bearing.

    Args:
        view: rows under work.
        belongs: 1 where it holds for the ray through the pixel's centre, else 0; of every row of the whole table.

    Returns:
        Box average over the pixel's width; None where the table has no columns of pixels with an azimuth.
    """
    found = scene(view)
    if found is None or not (view.varies("azimuth_deg") and view.varies("pixel_u")):
        return None
    grid = curves_over_bearing(found.line, found.bearing / found.step_deg, belongs, int(found.line.max()) + 1)
    total = np.concatenate([np.zeros((grid.shape[0], 1)), np.cumsum(grid, axis=1)], axis=1)
    half = 0.5 * _pixel_width(view)[view.rows] / found.step_deg
    place, line = found.bearing[view.rows] / found.step_deg + 0.5, found.line[view.rows] * total.shape[1]

    def up_to(end: FloatArray) -> FloatArray:
        inside = np.clip(end, 0.0, total.shape[1] - 1.001)
        low: IntArray = inside.astype(np.int64)
        values = total.ravel()
        return np.asarray(values[line + low] + (inside - low) * (values[line + low + 1] - values[line + low]))

    share = (up_to(place + half) - up_to(place - half)) / np.maximum(2.0 * half, 1e-9)
    return np.asarray(np.clip(share, 0.0, 1.0))


def _pixel_width(view: View) -> FloatArray:
    """Azimuth from one pixel column to the next, for every row of the whole table; degrees."""
    table = view.columns
    column = np.nan_to_num(table.numbers["pixel_u"])
    known, index, count = np.unique(column, return_inverse=True, return_counts=True)
    mean = np.bincount(index, ray_column(view, "azimuth_deg")) / count
    slope = np.gradient(mean, known) if known.size > 1 else np.ones(1)
    return np.asarray(np.abs(slope)[index])


def _here(found: Scene, view: View) -> dict[str, FloatArray]:
    return per_view(view, "scene here", lambda: _at(found, view, 0.0, 0.0))


def scanned_channels(view: View) -> tuple[str, ...]:
    """Channels that move when a ray points elsewhere."""
    lit = [name for channel in signals(view) for name in light_channels(view, channel)]
    return tuple(dict.fromkeys([*distances(view), *lit]))


def point_elsewhere(
    view: View,
    state: State,
    *,
    turn: FloatArray | float = 0.0,
    lift: FloatArray | float = 0.0,
    beam_turns: bool = True,
) -> None:
    """Let every row see what lies `turn` degrees further in bearing and `lift` degrees higher.

    Args:
        view: rows under work.
        state: its signals and distances are replaced.
        turn, lift: change of the ray's direction, degrees; positive along azimuth and elevation.
        beam_turns: whether the illumination goes with the ray (a turned sensor) or stays (a changed lens).
    """
    found = scene(view)
    if found is None or not found.curves:
        return
    el = elevation(view)
    before, after = _here(found, view), _at(found, view, turn, lift)
    changed = np.cos(np.radians(el + lift)) / np.cos(np.radians(el))
    for name in found.curves:
        if name not in state:
            continue
        here, there = before[name], after[name]
        if name in distances(view):
            moved = (there / changed - here) / np.cos(np.radians(el))
            state[name] = state[name] + np.where(np.isfinite(moved), moved, 0.0)
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = there / here * changed**3
        if not beam_turns:
            profile = illumination(view, name)
            if profile is not None:
                az = azimuth(view)
                ratio = ratio * np.exp(profile.log(az + turn, el + lift) - log_profile(view, name))
        set_light(view, state, name, state[name] * np.clip(np.where(np.isfinite(ratio), ratio, 1.0), 0.01, 100.0))
