"""When is a temperature step settled: all powered housings within a tolerance for a hold time, within a limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

from pydantic import Field

from arl_fixtures.yaml_model import FileModel


class SettleSettings(FileModel):
    """The paper's ε with the times it leaves open."""

    tolerance_k: float = Field(default=0.5, gt=0, description="ε: largest distance of each powered housing")
    hold_s: float = Field(default=60.0, ge=0, description="how long all must stay inside")
    time_limit_s: float = Field(default=3600.0, gt=0, description="from the start of the step")


@dataclass(frozen=True, slots=True, kw_only=True)
class SettleReport:
    """How settling ended.

    Attributes:
        settled: whether the step may be measured.
        duration_s: bench time it took.
        reason: why not, naming sensor and distance; empty when settled.
        overshoot_k: how far the mean housing went beyond the set temperature in the direction of travel.
    """

    settled: bool
    duration_s: float
    reason: str = ""
    overshoot_k: float = 0.0


@final
class SettleWatch:
    """Judges readings one after the other.

    Args:
        settings: tolerance, hold and limit.
        set_temperature_c: where the housings shall be.
        start_s: bench time at which the step began.
        start_mean_c: mean housing temperature at that time, which tells the direction of travel.
    """

    def __init__(
        self, settings: SettleSettings, set_temperature_c: float, *, start_s: float, start_mean_c: float
    ) -> None:
        self._settings, self._set_c, self._start_s = settings, set_temperature_c, start_s
        self._direction = 1.0 if start_mean_c <= set_temperature_c else -1.0
        self._inside_since_s: float | None = None
        self._overshoot_k = 0.0
        self._last_outside = "no reading of the housings was taken"

    def see(self, now_s: float, housings_c: Mapping[str, float | None]) -> SettleReport | None:
        """Judge one reading of all powered housings.

        Args:
            now_s: bench time of the reading.
            housings_c: sensor name to °C; None where the sensor gives no value.

        Returns:
            the report when the step has settled or its time is over, else None.
        """
        elapsed_s = now_s - self._start_s
        outside = self._outside(housings_c)
        known = [value for value in housings_c.values() if value is not None]
        if known:
            mean_c = sum(known) / len(known)
            self._overshoot_k = max(self._overshoot_k, self._direction * (mean_c - self._set_c))
        if outside:
            self._inside_since_s, self._last_outside = None, outside
        elif self._inside_since_s is None:
            self._inside_since_s = now_s
        if self._inside_since_s is not None and now_s - self._inside_since_s >= self._settings.hold_s:
            return SettleReport(settled=True, duration_s=elapsed_s, overshoot_k=self._overshoot_k)
        if elapsed_s >= self._settings.time_limit_s:
            reason = f"not settled within {self._settings.time_limit_s:g} s: {self._last_outside}"
            return SettleReport(settled=False, duration_s=elapsed_s, reason=reason, overshoot_k=self._overshoot_k)
        return None

    def _outside(self, housings_c: Mapping[str, float | None]) -> str:
        """The sensor farthest out, in words; empty when all are inside."""
        if not housings_c:
            return "no housing is powered"
        for name, value in housings_c.items():
            if value is None:
                return f"{name} gives no value"
        name, value = max(housings_c.items(), key=lambda item: abs((item[1] or 0.0) - self._set_c))
        distance_k = (value or 0.0) - self._set_c
        if abs(distance_k) <= self._settings.tolerance_k:
            return ""
        return (
            f"{name} reads {value:.1f} °C, {distance_k:+.1f} K from {self._set_c:g} °C "
            f"(tolerance {self._settings.tolerance_k:g} K)"
        )
