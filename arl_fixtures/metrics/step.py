"""All that metrics may know of one DUT in one temperature step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, Final, TypeVar, final

from pydantic import Field

from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.geometry import Geometry
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.statistics import SweepSummary
from arl_fixtures.quantity import Quantity
from arl_fixtures.twin.settings import DutSettings
from arl_fixtures.yaml_model import FileModel

Derived = TypeVar("Derived")

NO_REFERENCE: Final = "no reference recorded yet"
FEWEST_FRAMES: Final = 3
"""At an angle; from fewer than this nothing can be said of their scatter."""


class BenchUncertainty(FileModel):
    """Type B standard uncertainties of the bench, as on its certificates and drawings.

    Attributes:
        target_position_m: distance of each target from the rotation axis.
        stage_angle_deg: stage angle at rest.
        reflectance_relative: certified reflectance of a stripe, relative.
        mount_position_m: optical centre relative to the rotation axis, each direction.
        mount_angle_deg: mounting angle of the DUT, each axis.
    """

    target_position_m: float = Field(default=0.0005, ge=0)
    stage_angle_deg: float = Field(default=0.01, ge=0)
    reflectance_relative: float = Field(default=0.01, ge=0)
    mount_position_m: float = Field(default=0.0005, ge=0)
    mount_angle_deg: float = Field(default=0.2, ge=0)


@final
class StepData:
    """One DUT in one step: settings, conditions, reduced sweep, geometry, reference.

    Args:
        dut: the DUT as its file describes it.
        conditions: where in the campaign, at which temperatures.
        sweep: the reduced sweep; None when nothing was recorded.
        geometry: the twin's expectation at the sweep's angles.
        expected_angles: angles the profile asked for; 0 where that is not known.
        reference: what relative metrics refer to; None while it is not yet recorded.
        uncertainty: type B uncertainties of the bench.
        faults: what is wrong with the recording, by what is missing: ``intensity``, ``distance`` or ``operating``
            make the metrics that need that channel INVALID; ``frames`` (bag cut short) explains too few angles.
    """

    def __init__(
        self,
        *,
        dut: DutSettings,
        conditions: Conditions,
        sweep: SweepSummary | None,
        geometry: Geometry | None,
        expected_angles: int = 0,
        reference: Reference | None = None,
        uncertainty: BenchUncertainty | None = None,
        faults: Mapping[str, str] | None = None,
    ) -> None:
        self.dut = dut
        self.conditions = conditions
        self.reference = reference
        self.uncertainty = uncertainty or BenchUncertainty()
        self.expected_angles = expected_angles
        self.faults = dict(faults or {})
        self._sweep = sweep
        self._geometry = geometry
        self._derived: dict[Callable[[StepData], Any], Any] = {}

    @property
    def sweep(self) -> SweepSummary:
        """The reduced sweep.

        Raises:
            NotMeasurableError: nothing was recorded, or not enough.
        """
        if self._sweep is None:
            raise NotMeasurableError(self._nothing)
        (height, width), dut = self._sweep.shape, self.dut
        if (height, width) != (dut.rows, dut.columns):
            raise NotMeasurableError(
                f"frames of {width} × {height} pixels; the DUT file says {dut.columns} × {dut.rows}"
            )
        return self._sweep

    @property
    def _nothing(self) -> str:
        return self.faults.get("frames", "no frames were recorded")

    @property
    def geometry(self) -> Geometry:
        """The twin's expectation.

        Raises:
            NotMeasurableError: there is none, or nothing was recorded that it could be expected at.
        """
        if self._geometry is None:
            unknown = "no twin of this DUT: its true ranges are not known"
            raise NotMeasurableError(unknown if self._sweep is not None else self._nothing)
        return self._geometry

    def derive(self, function: Callable[[StepData], Derived]) -> Derived:
        """`function(self)`, computed once; what it raised is raised again."""
        if function not in self._derived:
            try:
                self._derived[function] = function(self)
            except NotMeasurableError as reason:
                self._derived[function] = reason
        found = self._derived[function]
        if isinstance(found, NotMeasurableError):
            raise NotMeasurableError(str(found))
        return found  # type: ignore[no-any-return]  # keyed by the function that made it

    def require(self, *channels: str) -> SweepSummary:
        """The sweep, if these channels were recorded.

        Args:
            channels: of ``intensity``, ``distance``, ``operating``.

        Raises:
            NotMeasurableError: nothing was recorded, or one of the channels was not.
        """
        for channel in channels:
            if channel in self.missing:
                raise NotMeasurableError(self.missing[channel])
        return self.sweep

    @cached_property
    def missing(self) -> Mapping[str, str]:
        """Channels that were not recorded, with the reason.

        A channel without a single value is taken as missing where the other one has values: frames without any
        return have neither.
        """
        missing = {channel: reason for channel, reason in self.faults.items() if channel != "frames"}
        if self._sweep is not None:
            lit, timed = bool(self._sweep.intensity_returns.any()), bool(self._sweep.distance_returns.any())
            if lit and not timed:
                missing.setdefault("distance", f"no frame holds a distance{self.shortfall}")
            if timed and not lit:
                missing.setdefault("intensity", f"no frame holds an intensity{self.shortfall}")
        return missing

    def seen_by(self, geometry: Geometry) -> StepData:
        """The same recording against another expectation."""
        return StepData(
            dut=self.dut,
            conditions=self.conditions,
            sweep=self._sweep,
            geometry=geometry,
            expected_angles=self.expected_angles,
            reference=self.reference,
            uncertainty=self.uncertainty,
            faults=self.faults,
        )

    @property
    def shortfall(self) -> str:
        """What the recording lacks, as a clause to append to a reason; empty when it is whole."""
        parts = []
        recorded = 0 if self._sweep is None else len(self._sweep.frames)
        if recorded < self.expected_angles:
            parts.append(f"{recorded} of {self.expected_angles} stage angles recorded")
        most = 0 if self._sweep is None else int(self._sweep.frames.max(initial=0))
        if 0 < most < FEWEST_FRAMES:
            parts.append(f"at most {most} frame{'s' * (most > 1)} at an angle")
        if self._sweep is not None and self._sweep.lost_rows:
            parts.append(f"{self._sweep.lost_rows} image rows lost")
        parts += [self.faults["frames"]] if "frames" in self.faults else []
        return f" ({'; '.join(parts)})" if parts else ""

    def need_reference(self) -> Reference:
        """The reference, if it may be used for this DUT now.

        Raises:
            NotMeasurableError: it belongs to another DUT, or it has expired.
        """
        if self.reference is None:
            raise NotMeasurableError(NO_REFERENCE)
        self.reference.check(self.dut.serial, int(self.sweep.time_ns.max()))
        return self.reference

    def measured(
        self, metric: str, quantity: Quantity, *, scope: str = "", reason: str = "", relative: bool = False
    ) -> Measurement:
        """A value of this DUT; `relative` names the reference it refers to."""
        identity = self.reference.identity if relative and self.reference else ""
        return Measurement(
            metric=metric, dut=self.dut.serial, scope=scope, quantity=quantity, reason=reason, reference=identity
        )

    def unmeasured(self, metric: str, reason: str, *, scope: str = "", attempted: bool = True) -> Measurement:
        """No value, and why."""
        return Measurement(metric=metric, dut=self.dut.serial, scope=scope, reason=reason, attempted=attempted)
