"""A laser's light-current curves as a table's simulation shows them, and what a shift along the current changes."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import FloatArray, per_table
from arl_fixtures.reconcile.view import IntArray, View

_END = 0.1
"""Share of the currents at each end whose straight line continues the curve."""
_FEWEST = 6
"""Currents from which a device has a curve of its own at a temperature."""

_SEEN = (
    "dut", "pixel_u", "pixel_v", "azimuth_deg", "elevation_deg", "stage_angle_deg", "true_range_m", "incidence_deg",
    "surface", "reflectance", "mixed",
)  # fmt: skip
"""Columns that tell what a row looks at."""
_PAINT = frozenset({"surface", "reflectance"})
"""Of these what says how much light a target sends back."""
_SAME_LIGHT = 0.02
"""Typical spread of the logarithm of light at one current, device and temperature below which rows see the same."""
_DIGITS, _ROUNDS = 6, 30
"""Decimals to which the logarithm of two simulated lights agrees, and rounds of the fit of powers."""

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


def driving_currents(view: View, channel: str) -> tuple[str, ...]:
    """Currents that are driven through a range, that which the simulated signal follows most first.

    A fan's or a supply's current varies as well, and comes first in an alphabet.
    """

    def make() -> tuple[str, ...]:
        light = view.columns.numbers[f"sim_{channel}"]
        told = {name: _told_by(view.columns.numbers[name], light) for name in view.currents() if is_swept(view, name)}
        return tuple(sorted(told, key=lambda name: -told[name]))

    return per_table(view, ("driving currents", channel), make)


def _told_by(drive: FloatArray, light: FloatArray) -> float:
    """Share of a signal's variance between parts of a current's range."""
    good = np.isfinite(drive) & np.isfinite(light)
    if not good.any():
        return 0.0
    drive, light = drive[good], light[good] - light[good].mean()
    place = _PARTS * (drive - drive.min()) / max(float(np.ptp(drive)), 1e-300)
    part = np.minimum(place.astype(np.int64), _PARTS - 1)
    count, sums = np.bincount(part), np.bincount(part, light)
    return float(np.sum(sums**2 / np.maximum(count, 1)) / max(float(light @ light), 1e-300))


def light_current(view: View, channel: str, current: str) -> tuple[FloatArray, FloatArray]:
    """The simulation's signal as a function of the drive current, means over levels."""

    def make() -> tuple[FloatArray, FloatArray]:
        drive = view.columns.numbers[current]
        light = view.columns.numbers[f"sim_{channel}"] / brightness(view, channel, current)
        good = np.isfinite(drive) & np.isfinite(light)
        return _by_levels(drive[good], light[good], *view.span(current))

    return per_table(view, ("light-current", channel, current), make)


def brightness(view: View, channel: str, current: str) -> FloatArray:
    """How much more light each row of the whole table sees than others do at the same current, (n,).

    What is looked at multiplies a laser's light. What rows of one range, incidence and so on see at several currents
    is compared from the darkest to the brightest: of targets a table need not say how white they are. One where all
    rows see the same, or where nothing is seen at several currents.
    """

    def make() -> FloatArray:
        table = view.columns
        light, level = table.numbers[f"sim_{channel}"], _levels(table.numbers[current], *view.span(current))
        alike = table.group("dut", "set_temperature_c")
        good = np.flatnonzero(np.isfinite(light) & (light > 0.0) & (level >= 0))
        factor = np.ones(table.n)
        if not good.size or not _differs(np.log(light[good]), alike[good] * (int(level.max()) + 1) + level[good]):
            return factor
        white, place = _of_white(view, np.log(np.where(light > 0.0, light, 1.0)), level, good)
        power = _power_of_levels(white, place, level[good])
        if power is not None:
            factor[good] = np.exp(np.log(light[good]) - power[level[good]])
        return factor

    return per_table(view, ("brightness", channel, current), make)


def _of_white(view: View, log_light: FloatArray, level: IntArray, good: IntArray) -> tuple[FloatArray, IntArray]:
    """Logarithm of the good rows' light, and the place that each looks at.

    Where the light goes with the reflectance that a table tells it is that of white targets, and what stands at one
    place is one thing, whichever target was shown there at which current.
    """
    table = view.columns
    seen = [name for name in _SEEN if name in table.numbers or name in table.categories]
    white = table.numbers.get("reflectance")
    if white is not None and np.all(white[good] > 0.0):
        place = table.group(*(name for name in seen if name not in _PAINT))
        cell = np.unique(np.stack([place, level])[:, good], axis=1, return_inverse=True)[1].ravel()
        bare = log_light[good] - np.log(white[good])
        if not _differs(bare, cell):
            return bare, place[good]
    return log_light[good], table.group(*seen)[good]


def _levels(drive: FloatArray, low: float, high: float) -> IntArray:
    """Part of the range of each current, (n,); −1 where there is none."""
    part = np.rint((drive - low) / max(high - low, 1e-300) * _LEVELS)
    return np.where(np.isfinite(part), part, -1.0).astype(np.int64)


def _differs(log_light: FloatArray, code: IntArray) -> bool:
    """Whether most rows of one group differ in their light; some near a threshold differ by how warm they are."""
    group = np.unique(code, return_inverse=True)[1]
    mean = np.bincount(group, log_light) / np.bincount(group)
    return float(np.median(np.abs(log_light - mean[group]))) > _SAME_LIGHT


def _power_of_levels(log_light: FloatArray, place: IntArray, level: IntArray) -> FloatArray | None:
    """Logarithm of the power at each level, NaN where nothing tells; None where not all levels are told."""
    rounded = np.round(log_light, _DIGITS)
    seen = np.unique(np.stack([place, level, rounded]), axis=1)  # places, levels and lights in their order
    cell = np.unique(seen[:2], axis=1, return_index=True, return_inverse=True, return_counts=True)
    first, of_cell, count = cell[1], cell[2].ravel(), cell[3]
    rank = np.arange(seen.shape[1]) - first[of_cell]
    at, number = seen[0].astype(np.int64), seen[1].astype(np.int64)
    most = np.zeros(int(at.max()) + 1, dtype=np.int64)
    np.maximum.at(most, at, count[of_cell])
    whole = count[of_cell] == most[at]  # where all that is seen there is seen
    thing = np.unique(np.stack([at, rank])[:, whole], axis=1, return_inverse=True)[1].ravel()
    number, value = number[whole], seen[2][whole]
    shared = np.bincount(thing)[thing] > 1
    if not shared.any():
        return None
    thing, number, value = np.unique(thing[shared], return_inverse=True)[1], number[shared], value[shared]
    power = np.zeros(int(level.max()) + 1)
    told = np.bincount(number, minlength=power.size)
    for _ in range(_ROUNDS):
        own = np.bincount(thing, value - power[number]) / np.bincount(thing)
        power = np.bincount(number, value - own[thing], minlength=power.size) / np.maximum(told, 1)
    return power if np.all(told[np.unique(level)] > 0) else None


def _by_levels(drive: FloatArray, light: FloatArray, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Means of current and light over parts of the range: a source scatters about the level that it was set to.

    Between two readings of one level the light differs by what else differs: their slope says nothing of the current.
    """
    bins = _levels(drive, low, high)
    count = np.bincount(bins)
    used = count > 0
    return _with_threshold(np.bincount(bins, drive)[used] / count[used], np.bincount(bins, light)[used] / count[used])


def _with_threshold(knots: FloatArray, curve: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A curve with the place at which its lines below and above the threshold meet, between two of its levels."""
    if knots.size < 4:
        return knots, curve
    slope = np.diff(curve) / np.diff(knots)
    below, above = slope[:-2], slope[2:]  # of the parts before and after each inner one
    k = int(np.argmax(above - below)) + 1  # between levels k and k + 1
    if above[k - 1] < _KINK * abs(below[k - 1]):
        return knots, curve
    steeper = above[k - 1] - below[k - 1]
    place = (curve[k] - below[k - 1] * knots[k] - curve[k + 1] + above[k - 1] * knots[k + 1]) / steeper
    if not knots[k] < place < knots[k + 1]:
        return knots, curve
    light = curve[k] + below[k - 1] * (place - knots[k])
    return np.insert(knots, k + 1, place), np.insert(curve, k + 1, light)


_PARTS = 20
"""Parts of a current's range over which a signal is compared."""
_KINK = 3.0
"""How much steeper a curve is above its threshold than below."""
_LEVELS = 200.0
"""Parts of a current's range that are told from each other."""


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


def shifted(
    view: View, channel: str, current: str, temperature: str, shift: FloatArray, *, in_proportion: bool = True
) -> FloatArray:
    """Change of each row's simulated signal where its device's curve lies `shift` (A) further up the current, (n,).

    What a row sees multiplies the curve (see `brightness`).
    Every device at every temperature has its own curve; where it has too few currents, the mean over all stands. As
    a threshold grows exponentially with temperature, what a kelvin adds is a share of it: the shift is that of the
    median threshold, and each curve's own is in proportion, unless the shift says by itself how it grows.
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
            own_share = thresholds[index] / middle if in_proportion and thresholds[index] > 0.0 else 1.0
            further = shift[rows] * own_share
            moved[rows] = continued(drive[rows] - further, *found) - continued(drive[rows], *found)
    return np.asarray(np.nan_to_num(moved * brightness(view, channel, current)[view.rows]))


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
        drive = table.numbers[current]
        light = table.numbers[f"sim_{channel}"] / brightness(view, channel, current)
        good = np.isfinite(drive) & np.isfinite(light)
        order = np.lexsort((drive, code))
        order = order[good[order]]
        own = {}
        for rows in np.split(order, np.flatnonzero(np.diff(code[order])) + 1):
            knots, curve = _by_levels(drive[rows], light[rows], *view.span(current))
            if knots.size >= _FEWEST:
                own[int(code[rows[0]])] = knots, curve
        return code, own

    return per_table(view, ("own light-current", channel, current), make)
