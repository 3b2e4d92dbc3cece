"""Which rows of a large table are worked on: whole pixels and angles of every step, so groups keep their sense."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray
from arl_fixtures.reconcile.grouping import Groups


def draw_rows(columns: Columns, groups: Groups, limit: int) -> IntArray:
    """At most about `limit` rows: some pixels and angles of every step, else every k-th row of each block."""
    n = columns.n
    if n <= limit:
        return np.arange(n)
    keep = np.ones(n, dtype=bool)
    share = limit / n
    levels = [code for code in (groups.pixel, groups.angle) if code is not None]
    pixels = None if groups.pixel is None else int(groups.pixel.max()) + 1
    if pixels is not None and pixels * share >= 24:
        keep &= _hash(columns.group("pixel_u", "pixel_v"), 17) < share
    elif len(levels) == 2:
        keep &= _hash(columns.group("pixel_u", "pixel_v"), 17) < np.sqrt(share)
        keep &= _hash(columns.codes_of("stage_angle_deg"), 5) < np.sqrt(share)
    else:
        order = np.lexsort((np.arange(n), groups.block))
        place = np.arange(n)
        keep[order] = np.floor((place + 1) * share) > np.floor(place * share)
    rows = np.flatnonzero(keep)
    if len(rows) < 0.5 * limit:
        rows = np.flatnonzero(_hash(np.arange(n), 3) < share)
    return rows


def _hash(code: IntArray, seed: int) -> FloatArray:
    mixed = (code.astype(np.uint64) + np.uint64(seed)) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= mixed >> np.uint64(31)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    return (mixed >> np.uint64(11)).astype(np.float64) / float(1 << 53)
