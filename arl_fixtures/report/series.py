"""The same value of the same DUT over cycles, its trend, and when it will stand at its limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from arl_fixtures.journal.entries import AppliedLimit, Measurement
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.correlation import Correlation, Multiplicity, correlate, false_discovery
from arl_fixtures.quantity import convert
from arl_fixtures.report.cycles import Cycle
from arl_fixtures.report.results import judged
from arl_fixtures.report.text import metric_text
from arl_fixtures.report.trend import Crossing, Fit, crossing, fit_trend

OPERATING: Final = "operating"
NO_PERFORMANCE: Final = ("operating_scatter", "twin_", "power_paper_difference")
"""Beginnings of the names of metrics that are statistics of the signals, or say how well something is described."""
CHANGE: Final = "_change"
FALSE_DISCOVERIES: Final = 0.05
"""Share of false ones among the trends that are reported."""


@dataclass(slots=True, kw_only=True)
class Series:
    """One value over cycles.

    Attributes:
        dut, metric, scope: whose and what.
        temperature_c: set temperature at which it is followed.
        limit: the newest that was applied.
        points: cycle count and measurement, ascending; one per cycle.
        fit: the law that fits best; None for too few cycles.
        q: smallest false discovery rate at which the trend is reported; NaN without a fit.
    """

    dut: str
    metric: str
    scope: str
    temperature_c: float
    limit: AppliedLimit
    points: dict[int, Measurement] = field(default_factory=dict)
    fit: Fit | None = None
    q: float = math.nan

    @property
    def trend(self) -> Fit | None:
        """The fit, where there is a trend."""
        return self.fit if self.q <= FALSE_DISCOVERIES else None

    @property
    def values(self) -> list[float]:
        """In the limit's unit."""
        return [convert(each.value or 0.0, each.unit, self.limit.unit) for each in self.points.values()]

    @property
    def bound(self) -> float | None:
        """The limit that the trend moves towards; None where there is no trend or no limit on that side."""
        if self.trend is None:
            return None
        return self.limit.upper if self.trend.slope > 0.0 else self.limit.lower

    @property
    def crossing(self) -> Crossing | None:
        """When the value will stand at that limit."""
        bound, trend = self.bound, self.trend
        return None if bound is None or trend is None else crossing(trend, bound, float(max(self.points)))


def series_over(cycles: Sequence[Cycle], temperatures_c: Sequence[float]) -> list[Series]:
    """The values with a limit over cycles, each at its cycle's last step nearest to a set temperature.

    Args:
        cycles: in order; of two with the same count the later one stands.
        temperatures_c: at which cycles are compared, degrees Celsius.
    """
    found: dict[tuple[str, str, str, float], Series] = {}
    for cycle in cycles:
        for temperature_c in temperatures_c:
            attempt = cycle.at_temperature(temperature_c)
            for each in judged([attempt] if attempt is not None else []):
                said, measured = each.judgement, each.measurement
                if said.limit is None or measured is None:
                    continue
                if measured.value is None or not math.isfinite(measured.value):
                    continue
                key = (said.dut, said.metric, said.scope, temperature_c)
                series = found.setdefault(
                    key,
                    Series(
                        dut=said.dut,
                        metric=said.metric,
                        scope=said.scope,
                        temperature_c=temperature_c,
                        limit=said.limit,
                    ),
                )
                series.limit = said.limit
                series.points[cycle.number] = measured
    for series in found.values():
        repeatability = max((_repeatability(each, series.limit.unit) for each in series.points.values()), default=0.0)
        series.fit = fit_trend(list(series.points), series.values, repeatability)
    p = [math.nan if each.fit is None else each.fit.p for each in found.values()]
    for series, q in zip(found.values(), false_discovery(p, Multiplicity.BENJAMINI_HOCHBERG), strict=True):
        series.q = q
    return list(found.values())


def _repeatability(measurement: Measurement, unit: str) -> float:
    """What repeats differ by: the type A part. What is the same in every cycle makes no trend uncertain."""
    u = math.hypot(*(part.u for part in measurement.contributions if part.kind == "A"))
    return abs(convert(u, measurement.unit, unit) - convert(0.0, measurement.unit, unit))


def correlations(attempts: Sequence[AttemptRecord], serial: str) -> list[Correlation]:
    """Every operating signal of a DUT with every performance metric, over steps, given set temperature and ramp.

    Args:
        attempts: finished ones, in the order of time.
        serial: of the DUT.
    """
    signals: dict[str, list[float]] = {}
    metrics: dict[str, list[float]] = {}
    for number, attempt in enumerate(attempts):
        for each in attempt.measurements:
            if each.dut != serial or each.value is None or each.metric.startswith(NO_PERFORMANCE):
                continue
            if each.metric == OPERATING:
                columns, name = signals, each.scope
            else:
                columns, name = metrics, metric_text(each.metric, each.scope)
            columns.setdefault(name, [math.nan] * len(attempts))[number] = each.value
    given = {
        "set temperature": [attempt.begin.set_temperature_c for attempt in attempts],
        "ramp": [float(attempt.begin.ramp) for attempt in attempts],
    }
    # against one reference a change has the ranks of the value itself
    same = {name for name in metrics if CHANGE in name and name.replace(CHANGE, "", 1) in metrics}
    metrics = {name: values for name, values in metrics.items() if name not in same}
    # what was the same in every step, as the ramp at a single temperature, explains nothing
    varying = {name: values for name, values in given.items() if len(set(values)) > 1}
    return correlate(signals, metrics, given=varying)
