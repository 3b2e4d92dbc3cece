"""The judged values of a cycle, one row for each limit and DUT: what the verdict table shows."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from arl_fixtures.journal.entries import AppliedLimit, Judgement, Measurement
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.quantity import convert
from arl_fixtures.report.text import expanded


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """One judgement with the measurement it is about (None where nothing was measured) and its attempt."""

    attempt: AttemptRecord
    judgement: Judgement
    measurement: Measurement | None

    @property
    def verdict(self) -> Verdict:
        """As judged."""
        return Verdict(self.judgement.verdict)

    @property
    def reason(self) -> str:
        """What was said of it."""
        said = self.judgement.reason
        return said or (self.measurement.reason if self.measurement is not None else "")

    @property
    def margin(self) -> float:
        """Distance to the nearer limit in expanded uncertainties, negative beyond it; +inf without a value."""
        limit, measured = self.judgement.limit, self.measurement
        if limit is None or measured is None or measured.value is None or not math.isfinite(measured.value):
            return math.inf
        rooms = []
        if limit.upper is not None:
            rooms.append(convert(limit.upper, limit.unit, measured.unit) - measured.value)
        if limit.lower is not None:
            rooms.append(measured.value - convert(limit.lower, limit.unit, measured.unit))
        room, half = min(rooms, default=math.inf), expanded(measured)
        return room / half if half > 0.0 else math.copysign(math.inf, room) if room else 0.0


def judged(attempts: Iterable[AttemptRecord]) -> Iterator[Judged]:
    """Every judgement of some attempts with its measurement."""
    for attempt in attempts:
        measured = {(each.dut, each.metric, each.scope): each for each in attempt.measurements}
        for judgement in attempt.judgements:
            key = (judgement.dut, judgement.metric, judgement.scope)
            yield Judged(attempt=attempt, judgement=judgement, measurement=measured.get(key))


@dataclass(slots=True, kw_only=True)
class ResultRow:
    """All values of one DUT that were held against one limit, over the steps of a cycle.

    Attributes:
        dut, metric, scope, limit: what they have in common.
        values: in the order of the steps.
    """

    dut: str
    metric: str
    scope: str
    limit: AppliedLimit
    values: list[Judged] = field(default_factory=list)

    @property
    def verdict(self) -> Verdict:
        """Worst of the values."""
        return worst(each.verdict for each in self.values)

    @property
    def telling(self) -> Judged:
        """Of the values with the worst verdict the one nearest to its limit, or furthest beyond."""
        verdict = self.verdict
        return min((each for each in self.values if each.verdict is verdict), key=lambda each: each.margin)

    @property
    def range(self) -> tuple[float, float] | None:
        """Smallest and largest value in the limit's unit; None where there is none."""
        numbers = [
            convert(each.measurement.value, each.measurement.unit, self.limit.unit)
            for each in self.values
            if each.measurement is not None
            and each.measurement.value is not None
            and math.isfinite(each.measurement.value)
        ]
        return (min(numbers), max(numbers)) if numbers else None

    @property
    def counts(self) -> Counter[Verdict]:
        """How often which verdict was given."""
        return Counter(each.verdict for each in self.values)


def result_rows(attempts: Iterable[AttemptRecord]) -> list[ResultRow]:
    """The judgements that decide, gathered by DUT, metric, scope and limit, in the order of their first coming."""
    rows: dict[tuple[str, str, str, str], ResultRow] = {}
    for each in judged(attempts):
        judgement, limit = each.judgement, each.judgement.limit
        if limit is None:
            continue
        key = (judgement.dut, judgement.metric, judgement.scope, limit.model_dump_json())
        if key not in rows:
            rows[key] = ResultRow(dut=judgement.dut, metric=judgement.metric, scope=judgement.scope, limit=limit)
        rows[key].values.append(each)
    return list(rows.values())
