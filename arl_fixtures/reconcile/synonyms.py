"""Columns that mean what the observation format has a name for, and bear another one: `az_deg`, `elapsed_min`.

The format gives a name to what effects ask for. Tables of others have their own names for it, and other units. Where
the format's name is free and one column alone can be meant, it is read under that name; the answer is given in the
table's own words (`own_words`). Channels keep their names: they are what is written.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, Given
from arl_fixtures.reconcile.roles import per_metre, suffix

ZERO_CELSIUS_K = 273.15
_WARMEST_K = 1000.0
_TURNED = {"deg": 1.0, "rad": 180.0 / np.pi}
_DEGREES = {**_TURNED, "": 1.0}
_SECONDS = {"s": 1.0, "ms": 1e-3, "min": 60.0}
_LENGTHS = {unit: 1.0 / per_metre(unit) for unit in ("m", "mm", "cm", "km")}
_MEANINGS: tuple[tuple[str, Mapping[str, float], tuple[str, ...]], ...] = (
    ("azimuth_deg", _DEGREES, ("az", "azimuth", "azimuth_angle", "beam_az", "beam_azimuth", "ray_azimuth",
                               "gimbal_az", "mirror_x", "mirror_az", "scan_x", "scan_az", "horizontal_angle")),
    ("elevation_deg", _DEGREES, ("el", "elevation", "elevation_angle", "beam_el", "beam_elevation", "ray_elevation",
                                 "gimbal_el", "mirror_y", "mirror_el", "scan_y", "scan_el", "vertical_angle")),
    ("stage_angle_deg", _TURNED, ("stage", "stage_angle", "stage_position", "table", "table_angle", "turntable",
                                   "turntable_angle", "rotation_stage", "rotary_angle", "rotation_angle")),
    ("incidence_deg", _DEGREES, ("incidence", "incidence_angle", "angle_of_incidence", "aoi", "goniometer")),
    ("time_s", _SECONDS, ("time", "elapsed", "elapsed_time", "timestamp", "clock", "t")),
    ("true_range_m", _LENGTHS, ("true_range", "true_distance", "surveyed", "surveyed_distance", "reference_distance",
                                "reference_range", "rail_position", "rail_pos", "station")),
)  # fmt: skip
"""Name of the format, factor of each unit, and other names without their unit."""
_UNSAID: tuple[tuple[str, frozenset[str], str, tuple[float, float]], ...] = (
    ("c", frozenset({"temp", "temperature"}), "end", (-100.0, 200.0)),
    ("v", frozenset({"vdd", "vcc", "avdd", "dvdd", "vbat", "vbias"}), "any", (-500.0, 500.0)),
    ("v", frozenset({"voltage"}), "end", (-500.0, 500.0)),
    ("a", frozenset({"current"}), "end", (0.0, 20.0)),
)  # fmt: skip
"""Unit that goes without saying, words that call for it, where in a name these stand, and values that it leaves."""
_PIXELS = (
    ("pixel_x", "pixel_y"), ("px", "py"), ("ix", "iy"), ("col", "row"), ("column", "row"), ("px_col", "px_row"),
    ("pixel_col", "pixel_row"), ("pixel_column", "pixel_row"), ("u", "v"), ("x", "y"),
)  # fmt: skip
"""Names of a pixel's column and row, whole numbers both."""


def find_synonyms(numbers: Mapping[str, FloatArray], others: Collection[str]) -> dict[str, Given]:
    """Known name to the column that means it, for covariates only.

    Args:
        numbers: numeric columns; others: names of further columns.
    """
    taken = {*numbers, *others}
    free = [n for n in numbers if not n.startswith("sim_") and f"sim_{n}" not in taken and not _is_scatter(n, taken)]
    found: dict[str, Given] = {}
    for known, units, names in _MEANINGS:
        meant = [
            (n, units[unit]) for n in free for unit in units if n in {f"{w}_{unit}" if unit else w for w in names}
        ]
        if known not in taken and len(meant) == 1:
            found[known] = Given(*meant[0])
    if "pixel_u" not in taken and "pixel_v" not in taken:
        for across, down in _PIXELS:
            if across in free and down in free and _counts(numbers[across]) and _counts(numbers[down]):
                found |= {"pixel_u": Given(across), "pixel_v": Given(down)}
                break
    for name in free:
        known, plus = _in_celsius(name, numbers[name])
        if not known:
            known = _unit_unsaid(name, numbers[name])
        if known and known not in taken and known not in found:
            found[known] = Given(name, 1.0, plus)
    return found


def read_as_known(numbers: dict[str, FloatArray], others: Collection[str]) -> dict[str, Given]:
    """Rename and convert columns in place; what was read under which known name."""
    found = find_synonyms(numbers, others)
    for known, given in found.items():
        values = numbers.pop(given.name)
        numbers[known] = values if given.times == 1.0 and not given.plus else values * given.times + given.plus
    return found


def _in_celsius(name: str, values: FloatArray) -> tuple[str, float]:
    """Known name of a temperature in another spelling or in kelvin, and what is to be added; empty for none."""
    for ending in ("_degc", "_celsius", "_deg_c"):
        if name.endswith(ending):
            return f"{name.removesuffix(ending)}_c", 0.0
    finite = values[np.isfinite(values)]
    if name.endswith("_k") and finite.size and 100.0 < float(finite.min()) <= float(finite.max()) < _WARMEST_K:
        return f"{name.removesuffix('_k')}_c", -ZERO_CELSIUS_K
    return "", 0.0


def _unit_unsaid(name: str, values: FloatArray) -> str:
    """Known name of a temperature, voltage or current whose unit nobody wrote, where its values leave no other.

    >>> _unit_unsaid("apd_temp", np.array([-3.0, 68.0])), _unit_unsaid("vdd_monitor", np.array([3.2, 3.4]))
    ('apd_temp_c', 'vdd_monitor_v')
    >>> _unit_unsaid("temp", np.array([280.0, 350.0])), _unit_unsaid("room_temp_trend", np.array([0.0, 1.0]))
    ('', '')
    """
    finite = values[np.isfinite(values)]
    if suffix(name) or not finite.size:
        return ""
    words = name.split("_")
    for unit, spelt, places, (low, high) in _UNSAID:
        at_end = words[-1] in spelt or (places == "any" and any(word in spelt for word in words))
        if at_end and low <= float(finite.min()) and float(finite.max()) <= high:
            return f"{name}_{unit}"
    return ""


def _counts(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(finite.size) and bool(np.array_equal(finite, np.round(finite)))


def _is_scatter(name: str, names: Collection[str]) -> bool:
    return name.endswith("_std") and f"sim_{name.removesuffix('_std')}" in names
