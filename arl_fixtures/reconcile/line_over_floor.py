"""How steeply a line of pixels looks down, in a table that does not say so: the floor that it sees shows it.

All rays of a line leave it at one elevation: they make a cone. They meet a floor at one range and one incidence
whatever their azimuth, and no wall: there the incidence follows the azimuth. The elevation is the floor's incidence
less a right angle.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import distances, simulated_range_m
from arl_fixtures.reconcile.view import View

_STEEPEST_DEG, _SLANTED_DEG = 20.0, 89.5
"""Incidences between which a floor is told from targets that face the sensor, and from a ray along it."""
_SAME_DEG, _SAME_RANGE, _NEARLY_ALL = 0.02, 2e-3, 0.9
"""How alike incidences, and ranges as a share of them, are on a floor; and of how many of its rays ranges are."""
_FEWEST_RAYS, _LEAST_SPAN_DEG = 12, 10.0
"""Azimuths that must see it, and how far they must part."""


def elevation_of_line(view: View) -> float | None:
    """Elevation of all rays of a table's line of pixels, degrees; None where it has no such, or sees no floor."""
    numbers, names = view.columns.numbers, distances(view)
    lined = view.varies("pixel_u") and view.varies("azimuth_deg") and not view.varies("pixel_v")
    if not (lined and names and "incidence_deg" in numbers):
        return None
    met, azimuth = numbers["incidence_deg"], numbers["azimuth_deg"]
    far = simulated_range_m(view)
    slanted = np.flatnonzero((met > _STEEPEST_DEG) & (met < _SLANTED_DEG) & (far > 0.0) & np.isfinite(azimuth))
    if not slanted.size:
        return None
    _, level, count = np.unique(np.rint(met[slanted] / _SAME_DEG), return_inverse=True, return_counts=True)
    floor = slanted[level == int(np.argmax(count))]
    rays = np.unique(np.round(azimuth[floor], 3))
    alike = np.abs(far[floor] / np.median(far[floor]) - 1.0) < _SAME_RANGE
    if rays.size < _FEWEST_RAYS or np.ptp(rays) < _LEAST_SPAN_DEG or np.mean(alike) < _NEARLY_ALL:
        return None
    return float(np.median(met[floor])) - 90.0
