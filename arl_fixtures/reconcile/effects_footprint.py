"""A scene's curve between samples that lie a pixel apart: what each pixel averages, taken apart again.

A pixel shows the mean of the scene over its width. Where samples lie closer than a pixel the curve through them is
that mean, and a straight line between them will do. Where they lie a pixel apart (a stage that steps by whole pixels)
it will not: an edge inside one pixel would move the light of its neighbours, too. There the scene is estimated as the
one of least total variation whose means over pixels are the samples (Rudin, Osher and Fatemi, Physica D 60 (1992)
259; by iteratively reweighted least squares), which has its edges where the shares of light put them; the curve is
its mean over a pixel at every bearing, and passes through the samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from arl_fixtures.reconcile.columns import FloatArray, IntArray

COARSE, FARTHEST = 0.45, 3.0
"""Gap between samples, in pixels, from which a straight line between them is not the mean over a pixel, and beyond
which nothing is known of what lies between."""
SAME = 0.05
"""Difference of bearing, in pixels, below which samples count as one."""
POINTS = 10
"""Points of the scene across one pixel."""
ROUNDS = 25
TRUST = 1e4
"""Weight of the samples against the scene's variation."""
FLAT = 1e-3
"""Step between points, as a share of a curve's range, below which variation counts as a slope, not as an edge."""
_EXPLAINED = 0.5
"""Share of the step over a gap from which the slopes beside it count as what leads over it: the larger part."""


def sharp_curve(bearing: FloatArray, values: FloatArray, width: float, at: FloatArray) -> FloatArray:
    """Means over a pixel of scenes of least variation, whose means at some bearings are known.

    Edges are common to all quantities: what is the same on both sides keeps its ratio.

    Args:
        bearing: of the samples, ascending, degrees, (n,); values: the means there, (k, n).
        width: of a pixel, degrees.
        at: bearings that are asked for, degrees, (m,); beyond the samples the last value holds.

    Returns:
        The means there, (k, m).
    """
    spread = np.ptp(values, axis=1, keepdims=True)
    known = values / np.where(spread > 0.0, spread, 1.0)
    fine = width / POINTS
    start = float(bearing[0]) - 0.5 * width
    count = int(np.ceil((float(bearing[-1]) - start + 0.5 * width) / fine)) + 1
    first = np.clip(np.rint((bearing - start) / fine - 0.5 * POINTS).astype(np.int64), 0, count - POINTS)
    normal, score = np.zeros((POINTS + 1, count)), np.zeros((count, len(values)))
    for place in range(POINTS):  # upper bands: what lies `lag` above the diagonal in row POINTS − lag
        np.add.at(score, first + place, TRUST / POINTS * known.T)
        for lag in range(POINTS - place):
            np.add.at(normal[POINTS - lag], first + place + lag, TRUST / POINTS**2)
    places = start + fine * (np.arange(count) + 0.5)
    scene = np.stack([np.interp(places, bearing, row) for row in known], axis=1)
    for _ in range(ROUNDS):
        weight = 1.0 / (np.linalg.norm(np.diff(scene, axis=0), axis=1) + FLAT)
        bands = normal.copy()
        bands[POINTS] += 1e-9
        bands[POINTS, 1:] += weight
        bands[POINTS, :-1] += weight
        bands[POINTS - 1, 1:] -= weight
        scene = solveh_banded(bands, score, check_finite=False)
    total = np.concatenate([np.zeros((1, len(values))), np.cumsum(scene, axis=0)]) * fine
    edges = start + fine * np.arange(count + 1)
    inside = np.clip(at, bearing[0], bearing[-1])
    made = np.empty((len(values), len(at)))
    for row, sums in enumerate(total.T):
        there, here = (
            (np.interp(x + 0.5 * width, edges, sums) - np.interp(x - 0.5 * width, edges, sums)) / width
            for x in (inside, bearing)
        )
        made[row] = there + np.interp(inside, bearing, known[row] - here)  # through the samples
    return made * np.where(spread > 0.0, spread, 1.0)


@dataclass(frozen=True, slots=True)
class Cells:
    """Samples of curves that lie too far apart for straight lines between them.

    Attributes:
        rows: of the whole table, on such curves.
        line, bearing, code: of each of them: its curve, its bearing in degrees, and its cell of (nearly) one bearing.
        width: of a pixel on each curve, degrees; 0 where straight lines do.
    """

    rows: IntArray
    line: IntArray
    bearing: FloatArray
    code: IntArray
    width: FloatArray

    def mean(self, values: FloatArray) -> FloatArray:
        """Mean over each cell of values on all rows; NaN where none is known."""
        own = values[self.rows]
        known = np.isfinite(own)
        count = np.bincount(self.code, known, self._count)
        total = np.bincount(self.code, np.where(known, own, 0.0), self._count)
        return np.asarray(np.where(count > 0.0, total / np.maximum(count, 1.0), np.nan), dtype=np.float64)

    def scatter(self, values: FloatArray) -> FloatArray:
        """How far each row lies from the mean of its cell."""
        return np.asarray(np.abs(values[self.rows] - self.mean(values)[self.code]))

    @property
    def _count(self) -> int:
        return int(self.code.max()) + 1 if len(self.code) else 0

    def curves(
        self, straight: dict[str, FloatArray], values: dict[str, FloatArray], step_deg: float
    ) -> dict[str, FloatArray]:
        """Curves on their grid, (lines, points) each: the scene between such samples, others as given.

        Args:
            straight: straight between samples; step_deg: bearing between points.
            values: on all rows; the first are known wherever one of the others is.
        """
        if not len(self.rows):
            return straight
        made = {name: grid.copy() for name, grid in straight.items()}
        at: FloatArray = step_deg * np.arange(next(iter(straight.values())).shape[1], dtype=np.float64)
        first = np.unique(self.code, return_index=True)[1]
        line, bearing = self.line[first], self.bearing[first]
        means = np.stack([self.mean(values[name]) for name in made])
        for index in np.flatnonzero(self.width):
            here = np.flatnonzero((line == index) & np.isfinite(means[0]))
            here = here[np.argsort(bearing[here])]
            if here.size < 3:
                continue
            seen: FloatArray = np.stack([_filled(bearing[here], row[here], means[0][here]) for row in means])
            for grid, row in zip(
                made.values(), sharp_curve(bearing[here], seen, float(self.width[index]), at), strict=True
            ):
                grid[index] = row
        return made


def _filled(bearing: FloatArray, values: FloatArray, light: FloatArray) -> FloatArray:
    """Values with those that are not known in the ratio to light that their neighbours have."""
    known = np.isfinite(values) & (light != 0.0)
    if known.all() or not known.any():
        return values if known.all() else light
    ratio = np.interp(bearing, bearing[known], values[known] / light[known])
    return np.asarray(np.where(known, values, light * ratio), dtype=np.float64)


def cells_of(line: IntArray, bearing: FloatArray, width: FloatArray) -> Cells:
    """Cells of the curves whose samples lie far apart.

    Args:
        line, bearing, width: of every row: its curve, its bearing and the width of its pixel, degrees.
    """
    lines = int(line.max()) + 1
    wide = np.zeros(lines)
    for index in range(lines):
        rows = line == index
        pixel = float(np.median(width[rows]))
        if pixel <= 0.0:  # columns that look the same way
            continue
        gaps = np.diff(np.unique(np.rint(bearing[rows] / (SAME * pixel)))) * SAME
        wide[index] = pixel if gaps.size > 1 and COARSE < float(np.median(gaps)) <= FARTHEST else 0.0
    rows = np.flatnonzero(wide[line] > 0.0)
    place = np.rint(bearing[rows] / (SAME * wide[line[rows]])).astype(np.int64)
    joint = line[rows] * (int(place.max(initial=0)) + 1) + place
    code: IntArray = np.unique(joint, return_inverse=True)[1].astype(np.int64)
    return Cells(rows, line[rows], bearing[rows], code, wide)


def with_edges(
    line: IntArray,
    bearing: FloatArray,
    width: FloatArray,
    values: dict[str, FloatArray],
    curves: dict[str, FloatArray],
    step_deg: float,
) -> dict[str, FloatArray]:
    """Curves with an edge where neither sample beside a gap wider than a pixel leads over to the other.

    Rows of mixed pixels are often left out of a table: what is left beside the gap sees one surface by all of its
    area, and a straight line to the next one would move its light however far the edge is. The mean over a pixel of
    an edge between them is a ramp as wide as the pixel; it stands in the middle of the gap for want of better
    knowledge. Slopes tell a gap in what changes gradually: their mean times the gap is then the step over it.

    Args:
        line, bearing, width: of every row: its curve, its bearing and the width of its pixel, degrees.
        values: on all rows.
        curves: straight between samples, (lines, points) each; step_deg: bearing between points.
    """
    good = np.all([np.isfinite(one) for one in values.values()], axis=0)
    names = list(curves)
    made = np.stack([curves[name] for name in names])
    order = np.flatnonzero(good)
    order = order[np.lexsort((bearing[order], line[order]))]
    for rows in np.split(order, np.flatnonzero(np.diff(line[order])) + 1) if order.size else ():
        index, x, pixel = int(line[rows[0]]), bearing[rows], float(np.median(width[rows]))
        wide = np.flatnonzero(np.diff(x) > pixel)
        if pixel <= 0.0 or not wide.size:  # columns that look the same way, or no gap
            continue
        raw = np.stack([values[name][rows] for name in names])
        seen = raw / np.maximum(np.ptp(raw, axis=1, keepdims=True), 1e-12)
        for place in wide.tolist():
            first, last = float(x[place]), float(x[place + 1])
            over = seen[:, place + 1] - seen[:, place]
            before = _slope(x, seen, place, np.flatnonzero(x < first - 0.5 * pixel)[-1:])
            after = _slope(x, seen, place + 1, np.flatnonzero(x > last + 0.5 * pixel)[:1])
            slope = np.mean([*before, *after] or np.zeros((1, len(over))), axis=0)
            if (last - first) * float(slope @ over) > _EXPLAINED * float(over @ over):
                continue
            cell = np.rint(x / step_deg).astype(np.int64)
            near, far = int(cell[place]), int(cell[place + 1])
            ends = [raw[:, cell == end].mean(axis=1, keepdims=True) for end in (near, far)]
            at = step_deg * np.arange(near, far + 1) - 0.5 * (first + last)
            made[:, index, near : far + 1] = ends[0] + np.clip(at / pixel + 0.5, 0.0, 1.0) * (ends[1] - ends[0])
    return dict(zip(names, made, strict=True))


def _slope(x: FloatArray, seen: FloatArray, place: int, others: IntArray) -> list[FloatArray]:
    """Slope of each quantity between a sample and each other one."""
    return [(seen[:, other] - seen[:, place]) / (x[other] - x[place]) for other in others]
