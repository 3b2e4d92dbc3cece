"""The sections about many cycles: trends, cycles to the limit, what the cycles are worth in use, correlations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from arl_fixtures.report.blocks import Block, Cell, Picture, Section, Table, Text
from arl_fixtures.report.cycles import Cycle
from arl_fixtures.report.drawing import MARKERS, SHADES, drawn, label
from arl_fixtures.report.figures import limit_lines
from arl_fixtures.report.lifetime import Equivalent, LifetimeModel, Stress, fatigue, rate
from arl_fixtures.report.series import FALSE_DISCOVERIES, Series, series_over
from arl_fixtures.report.text import (
    axis_text,
    half_width,
    limit_text,
    metric_text,
    shown,
    unbroken,
    with_unit,
)
from arl_fixtures.report.trend import FEWEST_CYCLES, HORIZON, Law

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DAYS_A_YEAR: Final = 365.25
LEAST_Q: Final = 0.001
"""Nobody decides otherwise for a false discovery rate below this."""
PANELS: Final = 4
"""Of one drawing: two rows of drawings fill a page."""


def trends(cycles: Sequence[Cycle], pictures: dict[str, bytes]) -> Section:
    """Each value over cycles with its interval, limit, trend, and the cycle at which it will stand at its limit."""
    temperatures_c = cycles[-1].telling_temperatures_c
    found = series_over(cycles, temperatures_c)
    if not found:
        return Section(title="Trends over cycles", blocks=(Text(text="No value with a limit was measured."),))
    found.sort(key=lambda each: (each.trend is None, each.crossing.expected if each.crossing else math.inf))
    moving = [each for each in found if each.trend is not None]
    blocks: list[Block] = [Text(text=_method(temperatures_c, len(found)))]
    most = max(len(each.points) for each in found)
    if moving:
        blocks.append(_table(moving))
    elif most < FEWEST_CYCLES:
        told = f"No trend can be told yet: values of {most} {'cycle' if most == 1 else 'cycles'}."
        blocks.append(Text(text=told))
    else:
        blocks.append(Text(text=f"No trend in any of {len(found)} values."))
    if moving and len(moving) < len(found):
        still = dict.fromkeys(metric_text(each.metric, each.scope) for each in found if each.trend is None)
        blocks.append(Text(text=f"No trend in {len(found) - len(moving)} values, of {', '.join(still)}."))
    serials = [dut.serial for dut in cycles[-1].record.identity.duts]
    for place, temperature_c in enumerate(temperatures_c):
        # everything at the reference temperature; elsewhere what moves at any temperature
        moved = {(each.metric, each.scope) for each in moving}
        drawn_here = [
            each
            for each in found
            if each.temperature_c == temperature_c and (not place or (each.metric, each.scope) in moved)
        ]
        blocks += _pictures(drawn_here, serials, pictures, temperature_c, place + 1)
    return Section(title="Trends over cycles", blocks=tuple(blocks))


def _method(temperatures_c: Sequence[float], count: int) -> str:
    temperatures = ", ".join(f"{each:g}" for each in temperatures_c)
    return (
        f"Each of {count} values is followed over the cycles at its last step at {temperatures} °C. There is a "
        "trend where the slope of a straight line differs from zero (Student's t) with at most "
        f"{100 * FALSE_DISCOVERIES:g} % false discoveries among all trends reported (Benjamini-Hochberg); at least "
        f"{FEWEST_CYCLES} cycles are needed. The law is a straight line, or a power law where its AICc is lower by "
        "2. The interval of the cycle at the limit holds with 95 % the cycle at which a measured value stands at the "
        "limit, if the law goes on as it did."
    )


def _table(moving: Sequence[Series]) -> Table:
    return Table(
        header=("DUT", "Metric", "At", "Law", "Per cycle now", "Limit", "Cycle at the limit (95\u00a0%)", "q"),
        rows=tuple(_trend_row(each) for each in moving),
        weights=(1.45, 3.1, 0.75, 1.45, 1.35, 1.4, 2.0, 0.8),
        note="A power law is given with its exponent; a value that moves away from its limit will not stand at it. "
        "q: false discovery rate at which the trend is just reported. Cycles are counted from cycle 0.",
    )


def _trend_row(each: Series) -> tuple[Cell, ...]:
    fit = each.trend
    assert fit is not None
    newest = float(max(each.points))
    law = "straight line" if fit.law is Law.LINEAR else f"power law {fit.exponent:.2f}"
    per_cycle = fit.value(newest + 1.0) - fit.value(newest)
    return (
        Cell(shown(each.dut)),
        Cell(metric_text(each.metric, each.scope)),
        Cell(unbroken(f"{each.temperature_c:g} °C")),
        Cell(law),
        Cell(unbroken(with_unit(f"{per_cycle:+.3g}", each.limit.unit))),
        Cell(limit_text(each.limit)),
        crossing_cell(each),
        Cell(f"{each.q:.1g}" if each.q >= LEAST_Q else unbroken(f"< {LEAST_Q:g}")),
    )


def crossing_cell(each: Series) -> Cell:
    """When a value will stand at its limit, in words."""
    found = each.crossing
    if found is None:
        return Cell("moves away")
    newest = float(max(each.points))
    if found.expected <= newest:
        return Cell("at its limit now", "fail")
    if math.isinf(found.earliest):
        return Cell(f"not within {HORIZON:g} cycles", "pass")
    latest = "never excluded" if math.isinf(found.latest) else f"{found.latest:.0f}"
    expected = "" if math.isinf(found.expected) else f"{found.expected:.0f} "
    return Cell(f"{expected}({found.earliest:.0f} … {latest})", "conditional")


def _pictures(
    found: Sequence[Series], serials: Sequence[str], pictures: dict[str, bytes], temperature_c: float, place: int
) -> list[Block]:
    panels: dict[tuple[str, str], list[Series]] = {}
    for each in found:
        panels.setdefault((each.metric, each.scope), []).append(each)
    keys, blocks = list(panels), list[Block]()
    for start in range(0, len(keys), PANELS):
        shown_keys = keys[start : start + PANELS]
        name = f"trends-{place}-{start // PANELS + 1}.svg"
        pictures[name] = _draw_trends([panels[key] for key in shown_keys], serials)
        titles = ", ".join(metric_text(*key) for key in shown_keys)
        blocks.append(
            Picture(
                name=name,
                caption=f"At {temperature_c:g} °C: values over cycles with 95 % intervals; lines: trends; dashed: "
                "limits near enough.",
                alt=f"Trends at {temperature_c:g} °C of {titles}",
                share=0.49,
            )
        )
    return blocks


def _draw_trends(panels: Sequence[Sequence[Series]], serials: Sequence[str]) -> bytes:
    def draw(figure: Figure) -> None:
        rows = figure.subplots(len(panels), 1, squeeze=False, sharex=True)[:, 0]
        for axes, together in zip(rows, panels, strict=True):
            for each in together:
                _draw_series(axes, each, serials.index(each.dut) if each.dut in serials else 0)
            first = together[0]
            limit_lines(axes, first.limit)
            axes.set_title(axis_text(label(metric_text(first.metric, first.scope)), first.limit.unit), loc="left")
        rows[-1].set_xlabel("cycle")
        rows[-1].xaxis.get_major_locator().set_params(integer=True)
        for number, serial in enumerate(serials):
            rows[0].plot([], [], color=SHADES[number % 8], marker=MARKERS[number % 8], label=label(serial))
        figure.legend(loc="outside lower center", ncols=3)

    return drawn(draw, 1.3 * len(panels) + 0.6)


def _draw_series(axes: Axes, each: Series, number: int) -> None:
    shade, marker = SHADES[number % len(SHADES)], MARKERS[number % len(MARKERS)]
    # side by side: intervals of several DUTs at one cycle would hide one another
    aside = (number - 1) * (max(each.points) - min(each.points)) / 80.0
    axes.errorbar(
        [cycle + aside for cycle in each.points],
        each.values,
        yerr=[half_width(point, each.limit.unit) for point in each.points.values()],
        color=shade,
        marker=marker,
        markersize=3,
        linestyle="none",
        elinewidth=0.8,
    )
    if each.trend is not None:
        n = np.linspace(min(each.points), max(each.points), 60)
        axes.plot(n, [each.trend.value(float(at)) for at in n], color=shade, linewidth=1.0)


def stress_of(cycles: Sequence[Cycle], dut: int) -> Stress:
    """What a DUT went through, from its housing's own sensor, or from the set temperatures where it told nothing.

    Args:
        cycles: all that count.
        dut: position of the DUT, from 0; its housing's sensor is T2 for the first.
    """
    swings: list[float] = []
    dwell: list[tuple[float, float]] = []
    for cycle in cycles:
        own = []
        for attempt in cycle.attempts:
            if attempt.end is None or not attempt.finished:
                continue
            temperature = attempt.end.temperatures_c.get(f"T{dut + 2}", math.nan)
            own.append(temperature if math.isfinite(temperature) else attempt.begin.set_temperature_c)
            dwell.append(((attempt.end_utc_ns - attempt.begin_utc_ns) / 3.6e12, own[-1]))
        if own:
            swings.append(max(own) - min(own))
    return Stress(swings_k=tuple(swings), dwell=tuple(dwell))


def lifetime(cycles: Sequence[Cycle], model: LifetimeModel | None) -> Section:
    """What the cycles of this report are worth in use, as ranges."""
    title = "Lifetime equivalence"
    if model is None:
        return Section(title=title, blocks=(Text(text="No lifetime file was given (--lifetime FILE)."),))
    stress = stress_of(cycles, 0)
    use = model.use
    hours = sum(hours for hours, _ in stress.dwell)
    count = len(stress.swings_k)
    least, most = (f"{pick(stress.swings_k, default=0.0):.0f}" for pick in (min, max))
    each = f"a swing of {least} K" if least == most else f"swings of {least} to {most} K"
    swings = each if count else "no swing"
    intro = (
        f"{count} {'cycle' if count == 1 else 'cycles'} with {swings} and {hours:.1f} h at temperature "
        f"(housing of the first DUT), against use '{shown(model.name)}' version {model.version}: swings of "
        f"{_range(use.swing_k)} K, "
        f"{_range(use.swings_per_year)} a year, {_range(use.temperature_c)} °C for {_range(use.hours_per_year)} h a "
        f"year ({shown(use.source)}). Ranges follow from the ranges of the parameters; they are no confidence "
        "intervals, and they hold only for a mechanism that the model describes."
    )
    rows = [
        (
            Cell("Coffin-Manson, " + unbroken(f"q = {_range(each.exponent)}")),
            Cell(shown(each.name)),
            *_worth(fatigue(stress, each, use), "swings"),
            Cell(shown(each.source)),
        )
        for each in model.coffin_manson
    ]
    rows += [
        (
            Cell("Arrhenius, " + unbroken(f"Ea = {_range(each.activation_energy_ev)} eV")),
            Cell(shown(each.name)),
            *_worth(rate(stress, each, use), "h"),
            Cell(shown(each.source)),
        )
        for each in model.arrhenius
    ]
    table = Table(
        header=("Model", "Mechanism", "Worth in use", "Time in use", "Source"),
        rows=tuple(rows),
        weights=(2.0, 2.0, 1.8, 1.5, 3.2),
    )
    return Section(title=title, blocks=(Text(text=intro), table))


def _range(ends: tuple[float, float]) -> str:
    return f"{ends[0]:g}" if ends[0] == ends[1] else f"{ends[0]:g} … {ends[1]:g}"


def _worth(found: Equivalent, what: str) -> tuple[Cell, Cell]:
    low, high = found.amount
    return (
        Cell(unbroken(f"{_figure(low)} … {_figure(high)} {what}")),
        Cell(unbroken(_time_in_use(*found.years))),
    )


def _time_in_use(low: float, high: float) -> str:
    """A range of years in the largest unit that its upper end fills."""
    for unit, per_year in (("years", 1.0), ("days", DAYS_A_YEAR)):
        if high * per_year >= 1.0:
            return f"{_figure(low * per_year)} … {_figure(high * per_year)} {unit}"
    per_year = 24.0 * DAYS_A_YEAR
    return f"{_figure(low * per_year)} … {_figure(high * per_year)} h"


def _figure(value: float) -> str:
    """Two digits, or all before the point: no range of a lifetime is known better."""
    return f"{value:.0f}" if abs(value) >= 10.0 else f"{value:.2g}"
