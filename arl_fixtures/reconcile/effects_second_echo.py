"""The echo that a simulation leaves out where pixels see two surfaces and it shows the range of one of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import per_table
from arl_fixtures.reconcile.effects_room_beams import Sides, sides_along
from arl_fixtures.reconcile.effects_scenes import scenes_shown
from arl_fixtures.reconcile.effects_still import both
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]

_AXES = ("pixel_u", "pixel_v"), ("pixel_v", "pixel_u")


def second_echo(view: View, distance: str) -> tuple[FloatArray, FloatArray]:
    """What part of the light comes from the surface that is not shown, and its range; of the whole table, (n,).

    NaN where a pixel sees one surface, where neighbours do not tell both, or where the simulation shows their mean.
    """
    return per_table(view, ("second echo", distance), lambda: _find(view, distance))


def _find(view: View, distance: str) -> tuple[FloatArray, FloatArray]:
    table = view.columns
    part, range_ = np.full(table.n, np.nan), np.full(table.n, np.nan)
    there = scenes_shown(view)
    for along, across in _AXES:
        if not view.varies(along):
            continue
        found = sides_along(view, both(there, table.group("dut", "stage_angle_deg", across)), along)
        if found is None:
            continue
        weight, far, known = _of_the_other(found, distance)
        row = found.of_row(known)
        new = (row >= 0) & np.isnan(part)
        part = np.where(new, weight[row], part)
        range_ = np.where(new, far[row] * table.numbers[f"sim_{distance}"], range_)
    return part, range_


def _of_the_other(found: Sides, distance: str) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Part of the light and range, in units of the one that is shown, of the other side; and where they are told."""
    lights = [next(iter(side.light.values())) for side in (found.left, found.right)]
    near, far = found.left.far[distance], found.right.far[distance]
    known = found.of_both & ~found.mean[distance]
    with np.errstate(invalid="ignore"):
        shows_left = np.abs(near - 1.0) <= np.abs(far - 1.0)
    weight = np.where(shows_left, (1.0 - found.share) * lights[1], found.share * lights[0])
    return weight, np.where(shows_left, far / near, near / far), known
