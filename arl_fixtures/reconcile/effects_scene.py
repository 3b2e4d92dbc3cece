"""The scene that a table's simulation shows, found from the table alone: illumination and scene, taken apart.

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

from arl_fixtures.reconcile.effects_common import distances, per_table, pure_rows, signals
from arl_fixtures.reconcile.effects_footprint import cells_of, with_edges
from arl_fixtures.reconcile.effects_illumination import illumination, ray_column
from arl_fixtures.reconcile.effects_scenes import scenes_shown
from arl_fixtures.reconcile.effects_stepped import HOLE, with_jumps
from arl_fixtures.reconcile.effects_still import BEYOND_DEG, both, smooth_curves
from arl_fixtures.reconcile.effects_sweep import bend_of_sweeps
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FINEST_DEG = 0.05
_CELLS = 4_000_000
_BLOCKS = (4, 6, 8, 12, 16, 24, 32, 48, 64)
_CLOSE_DEG, _CLOSE_SHARE, _ROW_SHARE = 0.1, 0.1, 1.3  # shares of a pixel's width, over which it averages what it sees
_NEAR = 9
_ROUGH = 0.01
_SHARED = 0.2
"""Share of a curve's rays that must lie beneath another one to tell whether surfaces stand upright."""
_FLATTER = 0.9
"""Share of the steps between samples of a line, below which the signal without a profile is taken for the scene."""
_UNLIKE = 0.01
"""Mean relative step of the range between samples of a curve from which they do not lie on one."""
_WORSE = 0.25  # between two angles a cubic errs by less than a quarter of the bend


@dataclass(frozen=True, slots=True)
class Scene:
    """The simulated scene as curves over bearing.

    Attributes:
        bearing: of every row of the whole table, degrees.
        line: curve that a row lies on (an image row of one DUT).
        above, below: curve of the image row with the next higher and next lower elevation, −1 where there is none.
        pitch_deg: elevation between image rows.
        step_deg: bearing between points of a curve.
        patchy: rows of the whole table where pixels of one curve do not agree.
        upright: whether rays of several elevations share the curves and agree: surfaces stand upright.
        sign: +1 where bearing = azimuth + stage angle, −1 where it is azimuth − stage angle.
        still: whether no stage turns the sensor: curves then go on beyond the image as they end in it.
    """

    bearing: FloatArray
    line: IntArray
    above: IntArray
    below: IntArray
    pitch_deg: float
    step_deg: float
    sign: float
    patchy: NDArray[np.bool_]
    upright: bool
    curves: dict[str, FloatArray]
    still: bool = False


def scene(view: View) -> Scene | None:
    """Scene of the table; None where nothing scans it (neither azimuth nor stage angle vary)."""
    return per_table(view, "scene", lambda: _make_scene(view))


def sweeps_pixels(view: View) -> bool:
    """Whether a stage sweeps pixels whose columns and bearings are known."""
    return all(map(view.varies, ("stage_angle_deg", "azimuth_deg", "pixel_u")))


def _make_scene(view: View) -> Scene | None:
    table = view.columns
    moving, rays = view.varies("stage_angle_deg"), view.varies("azimuth_deg")
    if not (moving or rays):
        return None
    az, el = ray_column(view, "azimuth_deg"), ray_column(view, "elevation_deg")
    stage = np.nan_to_num(table.numbers["stage_angle_deg"]) if moving else np.zeros(table.n)
    flat = {name: _flattened(view, name, el) for name in (*signals(view), *distances(view))}
    sign = 1.0
    row = table.group("dut", "pixel_v" if "pixel_v" in table.numbers else "elevation_deg")
    if moving and rays and flat:
        name = next(iter(flat))
        tests = [flat[name], *([_bare(view, name, el)] if name in signals(view) else [])]
        back, forth = (min(_roughness(row, az + way * stage, test) for test in tests) for way in (-1.0, 1.0))
        sign = -1.0 if back < 0.8 * forth else 1.0
    bearing = az + sign * stage
    if moving and rays:
        flat |= {name: _likelier(view, name, row, bearing, flat[name], el) for name in signals(view)}
    bearing = bearing - bearing.min()
    still = rays and not moving
    if still:
        bearing = bearing + BEYOND_DEG
    line = _lines(view, bearing) if rays else table.group("dut", "pixel_u", "pixel_v")
    shown = scenes_shown(view)
    line = both(line, shown)
    device = _first_of(line, both(table.group("dut"), shown))
    lines = int(line.max()) + 1
    step = max(_FINEST_DEG, (float(bearing.max()) + BEYOND_DEG * still) * lines / _CELLS)
    height = np.bincount(line, el, lines) / np.maximum(np.bincount(line, minlength=lines), 1)
    across = np.bincount(line, az, lines) / np.maximum(np.bincount(line, minlength=lines), 1)
    above, below, pitch = _stacked(height, across, device)
    upright = all(_is_upright(line, np.rint(bearing / step), el, values) for values in flat.values())
    weight = next((flat[name] for name in signals(view)), None)
    if weight is not None:  # light and light-weighted range are straight lines across an edge, the range is not
        flat |= {name: _extended(line, bearing, flat[name]) * weight for name in distances(view)}
    drawn = smooth_curves if still else curves_over_bearing
    curves = {name: drawn(line, bearing / step, values, lines) for name, values in flat.items()}
    if moving and rays and "pixel_u" in table.numbers:
        curves = with_edges(line, bearing, pixel_width(view), flat, curves, step)
    patchy = np.zeros(table.n, dtype=bool)
    if weight is not None:
        bend = bend_of_sweeps(view) * weight
        patchy = _patchy(line, bearing, weight, bend)
        if moving and rays and "pixel_u" in table.numbers:
            cells = cells_of(line, bearing, pixel_width(view))
            curves = cells.curves(curves, flat, step)
            allowed = np.fmax(_WORSE * np.abs(bend), _ROUGH * np.abs(weight))[cells.rows]
            patchy[cells.rows] = cells.scatter(weight) > allowed
        if moving and not rays:
            curves = with_edges(line, bearing, HOLE * gaps_of(line, bearing)[line], flat, curves, step)
            curves, beside = with_jumps(line, bearing, flat, curves, step)
            patchy &= ~beside
        patchy &= np.isfinite(bend)  # a sweep that lacks an angle tells nothing of what lies there
    return Scene(bearing, line, above, below, pitch, step, sign, patchy, upright, curves, still)


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


def _likelier(
    view: View, name: str, row: IntArray, bearing: FloatArray, flat: FloatArray, el: FloatArray
) -> FloatArray:
    """A flattened signal, or the signal as it is where pixels that see the same bearing then agree better.

    Where the table does not tell surfaces apart, the profile that was fitted may be the scene's.
    """
    bare = _bare(view, name, el)
    return bare if _roughness(row, bearing, bare) < _FLATTER * _roughness(row, bearing, flat) else flat


def _bare(view: View, name: str, el: FloatArray) -> FloatArray:
    """A signal of which only the rays' elevation is taken out, as if nothing but the surfaces shaped it."""
    return np.asarray(view.columns.numbers[f"sim_{name}"] / np.cos(np.radians(el)) ** 3)


def _extended(line: IntArray, bearing: FloatArray, values: FloatArray) -> FloatArray:
    """Values of which those not known are their nearest neighbour's on the curve: no surface lies between two."""
    order = np.lexsort((bearing, line))
    known = np.isfinite(values[order])
    rank = np.arange(order.size)
    before = np.maximum.accumulate(np.where(known, rank, -1))
    after = np.minimum.accumulate(np.where(known, rank, order.size)[::-1])[::-1]
    far = [
        np.where((place >= 0) & (place < order.size), np.abs(bearing[order[side]] - bearing[order]), np.inf)
        + np.where(line[order[side]] == line[order], 0.0, np.inf)
        for place in (before, after)
        for side in (np.clip(place, 0, order.size - 1),)
    ]
    source = np.clip(np.where(far[0] <= far[1], before, after), 0, order.size - 1)
    filled = values.copy()
    filled[order] = np.where(np.isfinite(np.fmin(*far)), values[order[source]], np.nan)
    return filled


def _roughness(line: IntArray, bearing: FloatArray, values: FloatArray) -> float:
    """Mean relative step between neighbours on a curve: small where the bearing is the right one."""
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.log(values)
    good = np.flatnonzero(np.isfinite(values))
    order = good[np.lexsort((bearing[good], line[good]))]
    same = line[order][1:] == line[order][:-1]
    steps = np.abs(np.diff(values[order]))[same]
    return float(np.mean(steps)) if steps.size else 0.0


def _patchy(line: IntArray, bearing: FloatArray, light: FloatArray, bend: FloatArray) -> NDArray[np.bool_]:
    """Rows about which a curve predicts its samples from their neighbours worse than a pixel's own sweep (`bend`).

    There pixels that look the same way do not see the same: a pattern, or another height.
    """
    good = np.flatnonzero(np.isfinite(light))
    if good.size == 0 or not np.isfinite(bend[good]).any():
        return np.zeros(light.size, dtype=bool)
    order = good[np.lexsort((bearing[good], line[good]))]
    x, y, code = bearing[order], light[order], line[order]
    first = np.concatenate([[0], np.flatnonzero((np.diff(x) > 1e-6) | (np.diff(code) != 0)) + 1])  # one of each angle
    count = np.diff(np.append(first, x.size))
    x, y, code = x[first], np.add.reduceat(y, first) / count, code[first]
    off, level = np.zeros(x.size), np.abs(y)
    if x.size > 2:
        inner = (code[2:] == code[:-2]) & (x[2:] > x[:-2])
        share = (x[1:-1] - x[:-2]) / np.where(inner, x[2:] - x[:-2], 1.0)
        off[1:-1] = np.where(inner, np.abs(y[1:-1] - y[:-2] - share * (y[2:] - y[:-2])), 0.0)
    own = bend[order][first]
    known = np.isfinite(own)  # not where the sweep lacks an angle
    own = _WORSE * _smoothed(np.where(known, np.abs(own), 0.0)) / np.maximum(_smoothed(known * 1.0), 1e-9)
    rough = _smoothed(off) > np.maximum(own, _ROUGH * _smoothed(level))
    patchy = np.zeros(light.size, dtype=bool)
    patchy[order] = np.repeat(rough, count)
    return patchy


def _smoothed(values: FloatArray) -> FloatArray:
    """Mean over `_NEAR` samples, zeros beyond the ends; a sweep may hold fewer samples than are averaged."""
    half = _NEAR // 2
    return np.asarray(np.convolve(values, np.full(_NEAR, 1.0 / _NEAR))[half : half + values.size])


def _is_upright(line: IntArray, place: FloatArray, el: FloatArray, values: FloatArray) -> bool:
    """Whether rays of several elevations that share a place on a curve see the same there: surfaces stand upright."""
    good = np.flatnonzero(np.isfinite(values) & (values > 0.0))
    if not good.size:
        return False
    order = good[np.lexsort((el[good], place[good], line[good]))]
    pair = (line[order][1:] == line[order][:-1]) & (place[order][1:] == place[order][:-1])
    pair &= el[order][1:] > el[order][:-1]
    steps = np.abs(np.diff(np.log(values[order])))[pair]
    return bool(steps.size > _SHARED * order.size and np.quantile(steps, 0.9) < _ROUGH)


def _first_of(code: IntArray, values: IntArray) -> IntArray:
    """One value for every code 0…k−1."""
    found = np.zeros(int(code.max()) + 1, dtype=np.int64)
    found[code] = values
    return found


def _lines(view: View, bearing: FloatArray) -> IntArray:
    """Which rows share a curve: as few pixels as still sample the bearing closely.

    From blocks of columns of one image row (pixels at the edge of the field are not as wide as those in the middle)
    over image rows and blocks of rows to all pixels of a DUT (a table of a few pixels only).
    """
    table = view.columns
    row, device = table.group("dut", "pixel_v"), table.group("dut")
    close, whole = _CLOSE_DEG, 2.5 * _CLOSE_DEG
    if "pixel_u" in table.numbers:
        pixel = float(np.median(pixel_width(view)))
        close, whole = max(close, _CLOSE_SHARE * pixel), max(whole, _ROW_SHARE * pixel)
        column = np.nan_to_num(table.numbers["pixel_u"] - np.nanmin(table.numbers["pixel_u"]))
        for width in _BLOCKS:
            if width < float(column.max()):
                line = both(row, (column // width).astype(np.int64))
                if gap_of(line, bearing) < close:
                    return line
    if gap_of(row, bearing) < whole or "pixel_v" not in table.numbers:
        return row
    height = np.nan_to_num(table.numbers["pixel_v"] - np.nanmin(table.numbers["pixel_v"]))
    for width in (4, 8):
        line = both(device, (height // width).astype(np.int64))
        if gap_of(line, bearing) < 2.5 * close:
            return line
    return device


def pixel_width(view: View) -> FloatArray:
    """Azimuth from one pixel column to the next, for every row of the whole table; degrees."""
    table = view.columns
    column = np.nan_to_num(table.numbers["pixel_u"])
    known, index, count = np.unique(column, return_inverse=True, return_counts=True)
    mean = np.bincount(index, ray_column(view, "azimuth_deg")) / count
    slope = np.gradient(mean, known) if known.size > 1 else np.ones(1)
    return np.asarray(np.abs(slope)[index])


def joins_unlike_rows(view: View, found: Scene) -> bool:
    """Whether curves join image rows, and do not tell what lies beside a ray: rows that see different things.

    Or rows of which all that see two surfaces are left out: across an edge no curve has a sample then.
    """
    table = view.columns
    if "pixel_v" not in table.numbers or not distances(view):
        return False
    if int(found.line.max()) + 1 >= int(table.group("dut", "pixel_v").max()) + 1:
        return False
    if pure_rows(view).all():
        return True
    flat = _flattened(view, distances(view)[0], ray_column(view, "elevation_deg"))
    return _roughness(found.line, found.bearing, flat) > _UNLIKE


def gap_of(line: IntArray, bearing: FloatArray, share: float = 0.9) -> float:
    """Bearing between samples of one curve that a share of the gaps stay below, degrees."""
    _, gaps = _gaps(line, bearing)
    return float(np.quantile(gaps, share)) if gaps.size else np.inf


def gaps_of(line: IntArray, bearing: FloatArray) -> FloatArray:
    """Bearing between the samples of each curve, degrees: the median of its gaps, 0 where it has none."""
    of, gaps = _gaps(line, bearing)
    ranked = np.append(gaps[np.lexsort((gaps, of))], 0.0)
    size = np.bincount(of, minlength=int(line.max()) + 1)
    first = np.cumsum(size) - size
    middle = 0.5 * (ranked[first + np.maximum(size - 1, 0) // 2] + ranked[first + size // 2])
    return np.asarray(np.where(size > 0, middle, 0.0))


def _gaps(line: IntArray, bearing: FloatArray) -> tuple[IntArray, FloatArray]:
    """Bearings between neighbouring samples of one curve, degrees, and the curves that they are of."""
    order = np.lexsort((bearing, line))
    gaps = np.diff(bearing[order])
    there = (np.diff(line[order]) == 0) & (gaps > 1e-6)
    return line[order][1:][there], gaps[there]


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
