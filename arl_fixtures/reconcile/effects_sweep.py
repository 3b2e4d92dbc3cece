"""What one pixel sees in between the stage angles of its own sweep: cubic through the simulated values.

Coarser than the scene over bearing, where many pixels sample the same surfaces at many phases, but right where pixels
do not see the same (a board of circles, a table of a few pixels at different heights).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import distances, per_table, per_view, signals
from arl_fixtures.reconcile.effects_scenes import scenes_shown
from arl_fixtures.reconcile.effects_still import both
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Sweeps:
    """Simulated channels of every pixel over the stage angle.

    Attributes:
        line: pixel of every row of the whole table, and the scene it is shown.
        place: stage angle of every row, in steps from the first.
        step_deg: step of the sweep.
        grids: channel to one row per line and one column per step; distances are weighted with the first signal.
    """

    line: IntArray
    place: FloatArray
    step_deg: float
    grids: dict[str, FloatArray]


def sweeps(view: View) -> Sweeps | None:
    """Sweeps of the table; None without a regular grid of stage angles."""
    return per_table(view, "sweeps", lambda: _make(view))


def _make(view: View) -> Sweeps | None:
    if not view.varies("stage_angle_deg"):
        return None
    table = view.columns
    stage = table.numbers["stage_angle_deg"]
    angles = np.unique(np.round(stage[np.isfinite(stage)], 3))
    step = float(np.median(np.diff(angles)))
    place = np.nan_to_num((stage - angles[0]) / step)
    width = int(np.rint(place.max())) + 1
    line = both(table.group("dut", "pixel_u", "pixel_v"), scenes_shown(view))
    lines = int(line.max()) + 1
    if angles.size < 4 or width > 4 * angles.size or lines * width > 6_000_000:
        return None
    cell = line * width + np.rint(place).astype(np.int64)
    weight = next((np.nan_to_num(table.numbers[f"sim_{name}"]) for name in signals(view)), np.ones(table.n))
    grids = {}
    for name in (*signals(view), *distances(view)):
        values = table.numbers[f"sim_{name}"] * (weight if name in distances(view) else 1.0)
        good = np.isfinite(values)
        count = np.bincount(cell[good], minlength=lines * width)
        total = np.bincount(cell[good], values[good], lines * width)
        with np.errstate(invalid="ignore", divide="ignore"):
            grids[name] = (total / count).reshape(lines, width)
    return Sweeps(line, place, step, grids)


def along_sweep(view: View, turn: FloatArray | float) -> dict[str, FloatArray]:
    """Channels of the same pixels `turn` degrees of stage angle further; NaN where the sweep does not reach."""
    found = sweeps(view)
    if found is None:
        return {}
    width = next(iter(found.grids.values())).shape[1]
    place, line = per_view(view, "sweep place", lambda: (found.place[view.rows], found.line[view.rows] * width))
    wanted = np.clip(place + turn / found.step_deg, 0.0, width - 1.0)
    low: IntArray = np.minimum(wanted.astype(np.int64), width - 2)
    t = wanted - low
    before, after = line + np.maximum(low - 1, 0), line + np.minimum(low + 2, width - 1)
    seen = {}
    for name, grid in found.grids.items():
        values = grid.ravel()
        p0, p1, p2, p3 = values[before], values[line + low], values[line + low + 1], values[after]
        linear = p1 + t * (p2 - p1)
        cubic = linear + 0.5 * t * (1.0 - t) * ((t - 1.0) * (p0 - 2.0 * p1 + p2) + t * (2.0 * p2 - p1 - p3))
        lowest, highest = np.fmin(p1, p2), np.fmax(p1, p2)  # no overshoot beside an edge
        seen[name] = np.where(np.isfinite(cubic), np.clip(cubic, lowest, highest), linear)
        exact = t == 0.0
        if exact.any():
            seen[name] = np.where(exact, p1, seen[name])
    light = next((seen[name] for name in signals(view)), None)
    if light is not None:
        with np.errstate(invalid="ignore", divide="ignore"):
            seen |= {name: seen[name] / light for name in distances(view)}
    return seen


def bend_of_sweeps(view: View) -> FloatArray:
    """How far each row's light lies off the middle of those one stage angle before and after, relative to itself.

    Of every row of the whole table (at the ends of a sweep its neighbour's); infinite where there is no sweep.
    """
    found = sweeps(view)
    name = next(iter(signals(view)), "")
    if found is None or not name:
        return np.full(view.columns.n, np.inf)
    grid = found.grids[name]
    bend = np.full(grid.shape, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        bend[:, 1:-1] = (grid[:, 1:-1] - 0.5 * (grid[:, :-2] + grid[:, 2:])) / grid[:, 1:-1]
    bend[:, 0], bend[:, -1] = bend[:, 1], bend[:, -2]
    return bend[found.line, np.rint(found.place).astype(np.int64)]
