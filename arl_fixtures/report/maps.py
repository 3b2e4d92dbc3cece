"""Maps over the image, measured anew from the bag of a step: P_o, its change, σ_I, σ_D and ΔD.

The journal holds numbers, not images. Where the bag, the bench file or the reference is gone, the map is missing
and says why; nothing else of the report depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np
import numpy.typing as npt

from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.errors import ArlError, DataError
from arl_fixtures.journal.bridge import conditions_of
from arl_fixtures.journal.record import AttemptRecord, SessionRecord
from arl_fixtures.metrics.collect import collect
from arl_fixtures.metrics.geometry import GeometryCache
from arl_fixtures.metrics.measures import distance_error, distance_scatter, intensity_scatter
from arl_fixtures.metrics.measures.power import change_map
from arl_fixtures.metrics.power_map import power_map
from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.scatter_report import ScatterChannel, scatter_map
from arl_fixtures.metrics.step import StepData
from arl_fixtures.recording.bag_folder import verify
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.remeasure import reference_in, steps_of

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageMap:
    """One quantity over the image.

    Attributes:
        title: what it is, with its unit.
        values: (H, W), NaN where there is none; None when it could not be had.
        centred: zero is the middle of its scale.
        reason: why there is none.
    """

    title: str
    values: Float64Array | None = None
    centred: bool = False
    reason: str = ""


@final
class MapMaker:
    """Makes maps of steps; geometry is shared between steps of the same angles.

    Args:
        bench: the bench file the session was run with; None when it is not at hand.
        missing: why not.
        store: where the session kept what its twins expect; rendered anew without.
    """

    def __init__(self, bench: BenchConfig | None, missing: str = "", store: Path | None = None) -> None:
        self._missing = missing
        self._duts = {} if bench is None else {dut.serial: dut for dut in bench.dut_settings}
        scene = None if bench is None else bench.scene
        self._geometry = {serial: GeometryCache(dut, scene, store) for serial, dut in self._duts.items()}

    def of_attempt(self, record: SessionRecord, attempt: AttemptRecord) -> dict[str, tuple[ImageMap, ...]]:
        """All maps of each DUT, from the attempt's bag.

        Args:
            record: the journal.
            attempt: a finished attempt in it.

        Returns:
            serial number to its maps, always the same ones in the same order.
        """
        serials = [dut.serial for dut in record.identity.duts]
        try:
            steps = self._measured(record, attempt)
        except ArlError as error:
            return {serial: _all_missing(_without_place(error, record)) for serial in serials}
        return {serial: _maps(steps[serial], _target_of(steps[serial])) for serial in serials}

    def _measured(self, record: SessionRecord, attempt: AttemptRecord) -> dict[str, StepData]:
        if self._missing:
            raise DataError(self._missing)
        if attempt.bag is None:
            raise DataError("nothing was recorded in this step")
        serials = [dut.serial for dut in record.identity.duts]
        unknown = [serial for serial in serials if serial not in self._duts]
        if unknown:
            raise DataError(f"the bench file has no DUT {', '.join(unknown)}")
        path = record.bag_path(attempt.bag)
        verify(path, attempt.bag.sha256)
        return steps_of(
            collect(StepBag(path).blocks(), serials),
            {serial: self._duts[serial] for serial in serials},
            self._geometry,
            conditions_of(attempt, record.begin.environment),
            references={serial: reference_in(record.path.parent / "references", serial) for serial in serials},
        )


def _without_place(error: ArlError, record: SessionRecord) -> str:
    """The error without the folder the journal happens to lie in: a report is the same wherever it is made."""
    return str(error).replace(f"{record.path.parent.resolve()}/", "").replace(f"{record.path.parent}/", "")


def _target_of(step: StepData) -> str:
    """The reflectance target of medium brightness."""
    try:
        targets = step.geometry.stripes
    except NotMeasurableError:
        return ""
    return targets[len(targets) // 2] if targets else ""


def _power(step: StepData, _: str) -> Float64Array:
    return step.derive(power_map).relative


def _change(step: StepData, _: str) -> Float64Array:
    return 100.0 * change_map(step.derive(power_map), step.need_reference())[0]


def _sigma(channel: ScatterChannel, scale: float) -> Callable[[StepData, str], Float64Array]:
    def measured(step: StepData, target: str) -> Float64Array:
        return scale * scatter_map(step, channel, target)

    return measured


def _distance_error(step: StepData, target: str) -> Float64Array:
    return 100.0 * distance_error.error_map(step, target).relative


_KINDS: Final[Mapping[str, tuple[Callable[[StepData, str], Float64Array], bool]]] = {
    "P_o relative to its mean": (_power, False),
    "change of P_o against the reference / %": (_change, True),
    "σ_I on {target} / counts": (_sigma(intensity_scatter.CHANNEL, 1.0), False),
    "σ_D on {target} / mm": (_sigma(distance_scatter.CHANNEL, 1e3), False),
    "ΔD on {target} / %": (_distance_error, True),
}


def _maps(step: StepData, target: str) -> tuple[ImageMap, ...]:
    maps = []
    for title, (measure, centred) in _KINDS.items():
        name = title.format(target=target or "the middle stripe")
        try:
            maps.append(ImageMap(title=name, values=measure(step, target), centred=centred))
        except NotMeasurableError as reason:
            maps.append(ImageMap(title=name, reason=str(reason)))
    return tuple(maps)


def _all_missing(reason: str) -> tuple[ImageMap, ...]:
    return tuple(ImageMap(title=title.format(target="the middle stripe"), reason=reason) for title in _KINDS)
