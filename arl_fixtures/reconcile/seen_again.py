"""Rows in which the same pixel is simulated to see the same at the same angle: they differ by simulated noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effects_common import per_view
from arl_fixtures.reconcile.effects_still import centred
from arl_fixtures.reconcile.view import View

_SAME = 0.03
"""Relative difference of what is simulated for a pixel at one angle up to which it is the same scene."""
_ROUNDING = 1e-9
_PLACE = ("dut", "pixel_u", "pixel_v", "stage_angle_deg", "surface")
_RAY = ("azimuth_deg", "elevation_deg")
"""What tells one ray of a scanner from another, which has no pixels."""


def seen_again(view: View, channel: str) -> tuple[IntArray, NDArray[np.bool_]]:
    """Place of each row under work, as a number, and whether all rows there see the same.

    What changes whole steps alike (a laser's temperature) changes nothing in what is seen.
    """
    return per_view(view, ("seen again", channel), lambda: _seen_again(view, channel))


def _seen_again(view: View, channel: str) -> tuple[IntArray, NDArray[np.bool_]]:
    names = _PLACE if view.has("pixel_u") or view.has("pixel_v") else (*_PLACE, *_RAY)
    place = np.unique(view.columns.group(*names)[view.rows], return_inverse=True)[1].ravel().astype(np.int64)
    step = view.columns.group("dut", "cycle", "step")[view.rows]
    with np.errstate(divide="ignore", invalid="ignore"):
        log = np.log(np.abs(view.sim[channel]))
    good = np.isfinite(log)
    log = np.where(good, log, 0.0)
    for code in (place, step):
        log = centred(code, log, good)
    most = np.zeros(int(place.max()) + 1)
    np.maximum.at(most, place[good], np.abs(log[good]))
    return place, np.asarray(good & (most[place] < _SAME))


def of_places(view: View, channel: str, values: FloatArray) -> FloatArray:
    """Ratios on rows under work, as their mean over the rows that see the same: less of the simulation's noise."""
    place, again = seen_again(view, channel)
    known = again & np.isfinite(values)
    count = np.bincount(place[known], minlength=int(place.max()) + 1)
    mean = (np.bincount(place[known], values[known], count.size) / np.maximum(count, 1))[place]
    most = np.zeros(count.size)
    np.maximum.at(most, place[known], np.abs(values - mean)[known])
    noise = (most > _ROUNDING) & (most < 2.0 * _SAME)  # ties stay ties; a neighbour that is missing changes more
    return np.asarray(np.where(known & noise[place], mean, values))
