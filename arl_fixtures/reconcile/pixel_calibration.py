"""Whether a simulation was calibrated pixel by pixel on the recording itself.

The mean mismatch of each pixel is then closer to nothing than its rows' own noise allows, and an effect that grows
with a condition is nil at the condition's mean.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import Columns, FloatArray
from arl_fixtures.reconcile.roles import Role

FEWEST_PIXELS, FEWEST_ROWS = 24, 6
CLOSER = 0.5
"""Root mean square of the pixels' means, in their own errors, below which a calibration made them agree: white noise
of 24 pixels is that small once in 20 000 tables."""
TRIMMED = 0.1
"""Share of the pixels, those that agree least, that is left out: dead ones cannot be calibrated."""
_SMALLEST = 1e-300


def calibrated_by_pixel(table: Columns, channel: str) -> bool:
    """Whether each pixel's mean of a channel agrees better with its simulation than its noise allows.

    Args:
        table: whole table.
        channel: an intensity or a distance.

    Returns:
        False as well where pixels, their rows or the simulation's scatter are missing.
    """
    key = ("calibrated by pixel", channel)
    if key not in table.memo:
        table.memo[key] = _closer(table, channel)
    return bool(table.memo[key])


def is_calibrated_by_pixel(table: Columns) -> bool:
    """Whether any signal of a table was calibrated pixel by pixel on it."""
    return any(calibrated_by_pixel(table, entry.name) for entry in table.channels if entry.role is Role.INTENSITY)


def _closer(table: Columns, channel: str) -> bool:
    entry = next((entry for entry in table.channels if entry.name == channel), None)
    spread = table.numbers.get(f"sim_{channel}_std")
    if entry is None or spread is None or "pixel_u" not in table.numbers:
        return False
    measured, simulated = table.numbers[channel], table.numbers[f"sim_{channel}"]
    frames = np.maximum(np.nan_to_num(table.numbers.get("n_frames", np.ones(table.n)), nan=1.0), 1.0)
    scale = np.abs(simulated) if entry.role is Role.INTENSITY else np.ones(table.n)
    pixel = table.group("dut", "pixel_u", "pixel_v")
    good = np.isfinite(measured) & np.isfinite(simulated) & np.isfinite(spread) & (spread > 0.0) & (scale > 0.0)
    if not good.any():
        return False
    each: FloatArray = (measured - simulated)[good] / scale[good]
    error = spread[good] / np.sqrt(frames[good]) / scale[good]
    code, rows = pixel[good], np.bincount(pixel[good])
    known = rows >= FEWEST_ROWS
    if int(known.sum()) < FEWEST_PIXELS:
        return False
    agreements = []
    for weight in (np.ones(each.size), 1.0 / error**2):  # a plain mean, or the best one
        total = np.maximum(np.bincount(code, weight), _SMALLEST)
        mean = np.bincount(code, weight * each) / total
        own = np.sqrt(np.bincount(code, (weight * error) ** 2)) / total
        z = np.sort(np.abs(mean[known] / own[known]))
        agreements.append(float(np.sqrt(np.mean(z[: int(np.ceil((1.0 - TRIMMED) * z.size))] ** 2))))
    return min(agreements) < CLOSER
