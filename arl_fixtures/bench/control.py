"""Cascaded temperature control: our outer PI loop gives the chiller its set-point.

The chiller controls its coolant; the housings follow through hose, plate and contact. The outer loop compares the
mean housing temperature with the set temperature and moves the chiller's set-point around it. Positional PI
form with conditional integration against wind-up (Åström & Hägglund, Advanced PID Control, 2006, ch. 3.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from pydantic import Field

from arl_fixtures.yaml_model import FileModel


class ControlSettings(FileModel):
    """Gains and limits of the outer loop."""

    proportional: float = Field(default=0.7, ge=0, description="kelvin of set-point per kelvin of error")
    integral_time_s: float = Field(default=100.0, gt=0)
    setpoint_minimum_c: float = -25.0
    setpoint_maximum_c: float = Field(
        default=95.0,
        description="no higher than the housings' ceiling: a thermometer that lies must not lead beyond it",
    )
    setpoint_ramp_k_per_min: float = Field(default=6.0, gt=0)
    integral_band_k: float = Field(default=1.0, gt=0, description="the integrator rests while the error is larger")
    period_s: float = Field(default=5.0, gt=0, description="time between two turns of the loop")


@dataclass(frozen=True, slots=True)
class ControlState:
    """What one turn of the loop leaves for the next."""

    setpoint_c: float
    integral_k: float
    time_s: float


@final
class CascadedControl:
    """The outer loop.

    Args:
        settings: gains and limits.
        setpoint_c: the chiller's set-point as it stands, from which the ramp starts.
        now_s: bench time.
    """

    def __init__(self, settings: ControlSettings, *, setpoint_c: float, now_s: float) -> None:
        self._settings = settings
        self.state = ControlState(setpoint_c, 0.0, now_s)

    def next_setpoint_c(self, set_temperature_c: float, mean_housing_c: float, now_s: float) -> float:
        """One turn of the loop.

        Args:
            set_temperature_c: where the housings shall be.
            mean_housing_c: mean of the powered housings' thermocouples.
            now_s: bench time.

        Returns:
            set-point for the chiller, °C.
        """
        self.state = advance(self._settings, self.state, set_temperature_c, mean_housing_c, now_s)
        return self.state.setpoint_c


def advance(
    settings: ControlSettings, state: ControlState, set_temperature_c: float, mean_housing_c: float, now_s: float
) -> ControlState:
    """The control law as a pure function of state and reading."""
    elapsed_s = max(now_s - state.time_s, 0.0)
    error_k = set_temperature_c - mean_housing_c
    integral_k = state.integral_k
    if abs(error_k) <= settings.integral_band_k:
        integral_k += settings.proportional * error_k * elapsed_s / settings.integral_time_s
    wanted_c = set_temperature_c + settings.proportional * error_k + integral_k
    reach_k = settings.setpoint_ramp_k_per_min * elapsed_s / 60.0
    ramped_c = min(max(wanted_c, state.setpoint_c - reach_k), state.setpoint_c + reach_k)
    setpoint_c = min(max(ramped_c, settings.setpoint_minimum_c), settings.setpoint_maximum_c)
    # the integrator must not run on while the output cannot follow in its direction
    if (wanted_c - setpoint_c) * (integral_k - state.integral_k) > 0:
        integral_k = state.integral_k
    return ControlState(setpoint_c, integral_k, now_s)
