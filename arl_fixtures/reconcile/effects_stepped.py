"""A single beam's curve over a stage that steps by about the beam's width: each side of a jump is its own.

A straight line from the last sample before an edge to the first behind it says that a small turn changes what both
see. A beam that does not reach the edge sees its own surface, turned or not; only one that lies on the edge, between
two surfaces, changes by the share of it that the edge passes. How much of it either fills its own light tells; how
wide beams are no table says: of many edges as many lie in a beam as beams cover of the gaps between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray, IntArray

_JUMP, _JUMP_STEPS = 0.03, 8.0
"""Change of a quantity, as its logarithm, and usual steps between samples, from which a step is an edge."""
_STANDS_OUT = 4.0
"""How much larger an edge's step is than those beside it."""
_INSIDE, _BENDS = 0.02, 4.0
"""Share of a beam from which it is said to see a surface, and bends of a surface's curve beyond which it is none."""
_BEYOND = 0.1
"""Share of the step between two surfaces by which a beam on an edge may lie outside both."""
_MOST_MIXED = 2
HOLE = 1.7
"""Usual gaps between samples from which one is a hole, of which nothing is known."""
_THINNEST, _WIDEST = 0.1, 1.8
"""Width of beams in gaps between samples: the least, and from which samples tell edges by themselves."""


@dataclass(frozen=True, slots=True)
class _Curve:
    """Samples of one curve: its number, bearings in degrees, (n,), and logarithms of what they see, (k, n)."""

    line: int
    x: FloatArray
    logs: FloatArray

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Gaps between samples of which nothing is known, (n − 1,)."""
        gaps = np.diff(self.x)
        return np.asarray(gaps > HOLE * np.median(gaps))

    def onwards(self, anchor: int, way: int, at: FloatArray) -> FloatArray:
        """What the samples at an anchor and behind it say of others, (k, m): evenly, by the logarithm.

        Beside a hole, or at an end of the curve, the anchor alone: as it is.
        """
        behind, slope = anchor + way, np.zeros(len(self.logs))
        if 0 <= behind < self.x.size and not self.hole[min(anchor, behind)]:
            slope = (self.logs[:, behind] - self.logs[:, anchor]) / (self.x[behind] - self.x[anchor])
        return np.asarray(np.exp(self.logs[:, anchor, None] + slope[:, None] * (at - self.x[anchor])))

    def alone(self, end: int, other: int, way: int) -> int:
        """The sample next to an edge's end that does not see beyond it: what lies behind goes on to it."""
        behind, farthest = end + way, end + 3 * way
        if not 0 <= farthest < self.x.size or self.hole[min(end, farthest) : max(end, farthest)].any():
            return end
        seen = np.exp(self.logs)
        off = np.abs(self.onwards(behind, way, self.x[[end]])[:, 0] / seen[:, end] - 1.0)
        bend = np.abs(self.onwards(behind + way, way, self.x[[behind]])[:, 0] / seen[:, behind] - 1.0)
        over = np.abs(seen[:, other] / seen[:, end] - 1.0)
        return behind if np.any(off > np.maximum(_INSIDE * over, _BENDS * bend)) else end


@dataclass(frozen=True, slots=True)
class _Edge:
    """One edge on a curve.

    Attributes:
        left, right: the samples on either side that see one surface each; what lies between sees both.
        share: of the beams between that the left surface fills.
    """

    curve: _Curve
    left: int
    right: int
    share: FloatArray

    def sides(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What beams at some bearings would see of either surface alone, (k, m) each: as it was before the edge."""
        return self.curve.onwards(self.left, -1, at), self.curve.onwards(self.right, 1, at)

    def drawn(self, at: FloatArray, width: float) -> FloatArray:
        """Means over beams of a width at some bearings between the sides, (k, m)."""
        x = self.curve.x
        between, place = x[self.left + 1 : self.right], 0.5 * (x[self.left] + x[self.right])
        if between.size:  # else the middle, for want of better knowledge
            place = float(np.mean(between + (self.share - 0.5) * width))
        first, last = place - 0.5 * width, place + 0.5 * width
        known = (between > first) & (between < last)
        falling = np.minimum.accumulate(np.concatenate([[1.0], self.share[known], [0.0]]))
        share = np.interp(at, [first, *between[known], last], falling)
        one, other = self.sides(at)
        return np.asarray(share * one + (1.0 - share) * other)


def with_jumps(
    line: IntArray, bearing: FloatArray, values: dict[str, FloatArray], curves: dict[str, FloatArray], step_deg: float
) -> tuple[dict[str, FloatArray], NDArray[np.bool_]]:
    """Curves of beams with edges as sharp as the beams are.

    Args:
        line, bearing: of every row: its curve and its bearing in degrees.
        values: on all rows, positive; the first is light, whose shares add up.
        curves: straight between samples, (lines, points) each; step_deg: bearing between points.

    Returns:
        The curves, and the rows beside edges that were redrawn.
    """
    seen = np.stack(list(values.values()))
    good = np.flatnonzero(np.all(np.isfinite(seen) & (seen > 0.0), axis=0))
    beside = np.zeros(line.size, dtype=bool)
    edges: list[_Edge] = []
    gaps: list[float] = []
    for index in np.unique(line[good]):
        rows = good[line[good] == index]
        back = np.unique(np.rint(bearing[rows] / step_deg), return_inverse=True)[1].ravel()
        count = np.bincount(back)
        x = np.bincount(back, bearing[rows]) / count
        means = np.stack([np.bincount(back, one[rows]) / count for one in seen])
        if x.size > 4:
            edges += _edges(_Curve(int(index), x, np.log(means)))
            gaps.append(float(np.median(np.diff(x))))
    if not edges:
        return curves, beside
    gap = float(np.median(gaps))
    width = gap * max(float(np.mean([edge.share.size for edge in edges])) / (1.0 - 2.0 * _INSIDE), _THINNEST)
    if width > _WIDEST * gap:
        return curves, beside
    made = {name: grid.copy() for name, grid in curves.items()}
    for edge in edges:
        index, first, last = edge.curve.line, edge.curve.x[edge.left], edge.curve.x[edge.right]
        at: IntArray = np.arange(int(np.ceil(first / step_deg)), int(last / step_deg) + 1)
        for grid, row in zip(made.values(), edge.drawn(step_deg * at.astype(np.float64), width), strict=True):
            grid[index, at] = row
        beside |= (line == index) & (bearing >= first - step_deg) & (bearing <= last + step_deg)
    return made, beside


def _edges(curve: _Curve) -> list[_Edge]:
    """The edges of one curve that lie between two samples, or in few."""
    steps, hole = np.abs(np.diff(curve.logs, axis=1)), curve.hole
    least = np.maximum(_JUMP, _JUMP_STEPS * np.median(steps, axis=1))
    jump = np.any(steps > least[:, None], axis=0) & ~hole
    ends = np.flatnonzero(np.diff(np.concatenate([[0], jump, [0]])))
    beside = np.pad(np.where(hole, 0.0, steps), ((0, 0), (1, 1)))  # the steps before and after each sample
    found = []
    for first, last in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
        left, right = curve.alone(first, last, -1), curve.alone(last, first, 1)
        if right - left - 1 > _MOST_MIXED:
            continue
        over = np.abs(curve.logs[:, right] - curve.logs[:, left])
        outside = np.maximum(beside[:, left], beside[:, right + 1])
        if not np.any(over > np.maximum(least, _STANDS_OUT * outside)):
            continue
        one, other = _Edge(curve, left, right, np.empty(0)).sides(curve.x[left + 1 : right])
        share = (np.exp(curve.logs[0, left + 1 : right]) - other[0]) / (one[0] - other[0])
        if np.all((share > -_BEYOND) & (share < 1.0 + _BEYOND)):
            found.append(_Edge(curve, left, right, np.clip(share, 0.0, 1.0)))
    return found
