"""The diagnosis page's sentences: plain, short, with units, numbers rounded to what they mean."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup, escape

from arl_fixtures.reconcile.columns import Channel
from arl_fixtures.reconcile.diagnosis import ChannelFit, Diagnosis, Finding, ParameterValue
from arl_fixtures.reconcile.roles import Role, unit_of

MUCH_LEFT = 0.3
"""Share of the structured mismatch that stays unexplained from which the page says so at its top."""


def title_of(effect: str) -> str:
    """An effect's id as words: `timing.range_walk` is `Range walk`."""
    if effect == "unknown":
        return "Unknown effect"
    words = effect.rsplit(".", 1)[-1].replace("_", " ").strip()
    return words[:1].upper() + words[1:]


def plain(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, no exponent where it is readable without."""
    if not math.isfinite(value):
        return "unknown"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e9:
        places = digits - 1 - math.floor(math.log10(abs(value)))
        text = f"{round(value, places):.{max(places, 0)}f}"
    return text.replace("-", "−")


def readable(value: float, digits: int = 3) -> str:
    """As `plain`, digits of large whole numbers in groups of three."""
    text = plain(value, digits)
    return counted(int(text)) if text.isdigit() and value >= 10_000 else text


def with_interval(p: ParameterValue) -> tuple[str, str, str]:
    """Value and both ends of its interval, rounded to the second digit of the interval's half width."""
    half = (p.high - p.low) / 2.0
    if not (math.isfinite(half) and half > 0):
        return plain(p.value, 4), plain(p.low, 4), plain(p.high, 4)
    places = 1 - math.floor(math.log10(half))
    size = max(abs(p.value), abs(p.low), abs(p.high))
    if places > 6 or size >= 1e6:
        digits = max(math.floor(math.log10(max(size, half))) + places + 1, 2)
        return plain(p.value, digits), plain(p.low, digits), plain(p.high, digits)
    value, low, high = (f"{round(x, places):.{max(places, 0)}f}".replace("-", "−") for x in (p.value, p.low, p.high))
    return value, low, high


def counted(count: int) -> str:
    """A count in groups of three digits, with narrow spaces that do not break."""
    return f"{count:,}".replace(",", "\u202f")


def share(value: float) -> str:
    """A share in per cent, never a rounded-up hundred."""
    percent = 100.0 * value
    if 99.5 <= percent < 100.0:
        return f"{math.floor(percent * 10) / 10:.1f} %"
    if 0.0 < percent < 0.95:
        return "< 1 %"
    return f"{percent:.0f} %"


def unit_text(unit: str) -> str:
    """A unit, empty for a pure number."""
    return "" if unit == "1" else unit


def display_of(channel: Channel) -> tuple[float, str]:
    """Factor from a mismatch (share or channel unit) to what is shown, and that unit."""
    if channel.role in {Role.INTENSITY, Role.SCATTER}:
        return 100.0, "% of the simulated value"
    if channel.unit == "m":
        return 1000.0, "mm"
    if channel.unit == "1":
        return 1.0, "no unit"
    return 1.0, channel.unit


def column_unit(column: str) -> str:
    """Unit of a column, `1` for none."""
    return unit_of(column)


def column_label(column: str) -> str:
    """A column's name with its unit."""
    unit = column_unit(column)
    return column if unit == "1" else f"{column} [{unit}]"


def breakable(name: str) -> Markup:
    """A name that a narrow column may break behind its dots and underscores only."""
    text = str(escape(name))
    return Markup(text.replace("_", "_<wbr>").replace(".", ".<wbr>"))


def joined(words: Sequence[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    if not diagnosis.findings:
        few = diagnosis.channels[:1] if len(diagnosis.channels) == 1 else [f"all {len(diagnosis.channels)} channels"]
        return (
            f"The simulation agrees with the measurement: in {few[0]} nothing was found beyond noise, calibration "
            "and the scatter between repeated measurements."
        )
    named = [f for f in diagnosis.findings if f.effect != "unknown"]
    strange = [f for f in diagnosis.findings if f.effect == "unknown"]
    parts = []
    if named:
        parts.append("leaves out " + joined([f"{title_of(f.effect).lower()} ({_channels(f)})" for f in named]))
    if strange:
        places = joined(sorted({c for f in strange for c in f.channels}))
        if any(f.law is not None for f in strange):
            parts.append(f"misses something in {places} that no effect of the library explains")
        else:
            parts.append(f"is off by a constant in {places}")
    return f"The simulation disagrees with the measurement: it {' and '.join(parts)}."


def _channels(f: Finding) -> str:
    return joined(f.channels[:3]) if len(f.channels) <= 3 else f"{f.channels[0]} and {len(f.channels) - 1} more"


def chance(diagnosis: Diagnosis) -> str:
    """The false-alarm probability in words."""
    p = diagnosis.false_alarm_probability
    if not diagnosis.findings:
        return (
            f"The strongest hint is no stronger than what chance alone gives in {_odds(p)} without any mismatch; "
            "only what chance gives in fewer than 1 of 20 tables would count."
        )
    return f"Chance alone would give evidence this strong in {_odds(p)} without any mismatch."


def _odds(p: float) -> str:
    if p <= 1e-3:
        return "fewer than 1 of 1000 tables"
    if p < 0.05:
        return f"about 1 of {round(1 / p)} tables"
    if p > 0.995:
        return "nearly every table"
    return f"about {max(round(100 * p), 1)} of 100 tables"


def constant(value: float, channel: Channel, *, zero: bool = False) -> str:
    """A calibration constant with its unit; a signal's is its gain, or its zero."""
    if channel.role in {Role.INTENSITY, Role.SCATTER} and not zero:
        return f"gain {plain(100.0 * value)} %"
    factor, unit = (1000.0, "mm") if channel.unit == "m" else (1.0, unit_text(channel.unit))
    return f"{'zero' if zero else 'offset'} {plain(factor * value)} {unit}".rstrip()


def matters(fit: ChannelFit, floor: float, *, constants: bool, seen: str = "") -> str:
    """How much of a channel's mismatch the findings take away; `seen` says on which rows that took no part."""
    noise, seen = "1 is what the simulation's own noise gives", seen or "On rows that took no part in fitting"
    if fit.after > 1.02 * fit.before:
        return (
            f"{seen} the mean square mismatch grows with the findings from "
            f"{plain(fit.before)} to {plain(fit.after)} ({noise}): they do not hold there."
        )
    if not fit.after < 0.995 * fit.before:
        return f"The mean square mismatch stays at {plain(fit.before)} ({noise})."
    both = "the findings and the constants listed below" if constants else "the findings"
    text = (
        f"{seen}, {both} bring the mean square mismatch from {plain(fit.before)} down to {plain(fit.after)} ({noise})"
    )
    if fit.unexplained > MUCH_LEFT:
        text += f", but {share(fit.unexplained)} of what the table's columns could predict stays unexplained"
    elif fit.before > floor * 1.001:
        removed = min(max((fit.before - fit.after) / (fit.before - floor), 0.0), 1.0)
        text += f": {share(removed)} of what exceeds the noise"
    return text + "."


def left_over(name: str, fit: ChannelFit) -> str:
    """What stays unexplained in a channel."""
    if fit.unexplained <= 0.0:
        return f"{name}: nothing that the table's columns could predict is left."
    return f"{name}: {share(fit.unexplained)} of the structured mismatch stays unexplained."


def size_sentence(typical: float, most: float, noise: float, unit: str, relative: float | None) -> str:
    """How large an effect is beyond calibration, against the noise of one row."""
    note = ""
    if relative is not None and math.isfinite(relative):
        note = f" ({plain(100.0 * relative, 2)} % of the simulated value)"
    tail = f" {unit}" if unit else ""
    return (
        f"half of the rows it touches move by more than {readable(typical, 2)}{tail}{note}, one in twenty by more "
        f"than {readable(most, 2)}{tail}; the noise of one row is {readable(noise, 2)}{tail}."
    )


def bounds_text(bounds: Sequence[str] | Sequence[float], unit: str) -> str:
    """A region's bounds on one column."""
    texts = [b if isinstance(b, str) else readable(b, 4) for b in bounds]
    unit = unit_text(unit)
    tail = f" {unit}" if unit else ""
    if len(texts) == 2 and not isinstance(bounds[0], str):
        return f"{texts[0]} to {texts[1]}{tail}" if texts[0] != texts[1] else f"{texts[0]}{tail}"
    return ", ".join(texts) + tail
