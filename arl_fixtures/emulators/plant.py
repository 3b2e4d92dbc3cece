"""The bench's physics, one object that all emulators of a bench share.

Relays switch the DUTs' supplies and lasers here, the chiller sets what the coolant follows, the stage turns the
LiDARs; in return thermocouples, DUTs and chiller see one consistent world. The plant has no clock: whoever is
asked something calls `advance` first, and faults begin and end on the way, in the order of their times.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from typing import Final, final

from pydantic import Field

from arl_fixtures.emulators.faults import Fault, FaultBook
from arl_fixtures.emulators.motion import Track
from arl_fixtures.errors import ConfigError
from arl_fixtures.twin.thermal import ThermalPlant, ThermalSettings
from arl_fixtures.yaml_model import FileModel

FaultListener = Callable[[Fault, bool, float], None]
"""Called as (fault, begins, time_s) when a fault begins or ends."""

_SECONDS_PER_HOUR: Final = 3600.0


class PlantSettings(FileModel):
    """What the emulated bench is like beyond its devices."""

    seed: int = Field(default=0, ge=0, description="of all noise; same seed, same bytes")
    thermal: ThermalSettings = Field(
        default=ThermalSettings(), description="heat capacities, conductances, chiller dynamics; one housing per DUT"
    )
    stage_start_deg: float = Field(
        default=0.0, allow_inf_nan=False, description="true stage angle at power-up, clockwise positive"
    )
    idle_time_constant_h: float = Field(
        default=3.0, gt=0, description="without temperature control the bath drifts to ambient this slowly"
    )
    coupling_step_s: float = Field(
        default=10.0, gt=0, description="longest time for which a moving coolant target is held"
    )


@final
class Plant:
    """State of the emulated bench at the time of the last `advance`.

    Args:
        settings: parameters and seed.
        faults: faults to come; an empty book where not given.
        start_s: bench time of the initial state.

    Attributes:
        settings: as given.
        faults: the shared book; inject and clear there.
        stage_track: true stage angle over time; the stage emulator writes it.
    """

    def __init__(
        self, settings: PlantSettings | None = None, *, faults: FaultBook | None = None, start_s: float = 0.0
    ) -> None:
        self.settings = settings or PlantSettings()
        self.faults = faults or FaultBook()
        self.stage_track = Track(self.settings.stage_start_deg)
        self._thermal = ThermalPlant(self.settings.thermal, start_s=start_s)
        self._now_s = start_s
        count = self.settings.thermal.housing_count
        self._loads = {f"{kind}_{dut + 1}": _Switch() for kind in ("dut", "laser") for dut in range(count)}
        self._supplies = tuple(self._loads[f"dut_{dut + 1}"] for dut in range(count))
        self._lasers = tuple(self._loads[f"laser_{dut + 1}"] for dut in range(count))
        self._powered = [False] * count
        self._listeners: list[tuple[str, FaultListener]] = []
        self._target_c = self._reached_c = self._thermal.coolant_c
        self._ramp_k_per_s = math.inf
        self._controlling = False
        self._circulating = False
        self._telling = False

    # -- time and faults

    @property
    def now_s(self) -> float:
        """Bench time up to which the plant has been computed."""
        return self._now_s

    def attach(self, device: str, listener: FaultListener) -> None:
        """Have `listener` called when a fault of `device` begins or ends."""
        self._listeners.append((device, listener))

    def advance(self, now_s: float) -> None:
        """Let the plant run to `now_s`; an earlier time changes nothing."""
        # listeners change the plant, which advances it: faults are then left to the call under way
        while not self._telling and self.faults.next_edge_s <= now_s:
            edge = self.faults.take_edge(now_s)
            if edge is None:
                break
            at_s = max(edge.time_s, self._now_s)
            self._run(at_s)
            self._telling = True
            try:
                for device, listener in self._listeners:
                    if edge.fault.concerns(device):
                        listener(edge.fault, edge.begins, at_s)
            finally:
                self._telling = False
        if now_s > self._now_s:
            self._run(now_s)

    def _run(self, now_s: float) -> None:
        if self._controlling and self._reached_c == self._target_c:
            self._thermal.advance(now_s, self._reached_c, self._powered, self._circulating)
            self._now_s = now_s
            return
        step_s = self.settings.coupling_step_s
        while self._now_s < now_s:
            until_s = min(now_s, self._now_s + step_s)
            self._thermal.advance(until_s, self._follow(until_s - self._now_s), self._powered, self._circulating)
            self._now_s = until_s

    def _follow(self, duration_s: float) -> float:
        """What the bath is driven to for the next `duration_s`."""
        if self._controlling:
            way_k = self._ramp_k_per_s * duration_s
            self._reached_c += min(max(self._target_c - self._reached_c, -way_k), way_k)
            return self._reached_c
        thermal = self._thermal
        lag_s, drift_s = thermal.settings.coolant_lag_s, self.settings.idle_time_constant_h * _SECONDS_PER_HOUR
        # the bath follows with `lag_s`: aiming only this far makes it follow ambient with the idle time constant
        self._reached_c = thermal.coolant_c
        return thermal.coolant_c + (thermal.ambient_c - thermal.coolant_c) * min(lag_s / drift_s, 1.0)

    # -- temperatures

    @property
    def coolant_c(self) -> float:
        """Coolant in the chiller's bath, degrees Celsius."""
        return self._thermal.coolant_c

    @property
    def plate_c(self) -> float:
        """Cooling plate, degrees Celsius."""
        return self._thermal.plate_c

    @property
    def housing_c(self) -> tuple[float, ...]:
        """Housing of each DUT, degrees Celsius."""
        return self._thermal.housing_c

    @property
    def ambient_c(self) -> float:
        """Air around the front end, degrees Celsius."""
        return self._thermal.ambient_c

    @property
    def circulating(self) -> bool:
        """Whether coolant flows through the plate."""
        return self._circulating

    @property
    def ramped_setpoint_c(self) -> float:
        """What the chiller drives its bath to now, degrees Celsius."""
        return self._reached_c

    @property
    def setpoint_c(self) -> float:
        """The chiller's set-point, whether it is driven to or not, degrees Celsius."""
        return self._target_c

    def drive_coolant(
        self,
        now_s: float,
        *,
        target_c: float,
        controlling: bool,
        circulating: bool,
        ramp_k_per_min: float = math.inf,
    ) -> None:
        """What the chiller does from `now_s` on.

        Args:
            now_s: bench time.
            target_c: set-point, degrees Celsius.
            controlling: whether temperature control is on; off, the bath drifts towards ambient.
            circulating: whether the pump moves coolant.
            ramp_k_per_min: how fast the set-point in effect may move.
        """
        self.advance(now_s)
        self._target_c, self._controlling, self._circulating = target_c, controlling, circulating
        self._ramp_k_per_s = ramp_k_per_min / 60.0
        if self._ramp_k_per_s == math.inf and controlling:
            self._reached_c = target_c

    # -- power

    @property
    def dut_count(self) -> int:
        """Number of DUTs on the plate."""
        return len(self._supplies)

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of what relays can switch: `dut_1` …, `laser_1` …."""
        return tuple(self._loads)

    def switch(self, load: str, on: bool, now_s: float) -> None:
        """Close or open the contact of a load.

        Raises:
            ConfigError: there is no such load.
        """
        switch = self._loads.get(load)
        if switch is None:
            raise ConfigError(f"no load '{load}' on the emulated bench; loads are {', '.join(self._loads)}")
        self.advance(now_s)
        switch.set(on, now_s)
        self._powered = [supply.on for supply in self._supplies]

    def powered(self, dut: int, at_s: float | None = None) -> bool:
        """Whether DUT `dut` (from 0) has its supply, now or at a past time."""
        switch = self._supplies[dut]
        return switch.on if at_s is None else switch.on_at(at_s)

    def powered_since_s(self, dut: int) -> float:
        """Bench time at which the DUT's supply came on last; infinity while it is off."""
        return self._supplies[dut].since_s

    def laser_on(self, dut: int, at_s: float | None = None) -> bool:
        """Whether the laser of DUT `dut` (from 0) may fire: enabled, and the DUT powered."""
        switch = self._lasers[dut]
        return self.powered(dut, at_s) and (switch.on if at_s is None else switch.on_at(at_s))

    # -- stage

    def stage_angle_deg(self, time_s: float) -> float:
        """True stage angle, degrees clockwise, at any time since shortly before the current move."""
        return self.stage_track.at(time_s)[0]

    def stage_at_rest(self, start_s: float, end_s: float) -> bool:
        """Whether the stage stood still all through [start_s, end_s]."""
        return self.stage_track.at_rest(start_s, end_s)


@final
class _Switch:
    """A contact and when it changed."""

    def __init__(self) -> None:
        self.on = False
        self._times_s: list[float] = []

    def set(self, on: bool, now_s: float) -> None:
        if on != self.on:
            self.on = on
            self._times_s.append(now_s)

    def on_at(self, time_s: float) -> bool:
        # it begins open and changes at each time
        return bisect_right(self._times_s, time_s) % 2 == 1

    @property
    def since_s(self) -> float:
        return self._times_s[-1] if self.on else math.inf
