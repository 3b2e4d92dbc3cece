"""What a ray sees at a stage angle in one step it sees in every other, where the simulation says so.

A table that was thinned at random holds few rows whose neighbours in the image, or in the sweep, it holds as well. Of
a scene that stands still the ones that an image lacks are in the images of other steps.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray
from arl_fixtures.reconcile.image_grid import ImageGrid

ALIKE = 1e-3
"""Share of a simulated value by which it may differ between steps."""
SAME_DEG = 1e-3
"""Readings of one stage position agree this closely."""
_SHARED = 0.1
"""Share of the rows whose ray and angle another step must hold as well, for steps to be compared at all."""


def is_still(columns: Columns) -> bool:
    """Whether every ray is simulated to see the same at a stage angle in all steps that hold it."""
    key = "is still"
    if key not in columns.memo:
        columns.memo[key] = _look(columns)
    return bool(columns.memo[key])


def _look(columns: Columns) -> bool:
    if "stage_angle_deg" not in columns.numbers and not {"pixel_u", "pixel_v"} & set(columns.numbers):
        return False
    code = _spot(columns)
    count = int(code.max()) + 1
    if columns.n - count < _SHARED * columns.n:
        return False
    for channel in columns.channels:
        simulated = columns.numbers[f"sim_{channel.name}"]
        if channel.parent or not np.isfinite(simulated).any():
            continue
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        good = np.isfinite(simulated)
        np.minimum.at(low, code[good], simulated[good])
        np.maximum.at(high, code[good], simulated[good])
        seen = np.isfinite(low)
        if np.any((high - low)[seen] > ALIKE * np.maximum(np.abs(low), np.abs(high))[seen]):
            return False
    return True


def _spot(columns: Columns) -> IntArray:
    return columns.group("dut", *columns.ray_columns, "stage_angle_deg")


def still_grid(columns: Columns) -> tuple[ImageGrid, IntArray]:
    """The raster of what is seen at each stage angle, of all steps, and the picture there of every row."""
    key = "still grid"
    if key not in columns.memo:
        picture = columns.group("dut", "stage_angle_deg")
        columns.memo[key] = ImageGrid(columns, picture), picture
    found: tuple[ImageGrid, IntArray] = columns.memo[key]
    return found


def at_angle(columns: Columns, rows: IntArray, angle: FloatArray) -> IntArray:
    """Whole-table row of the same ray at another stage angle, in whichever step; −1 where there is none."""
    key, order, turn = _swept(columns)
    own = columns.numbers["stage_angle_deg"][rows]
    wanted = key[rows] + (angle - own)
    place = np.clip(np.searchsorted(key[order], wanted - SAME_DEG), 0, columns.n - 1)
    found = order[place]
    near = (np.abs(key[found] - wanted) <= SAME_DEG) & (np.abs(angle) < 0.25 * turn)
    return np.where(near, found, -1)


def next_angle(columns: Columns, rows: IntArray, steps: int, gap_deg: float) -> IntArray:
    """Whole-table row of the same ray at the nearest further stage angle of any step, −1 beyond `gap_deg`."""
    key, order, _ = _swept(columns)
    if steps > 0:
        place = np.searchsorted(key[order], key[rows] + SAME_DEG, side="right")
    else:
        place = np.searchsorted(key[order], key[rows] - SAME_DEG, side="left") - 1
    inside = (place >= 0) & (place < columns.n)
    found = order[np.clip(place, 0, columns.n - 1)]
    near = inside & (np.abs(key[found] - key[rows]) <= gap_deg)
    return np.where(near, found, -1)


def _swept(columns: Columns) -> tuple[FloatArray, IntArray, float]:
    """Number of each row by its ray, then its stage angle in degrees; the rows in that order; from ray to ray."""
    key = "still sweep"
    if key not in columns.memo:
        angle = columns.numbers["stage_angle_deg"]
        turn = 4.0 * (float(np.nanmax(np.abs(angle))) + 1.0)  # no angle of one ray is near another's
        number = columns.group("dut", *columns.ray_columns) * turn + angle
        columns.memo[key] = number, np.argsort(number, kind="stable"), turn
    found: tuple[FloatArray, IntArray, float] = columns.memo[key]
    return found
