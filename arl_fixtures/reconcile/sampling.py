"""Which rows of a large table are worked on: every step, its rows a grid of some pixels at some stage angles.

Which pixels and angles these are turns from step to step, within a pool small enough for each to come back in
several steps: few pixels at all steps would show a pattern over the image badly (and three pixels of one parity not
at all), new pixels in each step would hide a temperature's effect behind the pixels' own pattern.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import BoolArray, Columns, FloatArray, IntArray
from arl_fixtures.reconcile.grouping import Groups

RETURNS = 6.0
"""Steps of a unit in which a pixel or an angle comes back, at least."""
FEWEST = 4.0
"""Pixels and angles of a step, at least: rows that share an image must be recognised as such."""


def draw_rows(columns: Columns, groups: Groups, limit: int) -> IntArray:
    """At most about `limit` rows: some pixels and angles of every step, else every k-th row of each block."""
    n = columns.n
    if n <= limit:
        return np.arange(n)
    share = limit / n
    codes: list[IntArray] = []
    if groups.pixel is not None:
        codes.append(columns.group("pixel_u", "pixel_v"))
    if groups.angle is not None:
        codes.append(columns.codes_of("stage_angle_deg"))
    keep = np.ones(n, dtype=bool)
    steps = (int(groups.step.max()) + 1) / (int(groups.unit.max()) + 1)
    for seed, code, part in zip((17, 5), codes, _shares(codes, share), strict=False):
        keep &= _turning(code, groups.step, part, steps, seed)
    if not codes or not 0.5 * limit < keep.sum() < 2.0 * limit:
        keep = np.ones(n, dtype=bool)
        order = np.lexsort((np.arange(n), groups.block))
        place = np.arange(n)
        keep[order] = np.floor((place + 1) * share) > np.floor(place * share)
    return np.flatnonzero(keep)


def _shares(codes: list[IntArray], share: float) -> list[float]:
    """Share of the pixels and of the angles that a step keeps: alike, but of neither too few."""
    counts = [float(code.max() + 1) for code in codes]
    each = share ** (1.0 / max(len(codes), 1))
    parts = [min(max(each, FEWEST / count), 1.0) for count in counts]
    if len(parts) == 2:
        larger = int(counts[1] > counts[0])
        parts[larger] = min(share / parts[1 - larger], 1.0)
    return parts


def _turning(code: IntArray, step: IntArray, part: float, steps: float, seed: int) -> BoolArray:
    """Rows of the levels that their step keeps: `part` of all, out of a pool from which each comes back often."""
    pool = min(max(part, part * steps / RETURNS), 1.0)
    return (_hash(code, seed) < pool) & (_hash(code * (int(step.max()) + 1) + step, seed + 1) < part / pool)


def _hash(code: IntArray, seed: int) -> FloatArray:
    mixed = (code.astype(np.uint64) + np.uint64(seed)) * np.uint64(0x9E3779B97F4A7C15)
    mixed ^= mixed >> np.uint64(31)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    mixed ^= mixed >> np.uint64(29)
    return np.asarray((mixed >> np.uint64(11)).astype(np.float64) / float(1 << 53))
