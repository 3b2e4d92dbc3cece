"""One temperature step: settle, soak, sweep, record, measure, judge."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean
from typing import Protocol, final

import arl_fixtures
from arl_fixtures.bench.bench import Bench, BenchReading
from arl_fixtures.bench.profile import CycleStep, Profile
from arl_fixtures.bench.settle import SettleReport
from arl_fixtures.bench.sweep import sweep
from arl_fixtures.devices.dut_status import DutError
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.geometry_store import EXPECTATIONS
from arl_fixtures.metrics.instruments import expired_instruments
from arl_fixtures.metrics.judge import Judgement, judge, overall
from arl_fixtures.metrics.limits import LimitSet
from arl_fixtures.metrics.reference import Reference
from arl_fixtures.metrics.registry import all_metrics, expect, measure
from arl_fixtures.metrics.statistics import SweepStatistics
from arl_fixtures.metrics.step import StepData
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.recording.bag_folder import BagReceipt
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.names import bag_name
from arl_fixtures.recording.writer import StepBagWriter


class Listener(Protocol):
    """Who wants to know how a step goes on (terminal, journal)."""

    def settling(self, reading: BenchReading, elapsed_s: float) -> None:
        """The housings are on their way."""

    def soaking(self, reading: BenchReading) -> None:
        """The step rests at its temperature."""

    def angle(self, index: int, count: int, angle_deg: float) -> None:
        """One more angle is recorded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """What became of one attempt at a step.

    Attributes:
        step: which.
        attempt: from 1.
        settle: how settling ended.
        bag: the recording; None when nothing was recorded.
        steps: measured data by serial number.
        judgements: all, deciding or not.
        verdict: the worst of those that decide.
        reason: what decided it, in words.
        temperatures_c: mean over the sweep by sensor.
        lost: DUTs that stopped delivering, by serial number, and why; the others were measured without them.
    """

    step: CycleStep
    attempt: int
    settle: SettleReport
    bag: BagReceipt | None
    steps: Mapping[str, StepData]
    judgements: Sequence[Judgement]
    verdict: Verdict
    reason: str
    temperatures_c: Mapping[str, float] = field(default_factory=dict)
    lost: Mapping[str, str] = field(default_factory=dict)


@final
class StepRunner:
    """Runs steps on a bench.

    Args:
        bench: started.
        profile: angles, frames, soak.
        limits: what is judged.
        hashes: of bench, profile and limits file, for the bag.
        bags: folder of the bags.
        references: what relative metrics refer to, by serial number; filled by the caller.
        alive: called again and again while nothing but computing is done: signs of life for the guard.
    """

    def __init__(
        self,
        bench: Bench,
        profile: Profile,
        limits: LimitSet,
        *,
        hashes: Mapping[str, str],
        bags: Path,
        references: dict[str, Reference],
        alive: Callable[[], None] = lambda: None,
    ) -> None:
        self._alive = alive
        self.bench, self.profile, self.limits = bench, profile, limits
        self.references = references
        self._hashes, self._bags = dict(hashes), bags
        scene = bench.config.scene
        self._duts = {dut.serial: dut for dut in bench.config.dut_settings}
        store = bags.parent / EXPECTATIONS
        self._geometry = {serial: GeometryCache(dut, scene, store) for serial, dut in self._duts.items()}
        self._given_up: frozenset[str] = frozenset()

    def bag_path(self, step: CycleStep, attempt: int) -> Path:
        """Folder of the bag of one attempt."""
        return self._bags / bag_name(step.id, attempt)

    def run(self, step: CycleStep, attempt: int, listener: Listener, *, last: bool = False) -> StepResult:
        """Do one step from settling to verdict.

        A DUT that stops delivering costs the attempt, as it may do better at the next. In the last attempt, and where
        it was given up in an earlier step, the others are measured without it instead.

        Args:
            step: which.
            attempt: from 1.
            listener: told how it goes on.
            last: whether there will be no other attempt.

        Raises:
            DeviceError: a device failed; the bag stays unfinished.
            StorageError: the bag cannot be written.
        """
        bench = self.bench
        lost: dict[str, str] = {}

        def lose(error: DutError) -> None:
            if not last and not self._given_up.issuperset(error.serials):
                raise error
            lost.update(dict.fromkeys(error.serials, str(error)))

        settle = bench.settle(step.set_temperature_c, progress=listener.settling)
        if not settle.settled:
            return self._not_settled(step, attempt, settle)
        expired = expired_instruments(bench.config.calibrations, bench.clock.utc_ns())
        readings: list[BenchReading] = []
        with _observing(bench, listener.soaking):
            bench.soak(self.profile.soak_s)
        statistics = {serial: SweepStatistics(serial) for serial in bench.serials}
        with StepBagWriter(self.bag_path(step, attempt), self._metadata(step, attempt)) as bag:
            self._describe_cameras(bag)

            def record(reading: BenchReading) -> None:
                readings.append(reading)
                nan = float("nan")
                values = {name: nan if value is None else value for name, value in reading.temperatures_c.items()}
                bag.temperatures(reading.time_ns, values)

            with _observing(bench, record):
                bench.read()
                self._sweep(step, bag, statistics, listener, lose)
                bench.read()
            bench.require_control()
            bench.require_own_duts()
            receipt = bag.close()
        self._given_up = frozenset(lost)
        temperatures = mean_temperatures(readings)
        conditions = Conditions(
            cycle=step.cycle,
            step_index=step.index,
            set_temperature_c=step.set_temperature_c,
            ramp=step.ramp,
            settled=True,
            expired=expired,
            temperatures_c=temperatures,
        )
        steps = self.step_data(statistics, conditions, expected_angles=self.angle_count(step), lost=lost)
        return self._judged(step, attempt, settle, receipt, steps, conditions, lost)

    def step_data(
        self,
        statistics: Mapping[str, SweepStatistics],
        conditions: Conditions,
        *,
        expected_angles: int,
        lost: Mapping[str, str] | None = None,
    ) -> dict[str, StepData]:
        """What the metrics get of each DUT; the same from a live sweep and from a bag. Of a lost one: the reason."""
        data = {}
        for serial, each in statistics.items():
            why = (lost or {}).get(serial, "")
            summary = each.summary() if len(each) and not why else None
            self._alive()
            data[serial] = StepData(
                dut=self._duts[serial],
                conditions=conditions,
                sweep=summary,
                geometry=self._geometry[serial].at(summary.stage_angle_deg) if summary else None,
                expected_angles=expected_angles,
                reference=self.references.get(serial),
                uncertainty=self.bench.config.uncertainty,
                faults={"frames": why} if why else None,
            )
        return data

    def angle_count(self, step: CycleStep) -> int:
        """Angles of a step's sweep."""
        return len(self._angles(step))

    def _angles(self, step: CycleStep) -> tuple[float, ...]:
        return self.profile.angles.angles_deg(step.cycle * 1000 + step.index + 1)

    def _sweep(
        self,
        step: CycleStep,
        bag: StepBagWriter,
        statistics: Mapping[str, SweepStatistics],
        listener: Listener,
        lose: Callable[[DutError], None],
    ) -> None:
        angles = self._angles(step)
        for record in sweep(self.bench, angles, frames=self.profile.frames, lose=lose):
            bag.stage(record.time_ns, record.stage_angle_deg)
            for serial, block in record.blocks.items():
                bag.block(block)
                statistics[serial].add(block)
            listener.angle(record.angle_index, len(angles), record.stage_angle_deg)
            if record.angle_index == len(angles) - 1:
                self._expect(statistics, len(angles))

    def _expect(self, statistics: Mapping[str, SweepStatistics], angles: int) -> None:
        """What the twins expect at the sweep's angles, dear where they are new; meanwhile the stage turns back."""
        for serial, each in statistics.items():
            if len(each) == angles:
                expect(self._geometry[serial].at(each.stage_angle_deg))
                self._alive()

    def _judged(
        self,
        step: CycleStep,
        attempt: int,
        settle: SettleReport,
        receipt: BagReceipt,
        steps: Mapping[str, StepData],
        conditions: Conditions,
        lost: Mapping[str, str],
    ) -> StepResult:
        measurements = []
        for data in steps.values():
            for metric in all_metrics():
                measurements += measure(data, (metric,))
                self._alive()
        types = {serial: dut.model for serial, dut in self._duts.items()}
        judgements = judge(measurements, self.limits, conditions, types)
        verdict, decisive = overall(judgements)
        return StepResult(
            step=step,
            attempt=attempt,
            settle=settle,
            bag=receipt,
            steps=steps,
            judgements=judgements,
            verdict=verdict,
            reason=_why(decisive),
            temperatures_c=conditions.temperatures_c,
            lost=lost,
        )

    def _not_settled(self, step: CycleStep, attempt: int, settle: SettleReport) -> StepResult:
        return StepResult(
            step=step,
            attempt=attempt,
            settle=settle,
            bag=None,
            steps={},
            judgements=(),
            verdict=Verdict.INVALID,
            reason=settle.reason,
        )

    def _metadata(self, step: CycleStep, attempt: int) -> StepMetadata:
        return StepMetadata(
            campaign=self.bench.config.campaign,
            cycle=step.cycle,
            step=step.index,
            step_id=step.id,
            attempt=attempt,
            set_temperature_c=step.set_temperature_c,
            ramp=step.ramp,
            started_utc_ns=self.bench.clock.utc_ns(),
            duts=self.bench.serials,
            software_version=arl_fixtures.__version__,
            bench_sha256=self._hashes["bench"],
            profile_sha256=self._hashes["profile"],
            limits_sha256=self._hashes["limits"],
            extra={"bench": self.bench.config.name, "profile": self.profile.name},
        )

    def _describe_cameras(self, bag: StepBagWriter) -> None:
        for serial, dut in self._duts.items():
            k = dut.intrinsics
            bag.camera_info(
                serial,
                camera_matrix=[[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]],
                distortion=[k.k1, k.k2, k.p1, k.p2, k.k3, k.k4, k.k5, k.k6],
                height=dut.rows,
                width=dut.columns,
            )


def mean_temperatures(readings: Sequence[BenchReading]) -> dict[str, float]:
    """Mean of each sensor over some readings; sensors that never gave a value are left out."""
    names = {name for reading in readings for name in reading.temperatures_c}
    means = {}
    for name in sorted(names):
        values = [value for reading in readings if (value := reading.temperatures_c.get(name)) is not None]
        if values:
            means[name] = fmean(values)
    return means


@contextlib.contextmanager
def _observing(bench: Bench, observer: Callable[[BenchReading], None]) -> Iterator[None]:
    bench.observers.append(observer)
    try:
        yield
    finally:
        bench.observers.remove(observer)


def _why(decisive: Judgement | None) -> str:
    if decisive is None or decisive.verdict is Verdict.PASS:
        return ""
    said = decisive.reason or decisive.measurement.reason
    return f"{decisive.measurement.dut} {decisive.measurement.name}: {said}" if said else decisive.measurement.name
