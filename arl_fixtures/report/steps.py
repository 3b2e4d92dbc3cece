"""What a journal says of each planned step, as test systems want it: outcome, message, table, times."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from arl_fixtures.journal.record import AttemptRecord, SessionRecord, StepRecord
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.report.cycles import cycles_of, why_unfinished
from arl_fixtures.report.results import judged
from arl_fixtures.report.text import limit_text, metric_text, shown, value_text

MODULE: Final = "tests_bench.test_cycle"
FUNCTION: Final = "test_temperature_step"
HEADER: Final = ("DUT", "metric", "value", "limit", "verdict", "reason")


@dataclass(frozen=True, slots=True, kw_only=True)
class StepStory:
    """A planned step.

    Attributes:
        step_id: its id.
        verdict: over all attempts.
        reason: what decided it; empty for PASS.
        attempts: all, in order; none where the session never came to it.
        begin_utc_ns: of the first attempt; 0 without one.
        end_utc_ns: of the last that ended; 0 without one.
        rejudged: the verdict is not that of the test.
    """

    step_id: str
    verdict: Verdict
    reason: str
    attempts: tuple[AttemptRecord, ...]
    begin_utc_ns: int
    end_utc_ns: int
    rejudged: str

    @property
    def name(self) -> str:
        """As pytest names the test."""
        return f"{FUNCTION}[{shown(self.step_id)}]"

    @property
    def passed(self) -> bool:
        """Conditional acceptance is no failure; the properties tell it apart."""
        return self.verdict in {Verdict.PASS, Verdict.CONDITIONAL}

    @property
    def message(self) -> str:
        """One line."""
        said = f"{self.verdict.value}: {self.reason}" if self.reason else self.verdict.value
        return shown(f"{self.rejudged}{said}")

    @property
    def properties(self) -> tuple[tuple[str, str], ...]:
        """Name and value of what identifies the step and its recordings."""
        found = [("verdict", self.verdict.value)]
        if self.attempts:
            found.append(("set_temperature_c", f"{self.attempts[0].begin.set_temperature_c:g}"))
        for attempt in self.attempts:
            if attempt.bag is not None:
                found += [("bag", shown(attempt.bag.path)), ("bag_sha256", shown(attempt.bag.sha256))]
        return tuple(found)

    @property
    def attempt_lines(self) -> tuple[str, ...]:
        """One line per attempt: a later one does not hide an earlier one."""
        return tuple(
            shown(f"attempt {each.begin.attempt}: {each.verdict}{_reason_of(each)}") for each in self.attempts
        )

    def table(self, *, only_bad: bool) -> str:
        """The judged values as aligned text.

        Args:
            only_bad: leave out what passes, and say how many that were.
        """
        rows, passed = [HEADER], 0
        for each in judged(attempt for attempt in self.attempts if attempt.finished):
            said = each.judgement
            if said.limit is None:
                continue
            if only_bad and each.verdict is Verdict.PASS:
                passed += 1
                continue
            name = metric_text(said.metric, said.scope)
            value = value_text(each.measurement, said.limit.unit)
            cells = (shown(said.dut), name, value, limit_text(said.limit), said.verdict, shown(each.reason))
            rows.append(cells)
        widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
        ]
        return "\n".join([*lines, *([f"and {passed} values within limits"] if passed else [])])


def step_stories(record: SessionRecord) -> Iterator[StepStory]:
    """Every planned step of a session, in order."""
    rejudged = f"re-judgement of {record.begin.rejudged_from}: " if record.begin.rejudged_from else ""
    for cycle in cycles_of(record):
        for step_id in cycle.planned:
            step = cycle.steps.get(step_id, StepRecord(step_id))
            yield StepStory(
                step_id=step_id,
                verdict=cycle.step_verdict(step_id),
                reason=cycle.reason(step_id),
                attempts=tuple(step.attempts),
                begin_utc_ns=min((each.begin_utc_ns for each in step.attempts), default=0),
                end_utc_ns=max((each.end_utc_ns for each in step.attempts), default=0),
                rejudged=rejudged,
            )


def _reason_of(attempt: AttemptRecord) -> str:
    reason = why_unfinished(attempt) if not attempt.finished else attempt.end.reason if attempt.end else ""
    return f" ({reason})" if reason else ""
