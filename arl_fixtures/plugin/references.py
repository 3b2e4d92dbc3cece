"""References of relative metrics: recorded once, before the first cycle, and kept beside the journal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, final

from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.errors import DataError
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.metrics.collect import collect
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.registry import remember
from arl_fixtures.metrics.step import StepData
from arl_fixtures.plugin.step_runner import StepRunner
from arl_fixtures.recording.names import inside
from arl_fixtures.recording.reader import StepBag

REFERENCE_INDEX: Final = -1


@final
class References:
    """The references of a bench's DUTs.

    Args:
        folder: where they are kept, one file each.
        serials: the DUTs.
        alive: a sign of life for the guard, after each DUT.
    """

    def __init__(self, folder: Path, serials: Sequence[str], alive: Callable[[], None] = lambda: None) -> None:
        self._folder, self._serials, self._alive = folder, tuple(serials), alive
        self.known: dict[str, Reference] = {}

    def load(self) -> None:
        """Read those that are there.

        Raises:
            DataError: a file is damaged.
        """
        for serial in self._serials:
            path = self._path(serial)
            if path.is_file():
                self.known[serial] = Reference.load(path)

    @property
    def missing(self) -> tuple[str, ...]:
        """DUTs without a reference."""
        return tuple(serial for serial in self._serials if serial not in self.known)

    def keep(self, step: CycleStep, steps: Mapping[str, StepData], lost: Mapping[str, str]) -> None:
        """Make references of a reference sweep, of DUTs that have none.

        Args:
            step: the sweep's step.
            steps: measured data by serial number.
            lost: DUTs that did not deliver; they get none, and their relative metrics say so.

        Raises:
            DataError: a DUT that delivered has no usable reference.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        place = f"cycle {step.cycle}, before its first step, {step.set_temperature_c:g} degC"
        for serial in self.missing:
            if serial in lost or serial not in steps:
                continue
            try:
                reference = remember(steps[serial], place)
            except NotMeasurableError as reason:
                raise DataError(f"no reference of {serial} could be recorded: {reason}") from None
            reference.save(self._path(serial))
            self._alive()
            self.known[serial] = reference

    def _path(self, serial: str) -> Path:
        return self._folder / f"{serial}.npz"


def reference_step(cycle: int, set_temperature_c: float) -> CycleStep:
    """The sweep that references are made of."""
    return CycleStep(cycle, REFERENCE_INDEX, set_temperature_c, 1)


def from_bag(
    runner: StepRunner,
    step: CycleStep,
    attempt: AttemptRecord,
    folder: Path,
    alive: Callable[[], None] = lambda: None,
) -> dict[str, StepData]:
    """What a finished reference sweep of an interrupted session measured, of DUTs that delivered every angle.

    Args:
        runner: of the same bench and profile.
        step: the sweep's step.
        attempt: its finished attempt.
        folder: of the journal, to which the bag's path is relative.
        alive: a sign of life for the guard, at each block that was read.

    Raises:
        DataError: the bag cannot be read.
    """
    if attempt.bag is None:
        return {}
    blocks = _each(StepBag(inside(folder, attempt.bag.path)).blocks(), alive)
    collected = collect(blocks, runner.bench.serials)
    expected = runner.angle_count(step)
    whole = {serial: each for serial, each in collected.statistics.items() if len(each) == expected}
    conditions = Conditions(
        cycle=step.cycle,
        step_index=step.index,
        set_temperature_c=step.set_temperature_c,
        ramp=step.ramp,
        settled=True,
        temperatures_c=attempt.end.temperatures_c if attempt.end is not None else {},
    )
    return runner.step_data(whole, conditions, expected_angles=expected)


def _each(blocks: Iterable[AngleBlock], alive: Callable[[], None]) -> Iterator[AngleBlock]:
    for block in blocks:
        yield block
        alive()
