"""The plant's true state for onlookers, and when it changed: by this, tests judge whether the bench was safe."""

from __future__ import annotations

from collections import deque
from typing import Any, Final, final

from arl_fixtures.emulators.plant import Plant

_KEPT_EVENTS: Final = 20_000


@final
class PlantWatch:
    """Keeps the changes of what a guard is there for: power, lasers, set-point.

    Args:
        plant: what is watched.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._last = self._switches()
        self._events: deque[tuple[float, str, Any]] = deque(maxlen=_KEPT_EVENTS)

    def look(self, now_s: float) -> None:
        """Note what has changed."""
        switches = self._switches()
        if switches == self._last:
            return
        for name, value in switches.items():
            if self._last[name] != value:
                self._events.append((now_s, name, value))
        self._last = switches

    def note(self, now_s: float, what: str, value: str) -> None:
        """Remember something that is not of the plant."""
        self._events.append((now_s, what, value))

    def events(self) -> list[tuple[float, str, Any]]:
        """(bench time, what, new value), oldest first."""
        return list(self._events)

    def state(self, now_s: float) -> dict[str, Any]:
        """Everything at `now_s`, fit for JSON; `stage_stands_from_s` may lie in the future."""
        plant = self._plant
        angle_deg, velocity_deg_s = plant.stage_track.at(now_s)
        return self._switches() | {
            "now_s": now_s,
            "coolant_c": plant.coolant_c,
            "plate_c": plant.plate_c,
            "housing_c": list(plant.housing_c),
            "stage_angle_deg": angle_deg,
            "stage_moving": velocity_deg_s != 0.0,
            "stage_stands_from_s": max(plant.stage_track.end_s, 0.0),
        }

    def _switches(self) -> dict[str, Any]:
        plant = self._plant
        count = range(plant.dut_count)
        return (
            {f"dut_{dut + 1}": plant.powered(dut) for dut in count}
            | {f"laser_{dut + 1}": plant.laser_on(dut) for dut in count}
            | {"setpoint_c": plant.setpoint_c}
        )
