"""Whether a pattern of pixels is one of their gains: pixels are made one by one, what they see is not.

Light that went astray, a beam or a lens leaves a pattern in which neighbours are alike, an edge one of a few pixels;
gains scatter from each pixel to the next, and in all of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats
from scipy.spatial import cKDTree

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.problem import Problem

ALIKE, ALIKE_Z = 0.4, 3.0
"""Correlation of neighbours (Moran's I) from which a pattern is smooth, and its significance: gains of pixels came to
0.06 at most in five tables, stray light to 0.8 in two."""
NEIGHBOURS = 4
FEWEST = 12
HELD_BACK = 3.0
"""Scatters to which a pixel is held back: one that is off alone tells of no neighbour."""
PLACE = ("pixel_u", "pixel_v")
PLACES_OF_A_PIXEL = 1.5
"""Stage angles per pixel, on average, below which what a pixel sees is not told from what it is."""
MIDDLE, WELL_KNOWN, FEW_P = 0.27, 3.0, 1e-3
"""Scatters within which a fifth of all pixels should lie; standard errors in a scatter of pixels that tell of it; and
probability of as many so near as a pattern has that is none."""


def is_smooth(per: Sequence[str], keys: Sequence[tuple[str, ...]], values: FloatArray) -> bool:
    """Whether neighbours in the image are alike, device by device.

    Args:
        per: what the levels of a pattern are told by; keys: level by level; values: as measured, not finite where
            none is known.

    Moran, Biometrika 37 (1950) 17; the scatter of I without correlation is that of n·k products of neighbours.
    """
    where = [per.index(name) for name in PLACE if name in per]
    if not where:
        return False
    units: dict[tuple[str, ...], list[int]] = {}
    for k in np.flatnonzero(np.isfinite(values)).tolist():
        units.setdefault(tuple(x for i, x in enumerate(keys[k]) if i not in where), []).append(k)
    likeness = power = 0.0
    count = 0
    for some in units.values():
        if len(some) < FEWEST:
            continue
        place = np.array([[float(keys[k][i]) for i in where] for k in some])
        v = values[some] - np.median(values[some])
        spread = 1.4826 * float(np.median(np.abs(v)))
        v = np.clip(v, -HELD_BACK * spread, HELD_BACK * spread)
        v = v - v.mean()
        place = place / _pitch(place)
        near = np.asarray(cKDTree(place).query(place, k=NEIGHBOURS + 1)[1])[:, 1:]
        likeness += float(np.sum(v[:, None] * v[near]))
        power += NEIGHBOURS * float(v @ v)
        count += len(some)
    if power <= 0.0:
        return False
    moran = likeness / power
    # half of the pairs are seen from both ends
    return moran > ALIKE and moran * np.sqrt(0.5 * NEIGHBOURS * count) > ALIKE_Z


def _pitch(place: FloatArray) -> FloatArray:
    """Usual distance of columns and of rows that are in the table."""
    pitch = [np.median(np.diff(np.unique(x))) if len(np.unique(x)) > 1 else 1.0 for x in place.T]
    return np.array(pitch, dtype=np.float64)


def sees_one_place(problem: Problem) -> bool:
    """Whether the stage turns, and most pixels are in the table at one of its angles only."""
    if not problem.view.varies("stage_angle_deg"):
        return False
    rows = problem.view.rows
    pixel = np.unique(problem.columns.group("dut", "pixel_u", "pixel_v")[rows]).size
    place = np.unique(problem.columns.group("dut", "pixel_u", "pixel_v", "stage_angle_deg")[rows]).size
    return place < PLACES_OF_A_PIXEL * pixel


def sits_in_few(values: FloatArray, precision: FloatArray, tau: float) -> bool:
    """Whether a pattern is that of some pixels, most others being far more alike than gains of such a scatter are.

    Where each was seen at one place only, it is no gain: what a few see there is missing, an edge say.
    """
    sure = values[precision * tau**2 > WELL_KNOWN**2]
    sure = sure - np.median(sure) if len(sure) else sure
    near = float(stats.norm.cdf(MIDDLE)) * 2.0 - 1.0
    return bool(stats.binom.sf(np.sum(np.abs(sure) < MIDDLE * tau) - 1, max(len(sure), 1), near) < FEW_P)
