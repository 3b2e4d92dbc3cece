"""Under what conditions a step was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Where in the campaign a step lies, and at which temperatures.

    Attributes:
        cycle: cycle count, from 0.
        step_index: step within the cycle, from 0.
        set_temperature_c: set temperature of the housings, degrees Celsius.
        ramp: +1 heating, -1 cooling.
        settled: whether all housings stayed within tolerance for the hold time.
        unsettled_reason: which sensor was how far off; empty when settled.
        expired: role of each instrument whose calibration had run out, and how that reads as a reason.
        temperatures_c: logged temperatures by name, mean over the step, degrees Celsius.
    """

    cycle: int = 0
    step_index: int = 0
    set_temperature_c: float
    ramp: int = 1
    settled: bool = True
    unsettled_reason: str = ""
    expired: Mapping[str, str] = field(default_factory=dict)
    temperatures_c: Mapping[str, float] = field(default_factory=dict)
