"""A session of cycles: start the bench, record references, run steps with attempts, end safely."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Final, TextIO, final

import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.errors import DataError, DeviceError
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.registry import remember
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.plugin import allure_output
from arl_fixtures.plugin.outcome import StepInvalidError
from arl_fixtures.plugin.progress import Progress
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.plugin.step_runner import REFERENCE_INDEX, StepResult, StepRunner

ATTEMPTS: Final = 3
"""A step that fails to finish this often is INVALID and the cycle goes on."""

RecordProperty = Callable[[str, object], None]


@final
class CycleSession:
    """The cycle under way.

    Args:
        bench: opened.
        files: bench, profile, limits, options.
        steps_total: temperature steps of the session, for the time left.
        terminal: pytest's terminal reporter, None when there is none.
    """

    def __init__(self, bench: Bench, files: SessionFiles, *, steps_total: int, terminal: Any) -> None:  # noqa: ANN401
        self.bench, self.files = bench, files
        out = files.options.out
        self._references = out / "references"
        writer = getattr(terminal, "_tw", None)
        is_terminal = bool(getattr(writer, "hasmarkup", False)) and sys.stdout.isatty()
        stream: TextIO = getattr(writer, "_file", None) or sys.stderr
        self.progress = Progress(stream, terminal=is_terminal, steps_total=steps_total)
        self.runner = StepRunner(
            bench, files.profile, files.limits, hashes=files.hashes, bags=out / "bags", references={}
        )
        self.results: list[StepResult] = []

    def start(self) -> None:
        """Start the bench, and record the reference of each DUT that has none.

        Raises:
            DeviceError: a device does not do its part.
            DataError: the output folder cannot be used.
        """
        self.bench.start()
        for serial in self.bench.serials:
            path = self._references / f"{serial}.npz"
            if path.is_file():
                self.runner.references[serial] = Reference.load(path)
        if len(self.runner.references) < len(self.bench.serials):
            self._record_references()

    def measure(self, step: CycleStep, item: pytest.Item, record_property: RecordProperty) -> StepResult:
        """Run one temperature step, again where a device failed, at most `ATTEMPTS` times.

        Raises:
            StepInvalidError: it could not be measured.
        """
        self.progress.begin(step)
        result, failures = None, []
        for attempt in range(1, ATTEMPTS + 1):
            try:
                result = self.runner.run(step, attempt, self.progress)
                break
            except DeviceError as error:
                failures.append(f"attempt {attempt}: {error}")
                self._recover(item, error)
        if result is None:
            self.progress.end(Verdict.INVALID.value)
            raise StepInvalidError("INVALID: " + "; ".join(failures))
        self.results.append(result)
        self.progress.end(result.verdict.value)
        _record(result, record_property)
        allure_output.describe(result, self.files)
        if result.verdict in {Verdict.INVALID, Verdict.NOT_RUN} and not result.judgements:
            raise StepInvalidError(f"{result.verdict.value}: {result.reason}")
        return result

    def close(self) -> None:
        """End the display; the bench itself is closed by its own fixture."""
        self.progress.clear()

    def _recover(self, item: pytest.Item, error: DeviceError) -> None:
        """Bring the bench back for another attempt; if that fails, no further step can run."""
        try:
            self.bench.stage.stop()
            self.bench.start()
        except DeviceError as again:
            item.session.shouldstop = f"the bench is broken: {again}"
            raise StepInvalidError(f"INVALID: {error}; and the bench does not come back: {again}") from None

    def _record_references(self) -> None:
        """Sweep once at the reference temperature before the first cycle: what relative metrics refer to."""
        step = CycleStep(self.files.options.first_cycle, REFERENCE_INDEX, self.files.profile.reference_c, 1)
        self.progress.begin(step)
        result = self.runner.run(step, 1, self.progress)
        if not result.settle.settled:
            raise DataError(f"no reference could be recorded: {result.settle.reason}")
        self._references.mkdir(parents=True, exist_ok=True)
        for serial, data in result.steps.items():
            if serial in self.runner.references:
                continue
            try:
                place = f"cycle {step.cycle}, before its first step, {step.set_temperature_c:g} degC"
                reference = remember(data, place)
            except NotMeasurableError as reason:
                raise DataError(f"no reference of {serial} could be recorded: {reason}") from None
            reference.save(self._references / f"{serial}.npz")
            self.runner.references[serial] = reference


def _record(result: StepResult, record_property: RecordProperty) -> None:
    """Values as JUnit properties: one per judged value, and what the step was."""
    record_property("set_temperature_c", result.step.set_temperature_c)
    record_property("verdict", result.verdict.value)
    record_property("settle_s", round(result.settle.duration_s, 1))
    if result.bag is not None:
        record_property("bag", result.bag.path.name)
        record_property("bag_sha256", result.bag.sha256)
    for judgement in result.judgements:
        quantity = judgement.measurement.quantity
        if judgement.decides and quantity is not None:
            name = f"{judgement.measurement.dut}.{judgement.measurement.name}"
            value = f"{quantity.value:.6g} {quantity.unit} (u {quantity.u:.2g})"
            record_property(name, f"{value} {judgement.verdict.value}")
