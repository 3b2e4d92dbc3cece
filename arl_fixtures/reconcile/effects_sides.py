"""Both sides of a border: the nearest rows that show alone what a pixel with two surfaces sees of either."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_view, pure_rows
from arl_fixtures.reconcile.effects_scene import pixel_width
from arl_fixtures.reconcile.effects_smooth import along_surface
from arl_fixtures.reconcile.effects_surface import beyond_surface, mixed_rows
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

IntArray = NDArray[np.int64]
_CONTRAST = 0.05
"""Share of the light by which two surfaces must differ to tell how much a pixel sees of either."""
OFF = 0.1
"""Part by which the light may lie outside that of both surfaces: nowhere is it quite that of the nearest pure row."""
_FARTHEST = 24.0
"""Pixels within which a row must show a surface alone."""
_ELSEWHERE, _ANOTHER_STEP = 3.0, 1e-3
"""How many pixels' turn another pixel counts, and another step."""


@dataclass(frozen=True, slots=True)
class Sides:
    """Rows of the whole table that show alone what a row at a border sees of either surface; −1 where none, (n,)."""

    own: IntArray
    other: IntArray

    def seen(self, view: View, name: str) -> tuple[FloatArray, FloatArray]:
        """A column as either side shows it alone, (n,) each; NaN where none does.

        From where a side was seen to where the row looks it changes as it does along that surface.
        """
        return per_view(
            view, ("sides", name),
            lambda: (along_surface(view, name, self.own), along_surface(view, name, self.other)),
        )  # fmt: skip


def sides_of(view: View) -> Sides | None:
    """Both sides of the rows under work that are said to see two surfaces; None where no column says which."""
    if not (view.labels("surface") and mixed_rows(view).any() and pure_rows(view).any()):
        return None
    return per_view(view, "sides", lambda: _find_sides(view))


def _find_sides(view: View) -> Sides:
    """The nearest pure rows: of the row's own surface, and of that beside it which looks most unlike."""
    codes = view.columns.categories["surface"][0]
    channel = view.channel(Role.INTENSITY) or distances(view)[0]
    place, pure = _places(view), pure_rows(view)
    mixed = np.flatnonzero(mixed_rows(view))
    found = Sides(np.full(view.n, -1), np.full(view.n, -1))
    beyond = beyond_surface(view, channel)
    for code in np.unique(codes[pure & (codes >= 0)]).tolist():
        members = np.flatnonzero(pure & (codes == code))
        far, nearest = cKDTree(place[members]).query(place[view.rows[mixed]])
        rows = np.where(np.asarray(far) < _FARTHEST, members[nearest], -1)
        for side, is_it in ((found.own, codes[view.rows[mixed]] == code), (found.other, beyond[mixed] == code)):
            side[mixed[is_it]] = rows[is_it]
    return found


def _places(view: View) -> FloatArray:
    """Where every row of a table looks, in pixels: another stage angle is nearer than another pixel, (n, k)."""
    table = view.columns
    along: list[NDArray[Any]] = [_ELSEWHERE * table.numbers[n] for n in ("pixel_u", "pixel_v") if view.varies(n)]
    if view.varies("stage_angle_deg"):
        along.append(table.numbers["stage_angle_deg"] / max(float(np.median(pixel_width(view))), 1e-6))
    along += [1e6 * table.group("dut"), _ANOTHER_STEP * table.group("cycle", "step")]
    return np.asarray(np.nan_to_num(np.column_stack(along)))


def part_of(sides: Sides, view: View, channel: str, far: Sequence[str] = ()) -> FloatArray:
    """Part of a pixel that the other surface fills, as the simulated light says, and ranges `far` that follow it.

    NaN where neither tells the surfaces apart. Both are linear in it: I, and I·D.
    """
    names = [f"sim_{name}" for name in (channel, *far)]
    light, *reach = (view.number(name) for name in names)

    def moments(lit: FloatArray, *ranges: FloatArray) -> FloatArray:
        return np.stack([lit, *(lit * at / ours for at, ours in zip(ranges, reach, strict=True))])

    here = moments(light, *reach)
    own, other = (moments(*side) for side in zip(*(sides.seen(view, name) for name in names), strict=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = (other - own) / here[0]
        size = np.sqrt(np.sum(apart**2, axis=0))
        part = np.sum((here - own) / here[0] * apart, axis=0) / size**2
    told = (size > _CONTRAST) & (np.abs(part - 0.5) < 0.5 + OFF)
    return np.where(told, np.clip(part, 0.0, 1.0), np.nan)
