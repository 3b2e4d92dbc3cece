"""A session of cycles: start the bench, record references, run steps with attempts, end safely."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, final

import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.errors import DataError, InterlockError, StorageError
from arl_fixtures.guard.guarding import Guard
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.plugin import allure_output, journaling
from arl_fixtures.plugin.attempts import Attempts, SessionOverError
from arl_fixtures.plugin.campaign import why_stop
from arl_fixtures.plugin.outcome import Row, StepInvalidError, rows_of, rows_of_record
from arl_fixtures.plugin.progress import Progress, Screen
from arl_fixtures.plugin.references import References, from_bag, reference_step
from arl_fixtures.plugin.resume import Past
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.plugin.step_runner import StepResult, StepRunner

INTRODUCTION_S: Final = 6.0
"""How long the DUTs are listened to, from power on, until each has said who it is."""


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
        guard: whose pauses and stops the session heeds; attached to the bench.
    """

    def __init__(
        self,
        bench: Bench,
        files: SessionFiles,
        plan: Sequence[CycleStep],
        past: Past,
        *,
        screen: Screen,
        guard: Guard | None = None,
    ) -> None:
        self.bench, self.files, self.past = bench, files, past
        self._plan = tuple(plan)
        out = files.options.out
        self._guard = guard
        self._references = References(out / "references", bench.serials, self._alive)
        self.progress = Progress(screen, steps_total=len(plan))
        self.runner = StepRunner(
            bench,
            files.profile,
            files.limits,
            hashes=files.hashes,
            bags=out / "bags",
            references=self._references.known,
            alive=self._alive,
        )
        self.verdicts: dict[str, Verdict] = {}
        self._reasons: dict[str, str] = {}
        self._interrupted = ""
        self.journal: Journal | None = None
        self._attempts: Attempts | None = None

    def start(self) -> None:
        """Open the journal, start the bench, and record the reference of each DUT that has none.

        Raises:
            DeviceError: a device does not do its part, or a DUT is another one.
            InterlockError: the guard stopped the bench.
            DataError: the output folder cannot be used, or the journal is another bench's.
            StorageError: a bag is where one of this session will go.
        """
        self._require_room()
        last_stop = self._guard.last_stop if self._guard is not None else ""
        journal = self.journal = self.past.open(self.files, self._plan, self.bench.clock, last_stop=last_stop)
        if last_stop:
            journal.append(journaling.note(f"before this session: {last_stop}"))
        self._attempts = Attempts(
            self.runner, self.files, self.past, journal=journal, progress=self.progress, guard=self._guard
        )
        try:
            self.bench.start()
            self.bench.require_own_duts(INTRODUCTION_S)
        except InterlockError as error:
            journal.append(journaling.safe_stop(error, self._guard.actions if self._guard is not None else ()))
            raise
        self._references.load()
        if self._references.missing:
            self._record_references()

    def measure(self, step: CycleStep, item: pytest.Item) -> StepOutcome:
        """Run one temperature step, again where a device failed, at most `ATTEMPTS` times in all.

        A step that an earlier session finished is not run again: its verdict is the journal's.

        Raises:
            StepInvalidError: it could not be measured.
        """
        try:
            return self._measure(step, item)
        except StepInvalidError as invalid:
            self._reasons.setdefault(step.id, str(invalid))
            raise
        except KeyboardInterrupt as interrupt:
            self._interrupted = f"interrupted in step {step.id}: {interrupt or 'Ctrl-C'}"
            raise
        finally:
            self._end_cycle(step, item)

    def _measure(self, step: CycleStep, item: pytest.Item) -> StepOutcome:
        finished = self.past.finished(step.id)
        if finished is not None:
            return self._told(step, finished)
        self.progress.begin(step)
        try:
            result = self._open().run(step)
        except SessionOverError as over:
            item.session.shouldstop = str(over)
            self._invalid(step)
            raise StepInvalidError(f"INVALID: {over}") from None
        except StepInvalidError:
            self._invalid(step)
            raise
        return self._done(result, item)

    def close(self, reason: str) -> None:
        """End the journal; the bench itself is closed by its own fixture.

        Args:
            reason: why; empty when nothing more was to be run.
        """
        if self.journal is not None:
            told = [self.verdicts.get(step.id, Verdict.NOT_RUN) for step in self._plan]
            left = [step.id for step in self._plan if step.id not in self.verdicts]
            by_itself = f"ended before step {left[0]}" if left else "finished"
            with self.journal as journal:
                journal.append(journaling.session_end(self._interrupted or reason or by_itself, worst(told)))
            self.journal = None
        self.progress.clear()

    def _require_room(self) -> None:
        """Find a bag in the way now, not after hours at its step."""
        for step in self._plan:
            path = self.runner.bag_path(step, len(self.past.failures(step.id)) + 1)
            if self.past.finished(step.id) is None and path.exists():
                raise StorageError(f"{path}: a bag of this name exists already and is not overwritten")

    def _end_cycle(self, step: CycleStep, item: pytest.Item) -> None:
        """After a cycle's last step: journal its verdict and what decided it; see whether the campaign goes on."""
        steps = [each for each in self._plan if each.cycle == step.cycle]
        if self.journal is None or not steps or step != steps[-1] or step.id not in self.verdicts:
            return
        told = {each.id: self.verdicts.get(each.id, Verdict.NOT_RUN) for each in steps}
        verdict = worst(told.values())
        decisive = next(step_id for step_id, each in told.items() if each is verdict)
        reason = self._reasons.get(decisive, "")
        decided_by = "" if verdict is Verdict.PASS else f"{decisive}: {reason}".rstrip(": ")
        ended, known = journaling.cycle_end(step.cycle, verdict, decided_by), self.past.cycle_ends
        if known.get(step.cycle) != ended:
            self.journal.append(ended)
        elif step.cycle != max(known):
            # told from the journal, as its rules were judged then
            return
        why = why_stop(self.files.stop, self.files.options.out, step.cycle, alive=self._alive)
        if why:
            self.journal.append(journaling.note(f"campaign ended after cycle {step.cycle}: {why}"))
            item.session.shouldstop = f"campaign ended after cycle {step.cycle}: {why}"

    def _alive(self) -> None:
        """A sign of life for the guard, from stretches that ask no device."""
        if self._guard is not None:
            self._guard.beat()

    def _invalid(self, step: CycleStep) -> None:
        self.verdicts[step.id] = Verdict.INVALID
        self.progress.end(Verdict.INVALID.value)

    def _done(self, result: StepResult, item: pytest.Item) -> StepOutcome:
        self.verdicts[result.step.id] = result.verdict
        self._reasons[result.step.id] = result.reason
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
        reason = self._reasons[step.id] = attempt.end.reason if attempt.end else ""
        rows = rows_of_record(attempt)
        if not rows and verdict in {Verdict.INVALID, Verdict.NOT_RUN}:
            raise StepInvalidError(f"{verdict.value} (from the journal): {reason}")
        return StepOutcome(verdict, reason, rows)

    def _record_references(self) -> None:
        """Sweep once at the reference temperature before the first cycle: what relative metrics refer to."""
        cycle = self._plan[0].cycle if self._plan else 0
        step = reference_step(cycle, self.files.profile.reference_c)
        finished = self.past.finished(step.id)
        if finished is not None:
            # the session ended between recording and remembering
            recorded = from_bag(self.runner, step, finished, self.files.options.out, self._alive)
            self._references.keep(step, recorded, {})
            return
        self.progress.begin(step)
        result = self._open().run(step)
        if not result.settle.settled:
            raise DataError(f"no reference could be recorded: {result.settle.reason}")
        self._references.keep(step, result.steps, result.lost)

    def _open(self) -> Attempts:
        if self._attempts is None:
            raise DataError("the journal is not open")
        return self._attempts


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
