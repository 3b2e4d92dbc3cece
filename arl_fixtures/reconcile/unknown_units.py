"""Columns in a unit that exists and is not known here: `distance_furlong`, `housing_temperature_f`.

A suffix that is no unit at all is part of the name (`distance_raw`): a name needs no unit. But a length in furlongs
is no number without a unit, and what is searched and told of it in metres would be wrong. Units are pint's, and only
one of the dimension that the column's quantity has counts as meant: `range_bin` is no length.
"""

from __future__ import annotations

import functools

import pint

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.roles import UNIT_SUFFIXES, counts_visits

_ANGLE = "radian"
_REFERENCES = {
    "distance": "meter", "range": "meter", "depth": "meter", "temperature": "kelvin", "temp": "kelvin",
    "angle": _ANGLE, "azimuth": _ANGLE, "elevation": _ANGLE, "incidence": _ANGLE, "current": "ampere",
    "voltage": "volt", "power": "watt", "time": "second",
}  # fmt: skip
"""What the word before the unit says, and a unit of its dimension."""
_KNOWN = {
    "meter": ("m", "cm", "mm", "km"), "kelvin": ("c", "k"), _ANGLE: ("deg", "rad"),
    "ampere": ("a", "ma", "ua", "na"), "second": ("s", "ms", "us", "ns", "min", "h"),
}  # fmt: skip
_MEANT = {
    "kelvin": {"f", "degf"}, "meter": {"ft", "in", "yd", "mi"},
    _ANGLE: {"mrad", "urad", "gon", "grad", "gradian", "turn", "arcmin", "arcsec", "arcminute", "arcsecond", "mil"},
}  # fmt: skip
"""Units that are meant whatever pint says."""
SHORTEST = 4
"""Letters of other units: what is shorter is an abbreviation of something else more often."""


@functools.cache
def _registry() -> pint.UnitRegistry[float]:
    return pint.UnitRegistry()


def leave_out_unknown_units(numbers: dict[str, FloatArray], ignored: dict[str, str]) -> None:
    """Leave a channel out whose unit is not known; what else is in one is a number still, and the answer says so.

    Args:
        numbers: columns; those of such channels are taken out.
        ignored: column to what was wrong with it; filled.
    """
    for name in sorted(n for n in numbers if not n.startswith("sim_")):
        wrong, is_channel = unknown_unit(name), f"sim_{name}" in numbers
        if wrong and is_channel:
            ignored[name] = wrong
            for own in (name, f"{name}_std", f"{name}_repeat_std"):
                numbers.pop(own, None)
                numbers.pop(f"sim_{own}", None)
        elif wrong:
            ignored[f"{name} (unit)"] = f"{wrong}; used as a number without unit"
        elif is_channel and (odd := odd_unit(name)):
            ignored[f"{name} (unit)"] = f"is in '{odd}', a unit that is not known here; used as a number without unit"


def unknown_unit(name: str) -> str:
    """What is wrong with a column's unit, empty where nothing is.

    >>> unknown_unit("distance_furlong")
    "is in 'furlong', a unit that is not known here; expected one of m, cm, mm, km"
    >>> [unknown_unit(n) for n in ("distance_m", "distance_raw", "distance_point", "temperature_in", "range_bin")]
    ['', '', '', '', '']
    """
    words = name.split("_")
    if len(words) < 2 or words[-1] in UNIT_SUFFIXES or words[-2] not in _REFERENCES or counts_visits(name):
        return ""
    reference, unit = _REFERENCES[words[-2]], _unit(words[-1])
    if words[-1] not in _MEANT.get(reference, ()) and (unit is None or not unit.is_compatible_with(reference)):
        return ""
    known = f"; expected one of {', '.join(_KNOWN[reference])}" if reference in _KNOWN else ""
    return f"is in '{words[-1]}', a unit that is not known here{known}"


def odd_unit(name: str) -> str:
    """The unit that a column of any other quantity seems to be in and that is not known, empty for none.

    >>> odd_unit("loss_furlong"), odd_unit("loss_m"), odd_unit("signal_raw"), odd_unit("echo_count")
    ('furlong', '', '', '')
    """
    *rest, last = name.split("_")
    known = not rest or last in UNIT_SUFFIXES or counts_visits(name)
    return "" if known or _unit(last) is None else last


@functools.cache
def _unit(text: str) -> pint.Unit | None:
    """A unit that has a dimension; none for other words."""
    if len(text) < SHORTEST or not text.isalpha():
        return None
    try:
        unit = _registry().Unit(text)
    # pint's parser raises whatever its tokeniser happens to raise on text that is no unit
    except (pint.errors.PintError, AssertionError, AttributeError, SyntaxError, TypeError, ValueError):
        return None
    return None if unit.dimensionless else unit
