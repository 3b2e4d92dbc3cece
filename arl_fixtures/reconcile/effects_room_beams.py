"""Beams and pixels in a line that see two surfaces: what a turn changes there.

They lie side by side and each is as wide as it sees, so one that crosses a border sees some of either surface. Its
neighbours on both sides tell what it would see of one alone, as far as light and range go on evenly; its own light
tells the share of each. A turn by δ moves the border by δ over the beam's width. How wide beams are no table tells:
of many borders as many lie in a beam as beams cover of the gaps between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import distances, pure_rows, signals
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.effects_room_borders import Borders
from arl_fixtures.reconcile.effects_scene import pixel_width
from arl_fixtures.reconcile.effects_still import both
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_JUMP, _JUMP_GAPS = 0.03, 8.0
"""Share of the range, and usual differences of neighbours, by which ranges jump from one surface to another."""
_CONTRAST = 0.05
"""Share of the light by which two surfaces must differ to tell how much a beam sees of either."""
_SURE = 0.05
"""Relative error up to which a range must be the mean of both surfaces' by light, or that of the one it shows."""
_INSIDE = 0.02
"""Share of a beam from which it is said to see a surface."""
_FEWEST = 6
"""Borders that must be seen to tell how wide beams are."""
_FILLED, _WIDEST = 0.3, 2.0
"""Least and most borders in beams for each border: thin beams of which few meet one by chance tell no share."""
_FARTHEST = 4
"""Beams from one that sees a surface alone to the next from which what lies between is not told."""
_SAME_DEG = 1e-3
"""Degrees, or pixels, within which beams are one."""
_BESIDE = 1.7
"""Usual gaps between beams within which two lie side by side."""


def borders_in_line(view: View, place: IntArray) -> Borders | None:
    """The borders in beams, or in pixels of image rows, that lie in one line.

    Args:
        view: of a table; place: where each row's sensor stands, as a number, (n,).

    Returns:
        None where beams do not lie in a line, where no signal tells shares, or where too few see two surfaces.
    """
    found = None
    if is_one_beam(view):
        found = sides_along(view, place, "stage_angle_deg")
    elif view.varies("azimuth_deg") and (view.varies("pixel_v") or not view.varies("elevation_deg")):
        found = sides_along(view, both(place, view.columns.group("stage_angle_deg", "pixel_v")), "azimuth_deg")
    if found is None:
        return None
    known = found.of_both
    filled = np.count_nonzero(known) / ((1.0 - 2.0 * _INSIDE) * max(np.unique(found.border[found.told]).size, 1))
    if np.count_nonzero(known) < _FEWEST or filled < _FILLED:
        return None
    width = found.gap * min(filled, _WIDEST)
    of_row = found.of_row(known)
    there = of_row >= 0

    def spread(values: FloatArray) -> FloatArray:
        return np.asarray(np.where(there, np.nan_to_num(values)[of_row], 0.0))

    turned = spread(np.full(known.size, -1.0 / width))  # off the left surface
    kinds = [{n: spread(one) for n, one in side.light.items()} for side in (found.left, found.right)]
    for side in (found.left, found.right):  # ranges that the simulation does not mix stay as they are
        kinds.append({n: spread(np.where(found.mean[n], one, 1.0)) for n, one in side.far.items()})
    return Borders(there, np.column_stack([turned, np.zeros_like(turned)]), spread(found.share), *kinds)


def is_one_beam(view: View) -> bool:
    """Whether one beam, without pixels, is turned by a stage: its line is what it sees at one angle after another."""
    rays = ("azimuth_deg", "elevation_deg", "pixel_u", "pixel_v")
    return view.varies("stage_angle_deg") and not any(map(view.varies, rays))


def sees_one(view: View, place: IntArray) -> BoolArray:
    """Rows of the whole table at which one beam that a stage turns sees one surface, as the jumps of its range tell.

    A range between those of the angles before and after, and far from both, is that of none; and what lies between a
    jump and a gap says nothing of how its surface leans. Where no light tells shares every range is a surface's: it
    may be that of a narrow board.

    Args:
        view: of a table; place: where each row's sensor stands, as a number, (n,).
    """
    alone, angle = np.ones(view.columns.n, dtype=bool), ray_column(view, "stage_angle_deg")
    far = view.columns.numbers[f"sim_{distances(view)[0]}"]
    rows, of_row = _each_once(place, angle, np.isfinite(far) & (far > 0.0))
    if rows.size < _FEWEST or not signals(view):
        return alone
    beams = _Beams(view, rows, place[rows], angle[rows], "stage_angle_deg")
    step = np.where(np.diff(beams.line) == 0, np.diff(np.log(far[rows])), 0.0)
    before, after = np.concatenate([[0.0], step]), np.concatenate([step, [0.0]])
    unsure = (before * after > 0.0) | ((before == 0.0) != (after == 0.0))
    return np.asarray(np.append(beams.pure | ~unsure, True)[of_row])


@dataclass(frozen=True, slots=True)
class Sides:
    """What beams between two that see one surface each would see of either alone; (m,) each.

    Attributes:
        left, right: either side, by the line's coordinate.
        share: of each beam that the left surface fills, by the first signal.
        told: where light tells it, and the range is one of both or their mean by light.
        mean: by distance, where it is the mean.
        border: which beams lie at the same one, as numbers; gap: usual one between beams, in the line's coordinate.
        beam: of the line's beams, and which of these each row of the whole table is, −1 where none.
    """

    left: _Side
    right: _Side
    share: FloatArray
    told: BoolArray
    mean: dict[str, BoolArray]
    border: IntArray
    gap: float
    beam: IntArray
    beam_of_row: IntArray

    @property
    def of_both(self) -> BoolArray:
        """Beams that see both surfaces, of which it is told how much."""
        return np.asarray(self.told & (self.share > _INSIDE) & (self.share < 1.0 - _INSIDE))

    def of_row(self, which: BoolArray) -> IntArray:
        """Which of the chosen sides each row of the whole table has; −1 where none."""
        back = np.full(int(self.beam_of_row.max()) + 2, -1)
        back[self.beam[which]] = np.flatnonzero(which)
        return np.asarray(back[self.beam_of_row])


def sides_along(view: View, line: IntArray, axis: str) -> Sides | None:
    """The two sides of all beams along lines that may see two surfaces; None where there are few.

    Args:
        view: of a table; line: that each row lies on, as a number, (n,).
        axis: column of the bearing, degrees, or of pixels, along it.
    """
    table = view.columns
    if not signals(view):
        return None
    seen = {name: table.numbers[f"sim_{name}"] for name in (*signals(view), *distances(view))}
    good = np.all([np.isfinite(values) & (values > 0.0) for values in seen.values()], axis=0)
    place = ray_column(view, axis) if axis.endswith("_deg") else np.nan_to_num(table.numbers[axis])
    rows, beam_of_row = _each_once(line, place, good)
    if rows.size < _FEWEST:
        return None
    beams = _Beams(view, rows, line[rows], place[rows], axis)
    beam, left, right = beams.between()
    if beam.size < _FEWEST:
        return None
    logs = {name: np.log(seen[name][rows]) for name in signals(view)}
    inverse = {name: 1.0 / seen[name][rows] for name in distances(view)}
    one, other = (_Side.of(beams, beam, anchor, logs, inverse) for anchor in (left, right))
    share, told, mean = _shares(one, other)
    return Sides(one, other, share, told, mean, left, beams.gap, beam, beam_of_row)


def _each_once(line: IntArray, place: FloatArray, good: BoolArray) -> tuple[IntArray, IntArray]:
    """One row of each different beam, by line and place on it, and which of these each row is; −1 where none."""
    level = np.unique(np.rint(place / _SAME_DEG), return_inverse=True)[1].ravel()
    key = both(line, level.astype(np.int64))
    found, first = np.unique(np.where(good, key, -1), return_index=True)
    first = first[found >= 0]
    rows = first[np.lexsort((place[first], line[first]))]
    number = np.full(int(key.max()) + 1, -1)
    number[key[rows]] = np.arange(rows.size)
    return np.asarray(rows, dtype=np.int64), np.asarray(number[key])


class _Beams:
    """Beams in the order of their bearing, line by line; (k,) each."""

    def __init__(self, view: View, rows: IntArray, line: IntArray, place: FloatArray, axis: str) -> None:
        table = view.columns
        self.place = place
        beside, apart = np.diff(line) == 0, np.diff(place)
        self.gap = float(np.median(apart[beside])) if beside.any() else 0.0
        if axis.startswith("pixel_"):
            beside &= apart == 1.0
        elif axis == "azimuth_deg" and "pixel_u" in table.numbers:
            self.gap = float(np.median(pixel_width(view)))
            beside &= np.abs(np.diff(table.numbers["pixel_u"][rows])) == 1.0
        beside &= apart < _BESIDE * self.gap
        self.line = np.concatenate([[0], np.cumsum(~beside)])
        self.surface, self.pure = _surfaces(view, rows, beside)
        self.told = "mixed" in table.categories or "surface" not in table.categories

    def between(self) -> tuple[IntArray, IntArray, IntArray]:
        """Beams that may see two surfaces, and the nearest on either side that see one each."""
        if self.told:
            alone = np.flatnonzero(self.pure)
            apart = np.diff(alone)
            near = (apart < _FARTHEST) & (self.line[alone[1:]] == self.line[alone[:-1]])
            left, right = alone[:-1][near], alone[1:][near]
            after = np.minimum(right + 1, self.line.size - 1)
            clean = (left + 1 == right) & (self.surface[left] != self.surface[right]) & self._same(right, after)
            right = np.where(clean, after, right)  # a border that lies in no beam counts as well
            left, right = left[left + 1 < right], right[left + 1 < right]
        else:
            last = np.flatnonzero((self.line[1:] == self.line[:-1]) & (self.surface[1:] != self.surface[:-1]))
            last = last[(last >= 1) & (last + 2 < self.line.size)]
            left, right = last - 1, last + 2
            whole = self._same(left, last) & self._same(last + 1, right)
            left, right = left[whole], right[whole]
        steps = [np.flatnonzero(left + step < right) for step in (1, 2)]
        pick = np.concatenate(steps)
        beam = np.concatenate([left[at] + step for step, at in zip((1, 2), steps, strict=True)])
        return beam, left[pick], right[pick]

    def _same(self, one: IntArray, other: IntArray) -> BoolArray:
        return np.asarray((self.line[one] == self.line[other]) & (self.surface[one] == self.surface[other]))

    def onwards(self, values: FloatArray, anchor: IntArray, beam: IntArray) -> FloatArray:
        """What the beams at an anchor and behind it say of a beam: on a straight line where both see one surface."""
        way = np.sign(anchor - beam)
        behind = np.clip(anchor + way, 0, self.line.size - 1)
        alike = self._same(anchor, behind) & self.pure[behind] & (behind != anchor)
        with np.errstate(invalid="ignore", divide="ignore"):
            slope = (values[behind] - values[anchor]) / (self.place[behind] - self.place[anchor])
        slope = np.where(alike & np.isfinite(slope), slope, 0.0)
        return np.asarray(values[anchor] + slope * (self.place[beam] - self.place[anchor]))


def _surfaces(view: View, rows: IntArray, beside: BoolArray) -> tuple[IntArray, BoolArray]:
    """Which surface each beam sees, as numbers, and whether that is all it sees.

    As it is said, else from a jump of the ranges to the next: a beam between two jumps sees some of both sides.
    """
    table = view.columns
    if "surface" in table.categories:
        return np.asarray(table.categories["surface"][0][rows]), pure_rows(view)[rows]
    if not distances(view) or not beside.any():
        return np.zeros(rows.size, dtype=np.int64), pure_rows(view)[rows]
    jump = np.abs(np.diff(np.log(table.numbers[f"sim_{distances(view)[0]}"][rows])))
    ends = ~beside | (jump > max(_JUMP, _JUMP_GAPS * float(np.median(jump[beside]))))
    between = np.concatenate([[True], ends]) & np.concatenate([ends, [True]])
    return np.concatenate([[0], np.cumsum(ends)]), pure_rows(view)[rows] & ~between


@dataclass(frozen=True, slots=True)
class _Side:
    """What beams would see of one surface alone, in units of what they see; by signal and distance, (m,)."""

    light: dict[str, FloatArray]
    far: dict[str, FloatArray]

    @classmethod
    def of(
        cls, beams: _Beams, beam: IntArray, anchor: IntArray, logs: dict[str, FloatArray],
        inverse: dict[str, FloatArray],
    ) -> _Side:  # fmt: skip
        with np.errstate(invalid="ignore", divide="ignore"):
            light = {n: np.exp(beams.onwards(log, anchor, beam) - log[beam]) for n, log in logs.items()}
            far = {n: one[beam] / beams.onwards(one, anchor, beam) for n, one in inverse.items()}
        return cls(light, {n: np.where(one > 0.0, one, np.nan) for n, one in far.items()})


def _shares(left: _Side, right: _Side) -> tuple[FloatArray, BoolArray, dict[str, BoolArray]]:
    """`Sides.share`, `told` and `mean`."""
    a, b = (next(iter(side.light.values())) for side in (left, right))
    mean: dict[str, BoolArray] = {}
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (1.0 - b) / (a - b)
        told = np.abs(a - b) > _CONTRAST
        for name, near in left.far.items():
            far = right.far[name]
            of_both = np.abs(share * a * near + (1.0 - share) * b * far - 1.0)
            of_one = np.minimum(np.abs(near - 1.0), np.abs(far - 1.0))
            mean[name] = of_both <= of_one
            told &= np.minimum(of_both, of_one) < _SURE
    return np.asarray(share), np.asarray(told), mean
