"""Pixels at borders that range the first echo: their light follows a small turn, their range stays or jumps.

A detector that stamps a pulse's leading edge reads the nearer of two surfaces as soon as enough of its light comes
back. Where between two stops that happens no table tells, and a curve through ranges on both sides of the jump is off
by a share of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import distances, per_table, signals
from arl_fixtures.reconcile.effects_surface import stops_far_apart
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_JUMP = 0.05
"""Share of a range by which it differs beyond a border."""
_LIT, _MIXED_LIGHT, _MIXED_RANGE = 0.2, 0.15, 0.05
"""Share by which light differs across a border at least, and how far from both sides what a pixel mixes lies."""
_FEWEST, _MOST_MIXED = 12, 0.1
"""Mixed pixels that tell, and the share of them at most whose range lies in between."""
_WHOLE = 0.5
"""Share of rows that have a pixel on either side where images are whole."""
_STEEPEST = 6.0
"""Tangent of the largest incidence at which a surface is still seen as one: by so much its range grows per radian."""
_NEAR = 0.5
"""Share of the way to the next stop that a turn may be for ranges to stay."""


def held_at_first_echoes(
    view: View, changes: dict[str, FloatArray], turn: FloatArray | float
) -> dict[str, FloatArray]:
    """Changes without those of ranges that no surface is steep enough for, where first echoes are ranged.

    Args:
        view: rows under work; changes: of signals and distances, by channel.
        turn: by which rays look elsewhere, degrees.
    """
    if not _ranges_first_echo(view):
        return changes
    small = np.abs(turn) < _NEAR * view.columns.sweep_gap_deg
    return {
        name: np.where(small & (np.abs(c) > _STEEPEST * view.sim[name] * np.radians(np.abs(turn))), 0.0, c)
        if name in distances(view)
        else c
        for name, c in changes.items()
    }


def _ranges_first_echo(view: View) -> bool:
    return per_table(view, "first echo", lambda: _looked_at(View(view.columns)))


def _looked_at(view: View) -> bool:
    if not (view.varies("stage_angle_deg") and signals(view) and distances(view)):
        return False
    light, far = _around(view, next(iter(signals(view)))), _around(view, distances(view)[0])
    with np.errstate(invalid="ignore"):
        across = np.abs(far[2] - far[0]) > _JUMP * far[1]
        across &= np.abs(light[2] - light[0]) > _LIT * np.fmax(light[0], light[2])
        mixed = across & _lies_between(light, _MIXED_LIGHT)
        between = _lies_between(far, _MIXED_RANGE)[mixed]
    return between.size >= _FEWEST and float(np.mean(between)) < _MOST_MIXED


def _lies_between(around: FloatArray, margin: float) -> BoolArray:
    """Whether the middle one of three lies between the others, clear of both."""
    low, high = np.fmin(around[0], around[2]), np.fmax(around[0], around[2])
    inner = margin * (high - low)
    return np.asarray((around[1] > low + inner) & (around[1] < high - inner))


def _around(view: View, channel: str) -> FloatArray:
    """The simulation on one side, here, and on the other, (3, n); NaN where there is none.

    At the stops before and after, or in images that are whole, of stops that lie pixels apart, at the next pixels.
    """
    simulated = view.columns.numbers[f"sim_{channel}"]
    sides = [view.sweep_place(-1), view.sweep_place(1)]
    if stops_far_apart(view):
        pixels = [view.neighbour_place(du=du, dv=0) for du in (-1, 1)]
        if np.mean(np.min(pixels, axis=0) >= 0) > _WHOLE:
            sides = pixels
    places = np.stack([sides[0], view.rows, sides[1]])
    return np.where(places >= 0, simulated[places], np.nan)
