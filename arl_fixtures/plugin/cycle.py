"""A session of cycles: start the bench, record references, run steps with attempts, end safely."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.errors import ArlError, DataError, DeviceError, StorageError
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.registry import remember
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.plugin import allure_output, journaling
from arl_fixtures.plugin.outcome import Row, StepInvalidError, rows_of, rows_of_record
from arl_fixtures.plugin.progress import Progress, Screen
from arl_fixtures.plugin.resume import Past
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.plugin.step_runner import REFERENCE_INDEX, StepResult, StepRunner

ATTEMPTS: Final = 3
"""A step that fails to finish this often is INVALID and the cycle goes on."""


@final
class StepOutcome:
    """What a test learns of its step: verdict, reason, and a row for each judged value."""

    def __init__(self, verdict: Verdict, reason: str, rows: Sequence[Row]) -> None:
        self.verdict, self.reason, self.rows = verdict, reason, tuple(rows)


@final
class CycleSession:
    """The cycle under way.

    Args:
        bench: opened.
        files: bench, profile, limits, options.
        plan: steps of the session in order.
        past: what an interrupted session left; empty for a new one.
        screen: where progress is shown.
    """

    def __init__(
        self,
        bench: Bench,
        files: SessionFiles,
        plan: Sequence[CycleStep],
        past: Past,
        *,
        screen: Screen,
    ) -> None:
        self.bench, self.files, self.past = bench, files, past
        self._plan = tuple(plan)
        out = files.options.out
        self._references = out / "references"
        self.progress = Progress(screen, steps_total=len(plan))
        self.runner = StepRunner(
            bench, files.profile, files.limits, hashes=files.hashes, bags=out / "bags", references={}
        )
        self.verdicts: dict[str, Verdict] = {}
        self.journal: Journal | None = None

    def start(self) -> None:
        """Open the journal, start the bench, and record the reference of each DUT that has none.

        Raises:
            DeviceError: a device does not do its part.
            DataError: the output folder cannot be used, or the journal is another bench's.
        """
        self.journal = self.past.open(self.files, self._plan, self.bench.clock)
        self.bench.start()
        for serial in self.bench.serials:
            path = self._references / f"{serial}.npz"
            if path.is_file():
                self.runner.references[serial] = Reference.load(path)
        if len(self.runner.references) < len(self.bench.serials):
            self._record_references()

    def measure(self, step: CycleStep, item: pytest.Item) -> StepOutcome:
        """Run one temperature step, again where a device failed, at most `ATTEMPTS` times in all.

        A step that an earlier session finished is not run again: its verdict is the journal's.

        Raises:
            StepInvalidError: it could not be measured.
        """
        finished = self.past.finished(step.id)
        if finished is not None:
            return self._told(step, finished)
        self.progress.begin(step)
        failures = self.past.failures(step.id)
        while len(failures) < ATTEMPTS:
            attempt = len(failures) + 1
            try:
                result = self._attempt(step, attempt)
            except DeviceError as error:
                failures.append(f"attempt {attempt}: {error}")
                self._recover(item, error)
            except StorageError as error:
                # what cannot be written would be lost at the next step too
                item.session.shouldstop = f"nothing can be recorded, further steps are NOT RUN: {error}"
                raise StepInvalidError(f"INVALID: {error}") from None
            else:
                return self._done(result, item)
        self.verdicts[step.id] = Verdict.INVALID
        self.progress.end(Verdict.INVALID.value)
        raise StepInvalidError("INVALID: " + "; ".join(failures))

    def close(self, reason: str) -> None:
        """End the journal; the bench itself is closed by its own fixture."""
        self.progress.clear()
        if self.journal is not None:
            told = [self.verdicts.get(step.id, Verdict.NOT_RUN) for step in self._plan]
            self.journal.append(journaling.session_end(reason, worst(told)))
            self.journal.close()
            self.journal = None

    def _attempt(self, step: CycleStep, attempt: int) -> StepResult:
        journal = self._open_journal()
        journal.append(journaling.step_begin(step, attempt))
        self.bench.enter_step(step)
        try:
            result = self.runner.run(step, attempt, self.progress)
        except (ArlError, KeyboardInterrupt) as error:
            reason = str(error) or type(error).__name__
            journal.append(journaling.broken_off(step, attempt, reason))
            raise
        journal.append_many(journaling.outcome(result, self.files.options.out, self.files.limits))
        return result

    def _done(self, result: StepResult, item: pytest.Item) -> StepOutcome:
        self.verdicts[result.step.id] = result.verdict
        self.progress.end(result.verdict.value)
        rows = rows_of(result.judgements)
        item.user_properties += properties(result, rows)
        allure_output.describe(result, rows, self.files)
        if not rows and result.verdict in {Verdict.INVALID, Verdict.NOT_RUN}:
            raise StepInvalidError(f"{result.verdict.value}: {result.reason}")
        return StepOutcome(result.verdict, result.reason, rows)

    def _told(self, step: CycleStep, attempt: AttemptRecord) -> StepOutcome:
        verdict = Verdict(self.past.verdict(step.id))
        self.verdicts[step.id] = verdict
        self.progress.begin(step)
        self.progress.end(f"{verdict.value} (journal)")
        reason = attempt.end.reason if attempt.end else ""
        rows = rows_of_record(attempt)
        if not rows and verdict in {Verdict.INVALID, Verdict.NOT_RUN}:
            raise StepInvalidError(f"{verdict.value} (from the journal): {reason}")
        return StepOutcome(verdict, reason, rows)

    def _recover(self, item: pytest.Item, error: DeviceError) -> None:
        """Bring the bench back for another attempt; if that fails, no further step can run."""
        self._open_journal().append(journaling.fault(error, "bench started anew for another attempt"))
        try:
            self.bench.stage.stop()
            self.bench.start()
        except DeviceError as again:
            self._open_journal().append(journaling.fault(again, "session ended, bench made safe"))
            item.session.shouldstop = f"the bench is broken, further steps are NOT RUN: {again}"
            raise StepInvalidError(f"INVALID: {error}; and the bench does not come back: {again}") from None

    def _record_references(self) -> None:
        """Sweep once at the reference temperature before the first cycle: what relative metrics refer to."""
        cycle = self._plan[0].cycle if self._plan else 0
        step = CycleStep(cycle, REFERENCE_INDEX, self.files.profile.reference_c, 1)
        self.progress.begin(step)
        result = self._attempt(step, len(self.past.failures(step.id)) + 1)
        if not result.settle.settled:
            raise DataError(f"no reference could be recorded: {result.settle.reason}")
        self._references.mkdir(parents=True, exist_ok=True)
        for serial, data in result.steps.items():
            if serial in self.runner.references:
                continue
            place = f"cycle {step.cycle}, before its first step, {step.set_temperature_c:g} degC"
            try:
                reference = remember(data, place)
            except NotMeasurableError as reason:
                raise DataError(f"no reference of {serial} could be recorded: {reason}") from None
            reference.save(self._references / f"{serial}.npz")
            self.runner.references[serial] = reference

    def _open_journal(self) -> Journal:
        if self.journal is None:
            raise DataError("the journal is not open")
        return self.journal


def properties(result: StepResult, rows: Sequence[Row]) -> list[tuple[str, object]]:
    """JUnit properties of a step: what it was, and one per judged value."""
    found: list[tuple[str, object]] = [
        ("set_temperature_c", result.step.set_temperature_c),
        ("verdict", result.verdict.value),
        ("settle_s", round(result.settle.duration_s, 1)),
    ]
    if result.bag is not None:
        found += [("bag", result.bag.path.name), ("bag_sha256", result.bag.sha256)]
    return found + [(f"{row.dut}.{row.name}", f"{row.value} {row.verdict.value}") for row in rows]
