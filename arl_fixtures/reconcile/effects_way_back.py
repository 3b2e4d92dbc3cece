"""How a stage came to where it stands: stays of a sweep, and the way back to the position before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.effects_common import FloatArray, per_table, per_view, rounded
from arl_fixtures.reconcile.grouping import GAP_SHARE
from arl_fixtures.reconcile.still_scene import SAME_DEG
from arl_fixtures.reconcile.view import IntArray, View

_MOST_LACKING = 3.0
"""Positions that a hole of a sweep may be back to the next one known."""
_FEWEST_MOVES, _OFF_STRIDE = 5, 0.02
"""Moves that tell the stride of a thinned sweep, and by how much of it they may miss a multiple."""
_UNEVEN = 0.25
"""Relative scatter of a sweep's steps from which a lag is told from a constant angle."""

_WORDS = ("direction", "travel", "approach")
_ONWARD = ("up", "+", "plus", "pos", "forw", "fwd", "ris", "inc", "cw", "right", "out")
"""Words by which a column is the direction of travel, and by which one of two directions is onward."""


@dataclass(frozen=True, slots=True)
class Way:
    """How each row of the whole table came to its stage angle.

    Attributes:
        back_deg: stage angle before less its own; zero for the first of a sweep, and where the table has a hole.
        since_s: since the first row at this stay; zero without times.
    """

    back_deg: FloatArray
    since_s: FloatArray

    @property
    def is_uneven(self) -> bool:
        """Whether the stage came from nearer or farther by turns."""
        size = np.abs(self.back_deg[self.back_deg != 0.0])
        return bool(size.size) and float(np.std(size)) > _UNEVEN * float(np.mean(size))


def stays(view: View) -> tuple[IntArray, IntArray, IntArray]:
    """Rows of the whole table as the stage swept, their stay, and each stay's first row."""
    table = view.columns
    angle, cell = table.numbers["stage_angle_deg"], table.group(*table.sweep_columns)
    order = np.lexsort((angle, table.sweep_order, cell))
    fresh = np.ones(table.n, dtype=bool)
    fresh[1:] = (np.abs(np.diff(angle[order])) > SAME_DEG) | (np.diff(cell[order]) != 0)
    return order, np.cumsum(fresh) - 1, order[fresh]


def _between(view: View, first: IntArray) -> FloatArray:
    """From the stay before to each stay, in seconds, without times in degrees; infinite for the first of a step."""
    table = view.columns
    time = table.sweep_order[first]
    same = np.diff(table.group(*table.sweep_columns)[first]) == 0
    return np.concatenate([[np.inf], np.where(same, np.diff(time), np.inf)])


def longest_s(view: View) -> float:
    """What a move takes at most, 1.7 of the usual; farther apart lie stays of which one between is missing."""
    taken = _between(view, stays(view)[2])
    usual = taken[np.isfinite(taken)]
    return rounded(1.7 * float(np.median(usual))) if usual.size else 0.0


def way_back(view: View, longest: float) -> Way:
    """How rows came to their stage angle; `longest`: seconds (without times degrees) that a move takes at most."""

    def make() -> Way:
        table = view.columns
        angle = table.numbers["stage_angle_deg"]
        order, stay, first = stays(view)
        before = np.where(_between(view, first) <= longest, np.roll(angle[first], 1), np.nan)
        back, since = np.zeros(table.n), np.zeros(table.n)
        back[order] = np.nan_to_num(before[stay] - angle[order])
        if view.varies("time_s"):
            time = table.numbers["time_s"]
            since[order] = np.nan_to_num(time[order] - time[first[stay]])
        return Way(back, since)

    return per_table(view, ("way back", longest), make)


def thinned_by(view: View) -> float:
    """Degrees between two positions of a sweep that the table holds scattered positions of, 0 where it is whole."""

    def make() -> float:
        table = view.columns
        first = stays(view)[2]
        angle, cell = table.numbers["stage_angle_deg"][first], table.group(*table.sweep_columns)[first]
        moved = np.abs(np.diff(angle))[(np.diff(cell) == 0) & np.isfinite(np.diff(angle))]
        moved = moved[moved > SAME_DEG]
        if moved.size < _FEWEST_MOVES:
            return 0.0
        for part in (1, 2, 3):
            strides = moved / (moved.min() / part)
            if np.all(np.abs(strides - np.rint(strides)) < _OFF_STRIDE):
                scattered = len(np.unique(np.rint(strides))) >= 3 and np.median(strides) >= 2.0
                return rounded(moved.min() / part) if scattered else 0.0
        return 0.0

    return per_table(view, "thinned by", make)


def stride_back(view: View, stride_deg: float) -> FloatArray:
    """A stride back the way that the stage came, degrees; for the first of a sweep as for the second."""

    def make() -> FloatArray:
        table = view.columns
        order, stay, first = stays(view)
        angle, cell = table.numbers["stage_angle_deg"][first], table.group(*table.sweep_columns)[first]
        came = np.zeros(len(first))
        came[1:] = np.where(np.diff(cell) == 0, np.sign(np.diff(angle)), 0.0)
        came[:-1] = np.where(came[:-1] == 0.0, np.where(np.diff(cell) == 0, came[1:], 0.0), came[:-1])
        back = np.zeros(table.n)
        back[order] = -stride_deg * came[stay]
        return back

    return per_table(view, ("stride back", stride_deg), make)[view.rows]


def logged_direction(view: View) -> tuple[str, FloatArray] | None:
    """The column that says in which direction the stage went, as ±1 and 0; also where all rows came from one side."""
    for name, logged in sorted(view.columns.numbers.items()):
        told = any(word in name for word in _WORDS) and not name.startswith("sim_")
        if told and np.isin(logged[np.isfinite(logged)], (-1.0, 0.0, 1.0)).all():
            return name, np.nan_to_num(logged)
    for name, (codes, labels) in sorted(view.columns.categories.items()):
        if any(word in name for word in _WORDS) and len(labels) == 2:
            onward = [label.lower().startswith(_ONWARD) for label in labels]
            if onward[0] != onward[1]:
                signs = np.array([1.0 if on else -1.0 for on in onward] + [0.0])
                return name, signs[codes]
    return None


def stride_of(view: View) -> float:
    """Degrees between neighbouring stage angles of the whole table, the usual ones; 0 where it has fewer than two."""

    def make() -> float:
        angle = view.columns.numbers["stage_angle_deg"]
        gap = np.diff(np.unique(angle[np.isfinite(angle)]))
        gap = gap[gap > SAME_DEG]
        return rounded(float(np.median(gap))) if gap.size else 0.0

    return per_table(view, "stride", make)


def _logged_before(view: View) -> FloatArray:
    """Stage angle before each row of the whole table, where a column says it; not finite where none does."""
    for name, values in sorted(view.columns.numbers.items()):
        if "stage_angle" in name and any(word in name for word in ("prev", "last", "before", "earlier")):
            return values
    return np.full(view.columns.n, np.nan)


def _over_holes(view: View) -> FloatArray:
    """Way back to the position before where the sweep itself lacks it: by the time that passed; else zero, (n,)."""
    table = view.columns
    order, stay, first = stays(view)
    took, angle = _between(view, first), table.numbers["stage_angle_deg"][first]
    usual = took[np.isfinite(took)]
    steps = np.rint(took / float(np.median(usual))) if usual.size else np.zeros(len(first))
    lacks = (steps > 1.0) & (steps <= _MOST_LACKING)
    back = np.zeros(table.n)
    back[order] = np.where(lacks, (np.roll(angle, 1) - angle) / np.where(lacks, steps, 1.0), 0.0)[stay]
    return back


def missing_before(view: View) -> FloatArray:
    """Way back to the stage position before, degrees, where the table lacks what the same ray saw there; else zero.

    Other rays may have been there, or a column says where the stage was. Where neither tells, it lies a half or a
    third of the way to the one before it, by the time that passed.
    """

    def make() -> FloatArray:
        table = view.columns
        order, longest = table.sweep_order, table.frame_gap_s if view.varies("time_s") else table.sweep_gap_deg
        cell = table.group(*table.sweep_columns, *table.ray_columns)
        place = table.following(("acquired", 1), cell, order, -1)[view.rows]
        far = np.where(place >= 0, np.abs(order[place] - order[view.rows]) * GAP_SHARE / longest, 0.0)
        steps = np.rint(far)  # of the usual size
        lacking = (view.acquired_place(1) < 0) & (steps > 1.0) & (steps <= _MOST_LACKING)
        angle = view.number("stage_angle_deg")
        back = view.take_number("stage_angle_deg", place) - angle
        guessed = np.where(lacking, np.nan_to_num(back) / np.maximum(steps, 1.0), 0.0)
        told = _logged_before(view)[view.rows] - angle
        if not np.isfinite(told).any():
            told = way_back(view, longest_s(view)).back_deg[view.rows]
        told = np.nan_to_num(told)
        guessed = np.where(guessed == 0.0, _over_holes(view)[view.rows], guessed)
        own = view.take_number("stage_angle_deg", view.acquired_place(1)) - angle
        return np.asarray(np.where(told == 0.0, guessed, np.where(np.abs(own - told) <= SAME_DEG, 0.0, told)))

    return per_view(view, "missing before", make)
