"""From judgements to a pytest outcome: one table for all failures at once, INVALID apart from FAIL.

A step whose limits are exceeded fails (`AssertionError`: JUnit failure, Allure failed). A step that could not be
measured is INVALID (raised while the step is set up: JUnit error, Allure broken): it says nothing about the DUT.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from arl_fixtures.errors import ArlError
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.judge import Judgement
from arl_fixtures.metrics.verdict import Verdict


@final
class StepFailedError(AssertionError):
    """At least one limit is exceeded; the message is the table."""


@final
class StepInvalidError(ArlError):
    """The step could not be measured, or not be trusted; the message says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One judged value as text, from a live step or from a journal."""

    dut: str
    name: str
    value: str
    limit: str
    verdict: Verdict
    reason: str

    @property
    def cells(self) -> tuple[str, ...]:
        """The row's columns."""
        return (self.dut, self.name, self.value, self.limit, self.verdict.value, self.reason)


HEADER = ("DUT", "metric", "value", "limit", "verdict", "reason")


def rows_of(judgements: Sequence[Judgement]) -> list[Row]:
    """The judgements that decide, as rows."""
    return [
        Row(
            dut=judgement.measurement.dut,
            name=judgement.measurement.name,
            value="–" if judgement.measurement.quantity is None else str(judgement.measurement.quantity),
            limit=str(judgement.limit),
            verdict=judgement.verdict,
            reason=judgement.reason or judgement.measurement.reason,
        )
        for judgement in judgements
        if judgement.decides
    ]


def rows_of_record(attempt: AttemptRecord) -> list[Row]:
    """The same from a journal."""
    values = {(each.dut, each.metric, each.scope): each for each in attempt.measurements}
    rows = []
    for judgement in attempt.judgements:
        limit = judgement.limit
        if limit is None:
            continue
        measured = values.get((judgement.dut, judgement.metric, judgement.scope))
        value = "–"
        if measured is not None and measured.value is not None:
            value = f"{measured.value:.6g} ± {measured.u or 0.0:.2g} {measured.unit}".rstrip()
        rows.append(
            Row(
                dut=judgement.dut,
                name=f"{judgement.metric}[{judgement.scope}]" if judgement.scope else judgement.metric,
                value=value,
                limit=f"{limit.lower} … {limit.upper} {limit.unit}",
                verdict=Verdict(judgement.verdict),
                reason=judgement.reason,
            )
        )
    return rows


def verdict_table(rows: Sequence[Row], *, only_bad: bool = False) -> str:
    """Metric, value, limit, verdict of each row as aligned text.

    Args:
        rows: of one step.
        only_bad: leave out what passes, and say how many that were.
    """
    shown = [row.cells for row in rows if not only_bad or row.verdict is not Verdict.PASS]
    widths = [max(len(cells[column]) for cells in [HEADER, *shown]) for column in range(len(HEADER))]
    padded = ([cell.ljust(width) for cell, width in zip(cells, widths, strict=True)] for cells in [HEADER, *shown])
    lines = ["  ".join(cells).rstrip() for cells in padded]
    if only_bad and len(shown) < len(rows):
        lines.append(f"and {len(rows) - len(shown)} values within limits")
    return "\n".join(lines)


def raise_for(verdict: Verdict, rows: Sequence[Row], reason: str = "") -> None:
    """Raise what a step's verdict asks for; PASS and CONDITIONAL raise nothing.

    Raises:
        StepFailedError: FAIL.
        StepInvalidError: INVALID or NOT_RUN.
    """
    __tracebackhide__ = True
    table = verdict_table(rows, only_bad=True)
    if verdict is Verdict.FAIL:
        raise StepFailedError(f"limits exceeded\n{table}")
    if verdict in {Verdict.INVALID, Verdict.NOT_RUN}:
        raise StepInvalidError(f"{verdict.value}: {reason}\n{table}" if reason else f"{verdict.value}\n{table}")
