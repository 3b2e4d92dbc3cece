"""What a sensor that stands still is shown: one scene all the time, or another one in some images."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effects_common import distances
from arl_fixtures.reconcile.still_scene import ALIKE
from arl_fixtures.reconcile.view import View

BEYOND_DEG = 6.0
"""How far a curve goes on beyond the image on either side."""
_FEWEST_BENT = 4
_DIGITS = 3.0
"""Distances of a scene are told apart by their logarithm in steps of `ALIKE` times so many."""


def scenes_before_still(view: View) -> IntArray:
    """Code of the scene that each row of the whole table belongs to; all 0 where there is but one.

    A target on a rail, a board that is turned: the same pixel is simulated at another distance. Images in which all
    pixels keep their distances show the same scene. Where a pixel's distance changes within what the table tells to
    be an image, and at each level of every condition, nothing is told apart.
    """
    table, none = view.columns, np.zeros(view.columns.n, dtype=np.int64)
    far = distances(view)
    if not far or "pixel_u" not in table.numbers:
        return none
    simulated = table.numbers[f"sim_{far[0]}"]
    good = np.isfinite(simulated) & (simulated > 0.0)
    if not good.any():
        return none
    log = np.log(np.where(good, simulated, 1.0))
    pixel = table.group("dut", "pixel_u", "pixel_v")
    if apart(pixel, log, good) <= ALIKE:
        return none
    scene = next((code for code in _told(view) if apart(both(code, pixel), log, good) <= ALIKE), None)
    if scene is None:
        return none
    count = int(scene.max()) + 1
    mean = np.bincount(scene[good], log[good], count) / np.maximum(np.bincount(scene[good], minlength=count), 1)
    ranked = np.unique(np.rint(mean / (_DIGITS * ALIKE)).astype(np.int64), return_inverse=True)[1]
    return np.asarray(ranked[scene], dtype=np.int64)


def _told(view: View) -> Iterator[IntArray]:
    """What may tell scenes apart: images, else a condition that was set (a stand-off), those of few levels first."""
    table = view.columns
    yield table.group(*table.image_columns)
    images = table.n / max(int(table.group("dut", "pixel_u", "pixel_v").max()) + 1, 1)
    levels = {name: int(table.group(name).max()) + 1 for name in view.covariates() if not name.startswith("pixel_")}
    for name in sorted((n for n in levels if 1 < levels[n] <= images), key=lambda n: levels[n]):
        yield table.group(name)


def both(one: IntArray, other: IntArray) -> IntArray:
    """Code of the pairs of two codes, 0…k−1."""
    return np.asarray(np.unique(one * (int(other.max()) + 1) + other, return_inverse=True)[1], dtype=np.int64)


def apart(code: IntArray, values: FloatArray, good: np.ndarray) -> float:
    """Largest range of values within a group, but for the widest hundredth of the groups."""
    count = int(code.max()) + 1
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, code[good], values[good])
    np.maximum.at(high, code[good], values[good])
    seen = np.isfinite(low)
    return float(np.quantile(high[seen] - low[seen], 0.99))


def centred(code: IntArray, values: FloatArray, good: np.ndarray) -> FloatArray:
    """Values less the mean of the good ones within each group."""
    count = int(code.max()) + 1
    mean = np.bincount(code[good], values[good], count) / np.maximum(np.bincount(code[good], minlength=count), 1)
    return np.asarray(values - mean[code])


def smooth_curves(line: IntArray, place: FloatArray, values: FloatArray, lines: int) -> FloatArray:
    """Every line's curve on a regular grid, and beyond its ends: Akima's, through the means of equal places.

    A few pixels a row see a wall's range bend; a line from pixel to pixel would not (Akima, J. ACM 17 (1970) 589: no
    overshoot at edges).

    Args:
        line: of each row; place: on the grid; values: of each row; lines: their number.
    """
    good = np.flatnonzero(np.isfinite(values))
    beyond = int(np.floor(place.min()))
    width = int(np.ceil(place.max())) + beyond + 2
    cell = line[good] * width + np.rint(place[good]).astype(np.int64)
    count = np.bincount(cell, minlength=lines * width)
    at, total = np.bincount(cell, place[good], count.size), np.bincount(cell, values[good], count.size)
    grid, points = np.full((lines, width), np.nan), np.arange(width, dtype=float)
    for index in range(lines):
        part = slice(index * width, (index + 1) * width)
        known = np.flatnonzero(count[part])
        if known.size == 0:
            continue
        x, y = at[part][known] / count[part][known], total[part][known] / count[part][known]
        if known.size < _FEWEST_BENT:
            grid[index] = np.interp(points, x, y)
            continue
        reach = float(np.median(np.diff(x)))  # one pixel beyond the last
        inside = np.clip(points, x[0] - reach, x[-1] + reach)
        grid[index] = Akima1DInterpolator(x, y)(inside, extrapolate=True)
    return grid
