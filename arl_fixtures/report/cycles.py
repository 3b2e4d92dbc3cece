"""Journals sorted into cycles: what was planned, what became of it, and which step decided."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from arl_fixtures.errors import DataError
from arl_fixtures.journal.record import AttemptRecord, SessionRecord, StepRecord, read_journal
from arl_fixtures.journal.resume import JOURNAL_PATTERN
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.report.text import shown

_CYCLE_OF: Final = re.compile(r"c(\d+)-")
DEFAULT_REFERENCE_C: Final = 25.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """One cycle of one session.

    Attributes:
        number: cycle count.
        record: the journal it is in.
        planned: step ids in order.
        steps: those that were begun, by id, in order of the plan.
        reference: the sweep before the first cycle that relative metrics refer to; None where the session made none.
    """

    number: int
    record: SessionRecord
    planned: tuple[str, ...]
    steps: dict[str, StepRecord]
    reference: StepRecord | None

    def step_verdict(self, step_id: str) -> Verdict:
        """Verdict of a planned step; NOT_RUN when the session never came to it."""
        step = self.steps.get(step_id)
        return Verdict.NOT_RUN if step is None else Verdict(step.verdict)

    @property
    def verdict(self) -> Verdict:
        """Worst of its planned steps."""
        return worst(self.step_verdict(step_id) for step_id in self.planned)

    @property
    def decided_by(self) -> str:
        """The first step with the cycle's verdict and what was said of it; empty for PASS."""
        verdict = self.verdict
        if verdict is Verdict.PASS:
            return ""
        step_id = next((each for each in self.planned if self.step_verdict(each) is verdict), "")
        return f"{shown(step_id)}: {shown(self.reason(step_id))}" if step_id else "no step was planned"

    def reason(self, step_id: str) -> str:
        """Why a step has its verdict."""
        step = self.steps.get(step_id)
        if step is None:
            return "never begun"
        if not step.finished:
            return "; ".join(f"attempt {each.begin.attempt}: {why_unfinished(each)}" for each in step.attempts)
        telling = [each for each in step.attempts if each.finished and each.verdict == step.verdict]
        return _what_decided(telling[-1]) if telling and step.verdict != "PASS" else ""

    @property
    def attempts(self) -> Iterator[AttemptRecord]:
        """Every attempt at every planned step."""
        return (attempt for step in self.steps.values() for attempt in step.attempts)

    @property
    def finished(self) -> Iterator[AttemptRecord]:
        """Every attempt that ran to its end; several at one step where it was repeated."""
        return (attempt for attempt in self.attempts if attempt.finished)

    @property
    def reference_c(self) -> float:
        """Set temperature at which cycles are compared: that of the reference sweep, or 25 °C."""
        return DEFAULT_REFERENCE_C if self.reference is None else self.reference.begin.set_temperature_c

    def at_temperature(self, temperature_c: float) -> AttemptRecord | None:
        """The last finished attempt at the set temperature nearest to this one."""
        finished = list(self.finished)
        if not finished:
            return None
        return min(
            reversed(finished),
            key=lambda each: (abs(each.begin.set_temperature_c - temperature_c), -each.begin.step_index),
        )

    @property
    def telling_temperatures_c(self) -> tuple[float, ...]:
        """Set temperatures of the steps that stand for a cycle: reference, coldest, hottest; fewer where alike."""
        temperatures = [each.begin.set_temperature_c for each in self.finished]
        if not temperatures:
            return (self.reference_c,)
        return tuple(dict.fromkeys((self.reference_c, min(temperatures), max(temperatures))))

    def telling(self) -> list[AttemptRecord]:
        """The steps that stand for a cycle, from cold to hot."""
        wanted = sorted(self.telling_temperatures_c)
        chosen = [attempt for each in wanted if (attempt := self.at_temperature(each)) is not None]
        return list({(each.begin.step_id, each.begin.attempt): each for each in chosen}.values())

    def selected(self, wanted: Sequence[str]) -> list[AttemptRecord]:
        """Finished steps by their id, or all of them; of a step that was repeated the last attempt.

        Args:
            wanted: step ids, or only ``all``; empty for those that `telling` gives.

        Raises:
            DataError: a step is not among the finished ones.
        """
        if not wanted:
            return self.telling()
        last = {each.begin.step_id: each for each in self.finished}
        if list(wanted) == ["all"]:
            return list(last.values())
        unknown = [each for each in wanted if each not in last]
        if unknown:
            known = next(iter(last), "none")
            raise DataError(f"no finished step '{unknown[0]}' in cycle {self.number}; there is e.g. {known}")
        return [last[each] for each in wanted]

    @property
    def begin_utc_ns(self) -> int:
        """Begin of its first step; 0 when it had none."""
        return min((each.begin_utc_ns for each in self.attempts), default=0)

    @property
    def end_utc_ns(self) -> int:
        """End of its last step; 0 when none ended."""
        return max((each.end_utc_ns for each in self.attempts), default=0)


def load_cycles(paths: Sequence[Path]) -> list[Cycle]:
    """The cycles in output folders and journals, in the order of their count, then of their time.

    In a folder its sessions count, its re-judgements do not: those are named by their own file.

    Raises:
        DataError: no journal, a damaged one, or journals of different DUTs.
    """
    records = [read_journal(path) for given in paths for path in _journals(given)]
    first = records[0]
    for record in records[1:]:
        serials = [tuple(dut.serial for dut in each.identity.duts) for each in (first, record)]
        if serials[0] != serials[1]:
            of = [", ".join(shown(serial) for serial in each) for each in serials]
            raise DataError(f"{record.path}: is of DUTs {of[1]}, {first.path} of {of[0]}; report them one by one")
    cycles = [cycle for record in records for cycle in cycles_of(record)]
    return sorted(cycles, key=lambda cycle: (cycle.number, cycle.record.lines[0].utc_ns, cycle.record.path.name))


def _journals(given: Path) -> list[Path]:
    if given.is_file():
        return [given]
    sessions = sorted(path for path in given.glob(JOURNAL_PATTERN) if path.stem[8:].isdigit())
    if not sessions:
        raise DataError(f"{given}: is neither a journal nor a folder with one ({JOURNAL_PATTERN})")
    return sessions


def cycles_of(record: SessionRecord) -> Iterator[Cycle]:
    """The cycles of one session, in order of their count."""
    numbers = {step_id: step.begin.cycle for step_id, step in record.steps.items()}
    for step_id in record.begin.plan:
        said = _CYCLE_OF.match(step_id)
        numbers.setdefault(step_id, int(said[1]) if said else max(record.begin.cycles, default=0))
    reference = next((step for step in record.steps.values() if step.begin.step_index < 0), None)
    for number in sorted(set(record.begin.cycles) | {numbers[step_id] for step_id in record.begin.plan}):
        planned = tuple(step_id for step_id in record.begin.plan if numbers[step_id] == number)
        steps = {step_id: record.steps[step_id] for step_id in planned if step_id in record.steps}
        yield Cycle(number=number, record=record, planned=planned, steps=steps, reference=reference)


def why_unfinished(attempt: AttemptRecord) -> str:
    """What broke an attempt off."""
    return "the session ended within this attempt" if attempt.end is None else attempt.end.reason or "broken off"


def _what_decided(attempt: AttemptRecord) -> str:
    """The first judgement with the attempt's verdict; what the attempt itself says where no value decided."""
    for each in attempt.judgements:
        if each.limit is not None and each.verdict == attempt.verdict:
            name = f"{each.metric}[{each.scope}]" if each.scope else each.metric
            return f"{each.dut} {name}: {each.reason}"
    return attempt.end.reason if attempt.end is not None else ""
