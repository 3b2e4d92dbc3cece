"""Rays next to a scanner's ray: along its ring and across, whichever of a table's images holds them.

A table that was thinned holds every third ray of an image. What a device sees that stands still it sees in every
image, and the rays that one lacks are in the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effects_common import distances, per_table
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.effects_planes import directions
from arl_fixtures.reconcile.effects_room_places import places_and_rays
from arl_fixtures.reconcile.effects_still import both
from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEXT, _SAME, _PITCH = 1.5, 0.5, 0.05
"""Usual gaps within which a ray is the next one: beyond, at least one is missing between. Pitches of an image within
which a ray is the own one in another image; the quantile of an image's gaps that is its pitch, thinned or not."""
_DIGITS = 3
"""Decimals of degrees by which rings, and rays one above the other, are told apart."""


def beside_in_rings(view: View) -> list[IntArray]:
    """Whole-table rows next to each row under work along its ring, then across; −1 where there is none near."""
    whole = per_table(view, "beside in rings", lambda: _find(View(view.columns)))
    return [place[view.rows] for place in whole]


def _find(view: View) -> list[IntArray]:
    name = distances(view)[0] if distances(view) else ""
    far = view.columns.numbers.get(f"sim_{name}", np.full(view.n, np.nan))
    device, code, _ = places_and_rays(view, directions(view, 1.0), far)
    first = np.unique(code, return_index=True)[1]
    image = view.columns.group("dut", "cycle", "step")
    angles = [np.round(ray_column(view, name), _DIGITS) for name in ("azimuth_deg", "elevation_deg")]
    found = []
    for order, others in ((angles[0], angles[1]), (angles[1], angles[0])):
        across = np.unique(others, return_inverse=True)[1].astype(np.int64)
        pitch = _pitch(both(both(image, device), across), order)
        line = both(device, across)[first]
        found += [_next(line, order[first], pitch, steps) for steps in (-1, 1)]
    return [np.where(place[code] >= 0, first[place[code]], -1) for place in found]


def _pitch(line: IntArray, order: FloatArray) -> float:
    """Degrees from ray to ray on the lines of one image; 0 where no line has two."""
    by = np.lexsort((order, line))
    gap = np.diff(order[by])[np.diff(line[by]) == 0]
    gap = gap[gap > 0.0]
    return float(np.quantile(gap, _PITCH)) if gap.size else 0.0


def _next(line: IntArray, order: FloatArray, pitch: float, steps: int) -> IntArray:
    """Place of the next ray on each ray's line, −1 where there is none near."""
    by = np.lexsort((order, line))
    turn = 4.0 * max(float(np.ptp(order)), pitch, 1.0)
    key = (line * turn + order - float(order.min()))[by]
    if steps > 0:
        after = np.searchsorted(key, key + _SAME * pitch, side="right")
    else:
        after = np.searchsorted(key, key - _SAME * pitch, side="left") - 1
    inside = (after >= 0) & (after < key.size)
    after = np.clip(after, 0, key.size - 1)
    gap = np.where(inside & (line[by][after] == line[by]), steps * (key[after] - key), np.nan)
    place = np.full(line.size, -1, dtype=np.int64)
    if np.isfinite(gap).any():
        place[by] = np.where(gap < _NEXT * np.nanmedian(gap), by[after], -1)
    return place
