"""A laser's light-current curves as a table's simulation shows them, and what a shift along the current changes."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import FloatArray, per_table
from arl_fixtures.reconcile.view import IntArray, View

_END = 0.1
"""Share of the currents at each end whose straight line continues the curve."""
_FEWEST = 6
"""Currents from which a device has a curve of its own at a temperature."""

_LEAST_RANGE, _MOST_LEVELS, _OFTEN = 0.03, 12, 20
"""Range of a current that is driven to few levels over its highest, their number, and rows that each has."""


def is_swept(view: View, current: str) -> bool:
    """Whether the current is driven through a range, rather than scattering about its set value.

    A narrow range is driven where its few levels come back to the last digit.
    """
    low, high = view.span(current)
    most = max(abs(high), abs(low))
    if high - low > 0.3 * most:
        return True
    values = view.columns.numbers[current]
    levels = np.unique(values[np.isfinite(values)])
    return high - low > _LEAST_RANGE * most and 1 < levels.size <= _MOST_LEVELS and _OFTEN * levels.size < values.size


def light_current(view: View, channel: str, current: str) -> tuple[FloatArray, FloatArray]:
    """The simulation's signal as a function of the drive current, means over 2000 bins."""

    def make() -> tuple[FloatArray, FloatArray]:
        drive, light = view.columns.numbers[current], view.columns.numbers[f"sim_{channel}"]
        good = np.isfinite(drive) & np.isfinite(light)
        low, high = view.span(current)
        bins = np.rint((drive[good] - low) / max(high - low, 1e-300) * 2000.0).astype(np.int64)
        count = np.bincount(bins, minlength=2001)
        used = count > 0
        return (
            np.bincount(bins, drive[good], 2001)[used] / count[used],
            np.bincount(bins, light[good], 2001)[used] / count[used],
        )

    return per_table(view, ("light-current", channel, current), make)


def continued(drive: FloatArray, knots: FloatArray, curve: FloatArray) -> FloatArray:
    """The light-current curve at any drive current (A): beyond its ends straight on, not below no light.

    The threshold of a laser that is driven well above it moves the curve by more than the lowest current: held at its
    end, the curve would not move there at all.
    """
    light = np.interp(drive, knots, curve)
    if knots.size < 2:
        return light
    below = _end_slope(knots - knots[0], curve) * np.minimum(drive - knots[0], 0.0)
    above = _end_slope((knots[-1] - knots)[::-1], curve[::-1]) * np.minimum(knots[-1] - drive, 0.0)
    # a laser below its threshold gives none, whatever the straight line says
    return np.asarray(np.maximum(light + below + above, min(float(curve.min()), 0.0)))


def _end_slope(away: FloatArray, curve: FloatArray) -> float:
    """Slope of a curve at its end, by the distance from it; over levels that lie apart, not within the first one."""
    wide = _END * float(away[-1])
    near = away <= wide
    if away[near][-1] < 0.5 * wide:
        near = away <= away[~near][0] + wide
    centred = away[near] - away[near].mean()
    return float(centred @ curve[near]) / float(centred @ centred)


def shifted(view: View, channel: str, current: str, temperature: str, shift: FloatArray) -> FloatArray:
    """Change of each row's simulated signal where its device's curve lies `shift` (A) further up the current, (n,).

    Every device at every temperature has its own curve; where it has too few currents, the mean over all stands. As
    a threshold grows exponentially with temperature, what a kelvin adds is a share of it: the shift is that of the
    median threshold, and each curve's own is in proportion.
    """
    drive = view.number(current)
    knots, curve = light_current(view, channel, current)
    moved = continued(drive - shift, knots, curve) - continued(drive, knots, curve)
    code, own = _own_curves(view, channel, current, temperature)
    code = code[view.rows]
    thresholds = {index: _threshold(*found) for index, found in own.items()}
    middle = float(np.median([t for t in thresholds.values() if t > 0.0] or [1.0]))
    for index, found in own.items():
        rows = np.flatnonzero(code == index)
        if rows.size:
            further = shift[rows] * (thresholds[index] / middle if thresholds[index] > 0.0 else 1.0)
            moved[rows] = continued(drive[rows] - further, *found) - continued(drive[rows], *found)
    return np.asarray(np.nan_to_num(moved))


def _threshold(knots: FloatArray, curve: FloatArray) -> float:
    """Current at which a straight line through the upper half of a curve meets no light; 0 where it does nowhere."""
    upper = curve > 0.5 * float(curve.max())
    if np.count_nonzero(upper) < 2:
        return 0.0
    slope, start = np.polyfit(knots[upper], curve[upper], 1)
    return float(np.clip(-start / slope, 0.0, knots[-1])) if slope > 0.0 else 0.0


def _own_curves(
    view: View, channel: str, current: str, temperature: str
) -> tuple[IntArray, dict[int, tuple[FloatArray, FloatArray]]]:
    """Group of every row of the whole table, and the curve of those that hold enough currents."""

    def make() -> tuple[IntArray, dict[int, tuple[FloatArray, FloatArray]]]:
        table = view.columns
        code = table.group("dut", "set_temperature_c")
        if "set_temperature_c" not in table.numbers and temperature:
            warm = np.rint(np.nan_to_num(table.numbers[temperature])).astype(np.int64)
            code = np.unique(np.stack([code, warm]), axis=1, return_inverse=True)[1].ravel().astype(np.int64)
        drive, light = table.numbers[current], table.numbers[f"sim_{channel}"]
        good = np.isfinite(drive) & np.isfinite(light)
        order = np.lexsort((drive, code))
        order = order[good[order]]
        own = {}
        for rows in np.split(order, np.flatnonzero(np.diff(code[order])) + 1):
            knots, place, count = np.unique(drive[rows], return_inverse=True, return_counts=True)
            if knots.size >= _FEWEST:
                own[int(code[rows[0]])] = knots, np.bincount(place, light[rows]) / count
        return code, own

    return per_table(view, ("own light-current", channel, current), make)
