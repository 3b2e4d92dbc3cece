"""From judgements to a pytest outcome: one table for all failures at once, INVALID apart from FAIL.

A step whose limits are exceeded fails (`AssertionError`: JUnit failure, Allure failed). A step that could not be
measured is INVALID (JUnit error, Allure broken): it says nothing about the DUT. What was never attempted is NOT RUN.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

from arl_fixtures.errors import ArlError
from arl_fixtures.metrics.judge import Judgement
from arl_fixtures.metrics.verdict import Verdict


@final
class StepFailedError(AssertionError):
    """At least one limit is exceeded; the message is the table."""


@final
class StepInvalidError(ArlError):
    """The step could not be measured, or not be trusted; the message says why."""


def verdict_table(judgements: Sequence[Judgement], *, only_bad: bool = False) -> str:
    """Metric, value, unit, limit, verdict of each judgement as aligned text.

    Args:
        judgements: of one step.
        only_bad: leave out what passes, and say how many that were.
    """
    shown = [judgement for judgement in judgements if judgement.decides]
    passed = [judgement for judgement in shown if judgement.verdict is Verdict.PASS]
    rows = [_row(judgement) for judgement in shown if not only_bad or judgement.verdict is not Verdict.PASS]
    header = ("DUT", "metric", "value", "limit", "verdict", "reason")
    widths = [max(len(row[column]) for row in [header, *rows]) for column in range(len(header))]
    padded = ([cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in [header, *rows])
    lines = ["  ".join(cells).rstrip() for cells in padded]
    if only_bad and passed:
        lines.append(f"and {len(passed)} values within limits")
    return "\n".join(lines)


def _row(judgement: Judgement) -> tuple[str, str, str, str, str, str]:
    measurement = judgement.measurement
    value = "–" if measurement.quantity is None else str(measurement.quantity)
    return (
        measurement.dut,
        measurement.name,
        value,
        str(judgement.limit),
        judgement.verdict.value,
        judgement.reason or measurement.reason,
    )


def raise_for(verdict: Verdict, judgements: Sequence[Judgement], reason: str = "") -> None:
    """Raise what a step's verdict asks for; PASS and CONDITIONAL raise nothing.

    Raises:
        StepFailedError: FAIL.
        StepInvalidError: INVALID or NOT_RUN.
    """
    __tracebackhide__ = True
    table = verdict_table(judgements, only_bad=True)
    if verdict is Verdict.FAIL:
        raise StepFailedError(f"limits exceeded\n{table}")
    if verdict in {Verdict.INVALID, Verdict.NOT_RUN}:
        raise StepInvalidError(f"{verdict.value}: {reason}\n{table}" if reason else f"{verdict.value}\n{table}")
