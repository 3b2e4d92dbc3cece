"""How much of a pixel something fills that holds along the bearing, by the rays of all pixels beside it."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import FloatArray
from arl_fixtures.reconcile.effects_scene import curves_over_bearing, pixel_width, scene
from arl_fixtures.reconcile.view import IntArray, View


def footprint_share(view: View, belongs: FloatArray) -> FloatArray | None:
    """Share of each row's pixel, on the rows under work, in which something holds along the bearing.

    Args:
        view: rows under work.
        belongs: 1 where it holds for the ray through the pixel's centre, else 0; of every row of the whole table.

    Returns:
        Box average over the pixel's width; None where the table has no columns of pixels with an azimuth.
    """
    found = scene(view)
    if found is None or not (view.varies("azimuth_deg") and view.varies("pixel_u")):
        return None
    grid = curves_over_bearing(found.line, found.bearing / found.step_deg, belongs, int(found.line.max()) + 1)
    total = np.concatenate([np.zeros((grid.shape[0], 1)), np.cumsum(grid, axis=1)], axis=1)
    half = 0.5 * pixel_width(view)[view.rows] / found.step_deg
    place, line = found.bearing[view.rows] / found.step_deg + 0.5, found.line[view.rows] * total.shape[1]

    def up_to(end: FloatArray) -> FloatArray:
        inside = np.clip(end, 0.0, total.shape[1] - 1.001)
        low: IntArray = inside.astype(np.int64)
        values = total.ravel()
        return np.asarray(values[line + low] + (inside - low) * (values[line + low + 1] - values[line + low]))

    share = (up_to(place + half) - up_to(place - half)) / np.maximum(2.0 * half, 1e-9)
    return np.asarray(np.clip(share, 0.0, 1.0))
