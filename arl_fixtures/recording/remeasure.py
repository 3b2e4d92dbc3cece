"""A recorded step measured again, from its bag and the files it was recorded with: the same values as live."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import final

from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.errors import ArlError, DataError
from arl_fixtures.metrics.collect import Collected, collect
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.instruments import expired_instruments
from arl_fixtures.metrics.reference import Reference
from arl_fixtures.metrics.step import BenchUncertainty, StepData
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.names import inside
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.twin.settings import DutSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedStep:
    """What the metrics get of a recorded step.

    Attributes:
        metadata: which step.
        conditions: at which temperatures it was recorded.
        steps: by serial number, in the order of the bag.
        fault: what is wrong with the recording; empty for a whole one.
    """

    metadata: StepMetadata
    conditions: Conditions
    steps: Mapping[str, StepData]
    fault: str = ""


@final
class Remeasurer:
    """Measures bags of one bench; geometry is shared between steps of the same angles.

    Args:
        bench: the bench file the bags were recorded with.
        references: folder with a file for each serial number; one that cannot be read makes relative values INVALID.
        expected_angles: of a sweep; 0 where that is not known.
        store: where the session kept what its twins expect; rendered anew without.
    """

    def __init__(
        self, bench: BenchConfig, *, references: Path, expected_angles: int = 0, store: Path | None = None
    ) -> None:
        self._bench, self._references, self._expected_angles = bench, references, expected_angles
        self._duts = {dut.serial: dut for dut in bench.dut_settings}
        self._geometry = {serial: GeometryCache(dut, bench.scene, store) for serial, dut in self._duts.items()}

    def step(self, path: Path) -> RecordedStep:
        """Read a bag.

        Raises:
            DataError: it cannot be read at all, or it holds a DUT that the bench file does not describe. What is cut
                or missing within it is said by the values that miss it.
        """
        bag = StepBag(path)
        metadata = bag.metadata
        unknown = [serial for serial in metadata.duts if serial not in self._duts]
        if unknown:
            known = ", ".join(self._duts)
            raise DataError(f"{path}: the bench file describes no DUT {', '.join(unknown)}, only {known}")
        collected = collect(bag.blocks(), metadata.duts)
        # which bag it is stands at the head of the step
        for what, why in collected.faults.items():
            collected.faults[what] = why.replace(f"{path}/", "").removeprefix(f"{path}: ")
        conditions = conditions_in(bag, self._bench)
        steps = steps_of(
            collected,
            {serial: self._duts[serial] for serial in metadata.duts},
            self._geometry,
            conditions,
            references={serial: reference_in(self._references, serial) for serial in metadata.duts},
            uncertainty=self._bench.uncertainty,
            expected_angles=self._expected_angles,
        )
        fault = collected.faults.get("frames", "")
        if not fault and metadata.recovered:
            fault = "recovered from a bag that was cut: the step was not finished"
        return RecordedStep(metadata=metadata, conditions=conditions, steps=steps, fault=fault)


def steps_of(
    collected: Collected,
    duts: Mapping[str, DutSettings],
    geometry: Mapping[str, GeometryCache],
    conditions: Conditions,
    *,
    references: Mapping[str, Reference | None],
    uncertainty: BenchUncertainty | None = None,
    expected_angles: int = 0,
) -> dict[str, StepData]:
    """What the metrics get of each DUT of a recording; of one that recorded nothing, the reason."""
    steps = {}
    for serial, dut in duts.items():
        statistics = collected.statistics[serial]
        summary = statistics.summary() if len(statistics) else None
        steps[serial] = StepData(
            dut=dut,
            conditions=conditions,
            sweep=summary,
            geometry=geometry[serial].at(summary.stage_angle_deg) if summary else None,
            expected_angles=expected_angles,
            reference=references[serial],
            uncertainty=uncertainty,
            faults=collected.faults,
        )
    return steps


def reference_in(folder: Path, serial: str) -> Reference | None:
    """The reference of a DUT; None where there is none. One that cannot be read is there and serves nobody."""
    try:
        path = inside(folder, f"{serial}.npz")
        return Reference.load(path) if path.is_file() else None
    except ArlError as error:
        why = str(error).replace(f"{folder}/", "")
        return Reference(serial=serial, identity="unreadable", set_temperature_c=math.nan, doubt=why)


def conditions_in(bag: StepBag, bench: BenchConfig) -> Conditions:
    """Under what conditions a bag was recorded; complete once its blocks were read to the end.

    A bag is begun when the step has settled, so it has.
    """
    metadata = bag.metadata
    temperatures = {}
    for name, series in sorted(bag.temperatures_c.items()):
        values = [value for _, value in series if not math.isnan(value)]
        if values:
            temperatures[name] = fmean(values)
    return Conditions(
        cycle=metadata.cycle,
        step_index=metadata.step,
        set_temperature_c=metadata.set_temperature_c,
        ramp=metadata.ramp,
        settled=True,
        expired=expired_instruments(bench.calibrations, metadata.started_utc_ns),
        temperatures_c=temperatures,
    )
