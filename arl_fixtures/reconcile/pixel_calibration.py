"""Whether a simulation was calibrated on the recording itself, pixel by pixel or surface by surface.

The mean mismatch of each pixel (or surface) is then closer to nothing than its rows' own noise allows, and an effect
that grows with a condition is nil at the condition's mean.
"""

from __future__ import annotations

import numpy as np
from scipy import special, stats

from arl_fixtures.reconcile.columns import Columns, FloatArray
from arl_fixtures.reconcile.roles import Role

FEWEST_PIXELS, FEWEST_ROWS = 24, 6
FEWEST_SURFACES, ROWS_OF_SURFACE = 3, 20
CLOSER, MUCH_CLOSER = 0.5, 0.25
"""Root mean square of the pixels' means, in their own errors, below which a calibration made them agree: white noise
of 24 pixels is that small once in 20 000 tables. The same of few surfaces, which must agree the better."""
TRIMMED = 0.1
"""Share of the pixels, those that agree least, that is left out: dead ones cannot be calibrated."""
NIL = 0.01
"""Share of tables that have sums as near to nil without a fit; where something differs they have it less often."""
_SMALLEST = 1e-300


def calibrated_by_pixel(table: Columns, channel: str) -> bool:
    """Whether each pixel's mean of a channel agrees better with its simulation than its noise allows.

    A pixel of each device, or the same pixel of all devices together.

    Args:
        table: whole table.
        channel: an intensity or a distance.

    Returns:
        False as well where pixels, their rows or the simulation's scatter are missing.
    """
    key = ("calibrated by pixel", channel)
    if key not in table.memo:
        # each device by a table of its own, or all of them by one: then only their pixels' common mean agrees
        table.memo[key] = "pixel_u" in table.numbers and any(
            _apart(table, channel, (*unit, "pixel_u", "pixel_v"), FEWEST_PIXELS, FEWEST_ROWS) < CLOSER
            for unit in ((("dut",), ()) if _has_devices(table) else ((),))
        )
    return bool(table.memo[key])


def calibrated_by_surface(table: Columns, channel: str) -> bool:
    """The same of each surface: reflectances were fitted to the recording.

    Args:
        table: whole table.
        channel: an intensity.
    """
    key = ("calibrated by surface", channel)
    if key not in table.memo:
        surfaces = "surface" in table.categories
        apart = _apart(table, channel, ("dut", "surface"), FEWEST_SURFACES, ROWS_OF_SURFACE) if surfaces else np.inf
        table.memo[key] = apart < MUCH_CLOSER
    return bool(table.memo[key])


def zero_fitted(table: Columns, channel: str) -> bool:
    """Whether a signal's zero was fitted to these very rows, of each device or of all together.

    The sum of what differs from a simulation, each row by its stated weight, then is nil, which no other simulation's
    is: not one whose gain alone was fitted, whatever that fit's weights. It is nil to the last digits where the table
    has all the rows of the fit, and nearer to nil than chance has it for every device where it has most of them.

    Args:
        table: whole table.
        channel: an intensity with the simulation's scatter.
    """
    key = ("zero fitted", channel)
    if key not in table.memo:
        table.memo[key] = not calibrated_by_pixel(table, channel) and _sums_to_nil(table, channel)
    return bool(table.memo[key])


def _sums_to_nil(table: Columns, channel: str) -> bool:
    spread = table.numbers.get(f"sim_{channel}_std")
    if spread is None:
        return False
    frames = np.maximum(np.nan_to_num(table.numbers.get("n_frames", np.ones(table.n)), nan=1.0), 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        off = (table.numbers[channel] - table.numbers[f"sim_{channel}"]) * frames / spread**2
    good = np.isfinite(off)
    for columns in ((), ("dut",)) if _has_devices(table) else ((),):
        code = table.group(*columns)[good] if columns else np.zeros(int(good.sum()), dtype=np.int64)
        total = np.bincount(code, off[good])
        chance = np.sqrt(np.bincount(code, off[good] ** 2))
        if not len(total) or not bool(np.all(chance > 0.0)):
            continue
        as_near = np.maximum(special.erf(np.abs(total) / chance / np.sqrt(2.0)), _SMALLEST)
        if stats.chi2.sf(-2.0 * float(np.sum(np.log(as_near))), 2 * len(total)) < NIL:
            return True
    return False


def _has_devices(table: Columns) -> bool:
    return "dut" in table.categories and len(table.categories["dut"][1]) > 1


def is_calibrated_by_pixel(table: Columns) -> bool:
    """Whether any signal of a table was calibrated pixel by pixel on it."""
    return any(calibrated_by_pixel(table, entry.name) for entry in table.channels if entry.role is Role.INTENSITY)


def _apart(table: Columns, channel: str, columns: tuple[str, ...], fewest: int, rows_of: int) -> float:
    """Root mean square of the groups' mean mismatches in their own errors; infinite where it cannot be told."""
    entry = next((entry for entry in table.channels if entry.name == channel), None)
    spread = table.numbers.get(f"sim_{channel}_std")
    if entry is None or spread is None:
        return np.inf
    measured, simulated = table.numbers[channel], table.numbers[f"sim_{channel}"]
    frames = np.maximum(np.nan_to_num(table.numbers.get("n_frames", np.ones(table.n)), nan=1.0), 1.0)
    scale = np.abs(simulated) if entry.role is Role.INTENSITY else np.ones(table.n)
    group = table.group(*columns)
    good = np.isfinite(measured) & np.isfinite(simulated) & np.isfinite(spread) & (spread > 0.0) & (scale > 0.0)
    if not good.any():
        return np.inf
    each: FloatArray = (measured - simulated)[good] / scale[good]
    error = spread[good] / np.sqrt(frames[good]) / scale[good]
    code, rows = group[good], np.bincount(group[good])
    known = rows >= rows_of
    if int(known.sum()) < fewest:
        return np.inf
    agreements = []
    for weight in (np.ones(each.size), 1.0 / error**2):  # a plain mean, or the best one
        total = np.maximum(np.bincount(code, weight), _SMALLEST)
        mean = np.bincount(code, weight * each) / total
        own = np.sqrt(np.bincount(code, (weight * error) ** 2)) / total
        z = np.sort(np.abs(mean[known] / own[known]))
        agreements.append(float(np.sqrt(np.mean(z[: int(np.ceil((1.0 - TRIMMED) * z.size))] ** 2))))
    return min(agreements)
