"""Drawings of one cycle: temperatures, maps, and metrics over temperature."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from arl_fixtures.journal.entries import AppliedLimit, Measurement
from arl_fixtures.quantity import convert
from arl_fixtures.report.cycles import Cycle
from arl_fixtures.report.drawing import MARKERS, SHADES, drawn, label
from arl_fixtures.report.maps import ImageMap
from arl_fixtures.report.text import axis_text, half_width

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PERCENTILES: Final = (1.0, 99.0)
LEAST_FOLLOWED_K: Final = 5.0
"""A sensor never further than this from the set temperature follows it; so does one within a quarter of the cycle."""


def temperatures(cycle: Cycle) -> bytes:
    """Mean temperature of each sensor in each step over the bench's time, and what it is off the set temperature."""

    def draw(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.2))
        start = cycle.begin_utc_ns
        attempts = [attempt for attempt in cycle.attempts if attempt.end_utc_ns]
        for attempt in attempts:
            span = [(ns - start) / 3.6e12 for ns in (attempt.begin_utc_ns, attempt.end_utc_ns)]
            above.plot(span, [attempt.begin.set_temperature_c] * 2, color="black", linewidth=2.5, alpha=0.35)
        above.plot([], [], color="black", linewidth=2.5, alpha=0.35, label="set")
        sets_c = [attempt.begin.set_temperature_c for attempt in attempts]
        near_k = max(LEAST_FOLLOWED_K, (max(sets_c) - min(sets_c)) / 4.0) if sets_c else 0.0
        sensors = sorted({name for attempt in attempts if attempt.end for name in attempt.end.temperatures_c})
        for number, name in enumerate(sensors):
            points = [
                (
                    (attempt.end_utc_ns - start) / 3.6e12,
                    attempt.end.temperatures_c[name],
                    attempt.begin.set_temperature_c,
                )
                for attempt in attempts
                if attempt.end is not None and name in attempt.end.temperatures_c
            ]
            hours, degrees, wanted = (np.array(column) for column in zip(*points, strict=True))
            off_k = degrees - wanted
            for axes, values in ((above, degrees), (below, off_k)):
                if axes is below and not np.nanmax(np.abs(off_k), initial=0.0) < near_k:
                    continue
                axes.plot(
                    hours,
                    values,
                    color=SHADES[number % len(SHADES)],
                    marker=MARKERS[number % len(MARKERS)],
                    markersize=2.8,
                    linewidth=0.8,
                    label=label(name) if axes is above else None,
                )
        above.set_ylabel("temperature / °C")
        below.set_ylabel("less set / K")
        below.set_xlabel("bench time since the cycle's begin / h")
        figure.legend(loc="outside lower center", ncols=4)

    return drawn(draw, 4.3)


def map_sheet(maps: Sequence[ImageMap], scales: Sequence[tuple[float, float]]) -> bytes:
    """The maps of one DUT in one step below one another; a missing one says why.

    Args:
        maps: from above to below.
        scales: ends of each one's colours, as from `common_scales`.
    """

    def draw(figure: Figure) -> None:
        rows = figure.subplots(len(maps), 1, squeeze=False)[:, 0]
        for axes, each, (low, high) in zip(rows, maps, scales, strict=True):
            axes.set_title(label(each.title), loc="left")
            axes.grid(visible=False)
            if each.values is None or not np.isfinite(each.values).any():
                _missing(axes, each.reason or "no pixel has a value")
                continue
            image = axes.imshow(
                each.values,
                aspect="auto",
                interpolation="nearest",
                cmap="RdBu_r" if each.centred else "viridis",
                vmin=low,
                vmax=high,
            )
            axes.set_ylabel("row v")
            figure.colorbar(image, ax=axes, pad=0.02, fraction=0.05, extend="both")
        rows[-1].set_xlabel("column u")

    return drawn(draw, 1.0 * len(maps) + 0.1, "png")


def _missing(axes: Axes, reason: str) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    words = label(reason) if len(reason) <= 40 else "\n".join(_lines(reason))
    axes.text(0.5, 0.5, f"missing: {words}", ha="center", va="center", transform=axes.transAxes, fontsize=8)


def _lines(text: str, width: int = 62, most: int = 4) -> list[str]:
    import textwrap

    lines = textwrap.wrap(text, width)
    return lines if len(lines) <= most else [*lines[:most], "…"]


def common_scales(sheets: Sequence[Sequence[ImageMap]]) -> list[tuple[float, float]]:
    """One scale for the same quantity on several sheets, so that colours mean the same; one per map of a sheet."""
    return [_scale(same) for same in zip(*sheets, strict=True)]


def _scale(maps: Sequence[ImageMap]) -> tuple[float, float]:
    """Scale that a few odd pixels cannot blow up."""
    finite = [each.values[np.isfinite(each.values)] for each in maps if each.values is not None]
    ends = [np.percentile(values, PERCENTILES) for values in finite if values.size]
    if not ends:
        return 0.0, 1.0
    low, high = float(min(end[0] for end in ends)), float(max(end[1] for end in ends))
    if maps[0].centred:
        high = max(abs(low), abs(high), 1e-9)
        low = -high
    return (low, high) if high > low else (low - 1e-9, high + 1e-9)


def over_temperature(
    cycle: Cycle, shown_metrics: Sequence[tuple[str, str]], limits: Mapping[tuple[str, str], AppliedLimit]
) -> bytes:
    """Metrics of every DUT over the set temperature, heating filled and cooling open, with 95 % intervals.

    Args:
        cycle: the cycle.
        shown_metrics: metric and scope of each panel.
        limits: limit of each that has one.
    """
    serials = [dut.serial for dut in cycle.record.identity.duts]

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(shown_metrics), 1, squeeze=False, sharex=True)[:, 0]
        for axes, (metric, scope) in zip(panels, shown_metrics, strict=True):
            limit = limits.get((metric, scope))
            found = _points(cycle, metric, scope)
            unit = limit.unit if limit else next((each.unit for _, _, each in found), "")
            for number, serial in enumerate(serials):
                own = [(degrees, ramp, each) for degrees, ramp, each in found if each.dut == serial]
                _panel(axes, own, unit, number)
            limit_lines(axes, limit)
            name = f"{metric}[{scope}]" if scope else metric
            axes.set_title(axis_text(label(name), unit), loc="left")
        panels[-1].set_xlabel("set temperature / °C   (filled: heating, open: cooling)")
        for number, serial in enumerate(serials):
            panels[0].plot([], [], color=SHADES[number % 8], marker=MARKERS[number % 8], label=label(serial))
        figure.legend(loc="outside lower center", ncols=3)

    return drawn(draw, 1.35 * len(shown_metrics) + 0.6)


def _points(cycle: Cycle, metric: str, scope: str) -> list[tuple[float, int, Measurement]]:
    return [
        (attempt.begin.set_temperature_c, attempt.begin.ramp, each)
        for attempt in cycle.finished
        for each in attempt.measurements
        if each.metric == metric and each.scope == scope and each.value is not None and math.isfinite(each.value)
    ]


def _panel(axes: Axes, points: Sequence[tuple[float, int, Measurement]], unit: str, number: int) -> None:
    shade, marker = SHADES[number % len(SHADES)], MARKERS[number % len(MARKERS)]
    for ramp, face in ((1, shade), (-1, "white")):
        own = [(degrees, each) for degrees, way, each in points if way == ramp]
        if own:
            axes.errorbar(
                [degrees + 0.4 * (number - 1) for degrees, _ in own],
                [convert(each.value or 0.0, each.unit, unit) for _, each in own],
                yerr=[half_width(each, unit) for _, each in own],
                color=shade,
                marker=marker,
                markerfacecolor=face,
                markersize=3,
                linewidth=0.6,
                elinewidth=0.8,
            )


def limit_lines(axes: Axes, limit: AppliedLimit | None) -> None:
    """Limits that lie near the values are drawn; far ones would press the values flat."""
    if limit is None:
        return
    low, high = axes.get_ylim()
    span = high - low
    for bound in (limit.lower, limit.upper):
        if bound is not None and low - 2.0 * span <= bound <= high + 2.0 * span:
            axes.axhline(bound, color="#b3261e", linewidth=1.0, linestyle="--")
