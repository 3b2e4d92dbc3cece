"""What a frame may depend on beyond the stage angle, and how found or invented effects enter the twin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from arl_fixtures.twin.expected import Expected


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """The circumstances of a frame. What is not known is NaN or 0.

    Attributes:
        dut: serial number.
        stage_angle_deg: stage angle.
        time_s: since the start of the cycle, at the middle of the exposure.
        cycle: cycle count.
        step: step index within the cycle.
        set_temperature_c: set temperature of the step.
        ramp: +1 heating, −1 cooling.
        housing_temperature_c: of this DUT.
        plate_temperature_c: of the cooling plate.
        coolant_temperature_c: of the coolant.
        ambient_temperature_c: of the chamber.
        operating: operating data, by signal name with unit suffix.
    """

    dut: str = ""
    stage_angle_deg: float = 0.0
    time_s: float = 0.0
    cycle: int = 0
    step: int = 0
    set_temperature_c: float = float("nan")
    ramp: int = 0
    housing_temperature_c: float = float("nan")
    plate_temperature_c: float = float("nan")
    coolant_temperature_c: float = float("nan")
    ambient_temperature_c: float = float("nan")
    operating: Mapping[str, float] = field(default_factory=dict)

    def covariates(self) -> dict[str, float]:
        """The same as numbers under the column names of an observation table, operating data included."""
        return {
            "cycle": float(self.cycle),
            "step": float(self.step),
            "set_temperature_c": self.set_temperature_c,
            "ramp": float(self.ramp),
            "time_s": self.time_s,
            "stage_angle_deg": self.stage_angle_deg,
            "housing_temperature_c": self.housing_temperature_c,
            "plate_temperature_c": self.plate_temperature_c,
            "coolant_temperature_c": self.coolant_temperature_c,
            "ambient_temperature_c": self.ambient_temperature_c,
            **self.operating,
        }


class FrameModel(Protocol):
    """An effect that the nominal model lacks."""

    def alter(self, expected: Expected, conditions: Conditions) -> Expected:
        """The expected frame as it is with the effect.

        Args:
            expected: the frame without it. Its arrays are read only: use `dataclasses.replace`.
            conditions: the circumstances.

        Returns:
            A frame of the same shape. Set `intensity_std_counts` or `distance_std_m` only if the effect changes
            the scatter otherwise than through the expected values.
        """


def altered(expected: Expected, conditions: Conditions, models: Sequence[FrameModel]) -> Expected:
    """`expected` with all `models` applied in their order."""
    for model in models:
        expected = model.alter(expected, conditions)
    return expected
