"""Numbers, times and foreign texts as a reader of the report sees them."""

from __future__ import annotations

import math
import unicodedata
from datetime import UTC, date, datetime
from typing import Final

from arl_fixtures.journal.entries import AppliedLimit, Measurement
from arl_fixtures.quantity import convert, coverage_factor

COVERAGE: Final = 0.95
NOTHING: Final = "–"
_HIDDEN: Final = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
_MOST: Final = 400


def shown(text: str) -> str:
    """A text from a device or a person, on one line and of bounded length; what would not be seen is spelt out.

    Control and direction marks could make a report say something else than its bytes.

    >>> shown("SN\\u202e1\\n")
    'SN\\\\u202e1\\\\x0a'
    """
    spelt = "".join(_spelt(character) for character in text)
    return spelt if len(spelt) <= _MOST else spelt[:_MOST] + "…"


def _spelt(character: str) -> str:
    if unicodedata.category(character) not in _HIDDEN:
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def no_formula(value: object) -> object:
    """A text that a spreadsheet would take for a formula is marked as text."""
    return f"'{value}" if isinstance(value, str) and value[:1] in {"=", "+", "@", "\t", "\r"} else value


def rounded(value: float, half_width: float) -> str:
    """Value and half width of its interval, the latter to two digits: `-0.012 ± 0.034`."""
    if not math.isfinite(value):
        return str(value)
    if not math.isfinite(half_width) or half_width <= 0.0:
        return f"{value:.6g}"
    digits = 1 - math.floor(math.log10(half_width))
    if digits > 9 or digits < -4:
        return f"{value:.6g} ± {half_width:.2g}"
    digits = max(digits, 0)
    # a value that rounds to nothing has no sign
    return f"{round(value, digits) + 0.0:.{digits}f} ± {half_width:.{digits}f}"


def expanded(measurement: Measurement) -> float:
    """Expanded uncertainty with 95 % coverage, in the measurement's unit; 0 where it has none."""
    if not measurement.u:
        return 0.0
    return coverage_factor(math.inf if measurement.dof is None else measurement.dof, COVERAGE) * measurement.u


def half_width(measurement: Measurement, unit: str) -> float:
    """Half width of the 95 % interval in another unit; 0 where there is no value."""
    if measurement.value is None:
        return 0.0
    # an interval has no zero of its own: only the scale matters
    zero = convert(0.0, measurement.unit, unit)
    return abs(convert(expanded(measurement), measurement.unit, unit) - zero)


def value_text(measurement: Measurement | None, unit: str = "") -> str:
    """A measured value with its 95 % interval, in `unit` where one is given."""
    if measurement is None or measurement.value is None:
        return NOTHING
    unit = unit or measurement.unit
    value = convert(measurement.value, measurement.unit, unit)
    return with_unit(rounded(value, half_width(measurement, unit)), unit)


def with_unit(number: str, unit: str) -> str:
    """Number and unit, brackets where a ± would leave the unit to one of the two."""
    if unit in {"", "1"}:
        return number
    text = unit_text(unit)
    # the degree of an angle is the one unit that follows without a space (ISO 80000-1, 7.1.4)
    behind = text if text == "°" else f" {text}"
    return f"({number}){behind}" if "±" in number else f"{number}{behind}"


def range_text(low: float, high: float, unit: str, half_width: float = 0.0) -> str:
    """Two ends with the same decimals; one number where they are alike then.

    Args:
        low: smallest value.
        high: largest.
        unit: of both.
        half_width: of one value's interval; its first two digits set the decimals, as in `rounded`. Without it, the
            first three digits of the larger end do.
    """
    largest = max(abs(low), abs(high))
    digits = 2 - math.floor(math.log10(largest)) if largest > 0.0 and math.isfinite(largest) else 0
    if 0.0 < half_width < math.inf:
        digits = 1 - math.floor(math.log10(half_width))
    if digits > 9 or digits < -4:
        ends = [f"{end:.3g}" for end in (low, high)]
    else:
        # an end that rounds to nothing has no sign
        decimals = 0 if low.is_integer() and high.is_integer() else max(digits, 0)
        ends = [f"{round(end, decimals) + 0.0:.{decimals}f}" for end in (low, high)]
    return with_unit(ends[0] if ends[0] == ends[1] else " … ".join(ends), unit)


def unbroken(text: str) -> str:
    """A text that stays on one line."""
    return text.replace(" ", "\u00a0")


def unit_text(unit: str) -> str:
    """A unit as it is printed."""
    return {"degC": "°C", "deg": "°", "1": "", "um": "µm", "us": "µs"}.get(unit, unit)


def axis_text(name: str, unit: str) -> str:
    """What an axis shows: `name / unit`, a pure number by its name alone."""
    printed = unit_text(unit)
    return f"{name} / {printed}" if printed else name


def limit_text(limit: AppliedLimit | None) -> str:
    """Bounds with their unit."""
    if limit is None:
        return NOTHING
    if limit.lower is None:
        return with_unit(f"≤ {limit.upper:g}", limit.unit)
    if limit.upper is None:
        return with_unit(f"≥ {limit.lower:g}", limit.unit)
    return with_unit(f"{limit.lower:g} … {limit.upper:g}", limit.unit)


def metric_text(metric: str, scope: str) -> str:
    """Metric with its scope."""
    return f"{metric}[{shown(scope)}]" if scope else metric


def utc_text(utc_ns: int) -> str:
    """Date and time, UTC; a dash for 0, which means never."""
    if not utc_ns:
        return NOTHING
    return datetime.fromtimestamp(utc_ns // 1_000_000_000, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def utc_date(utc_ns: int) -> date:
    """Calendar day, UTC."""
    return datetime.fromtimestamp(utc_ns // 1_000_000_000, UTC).date()


def duration_text(seconds: float) -> str:
    """Hours and minutes."""
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"{hours} h {minutes:02d} min"
