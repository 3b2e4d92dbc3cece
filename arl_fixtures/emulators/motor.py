"""One motor of the emulated Trinamic module: axis parameters, motion, reference search."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final, Literal, final

from pydantic import Field

from arl_fixtures.emulators.axis import EmulatedAxis, Leg, Mechanics, Outcome
from arl_fixtures.emulators.fault_kinds import FaultKind
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.emulators.motion import Track
from arl_fixtures.protocols.tmcl import Axis, ErrorFlag, SearchType, StatusCode
from arl_fixtures.yaml_model import FileModel

_STANDSTILL_FLAG: Final = 1 << 7
_READ_ONLY: Final = frozenset(
    {
        Axis.ACTUAL_SPEED,
        Axis.REACHED,
        Axis.HOME_SWITCH,
        Axis.RIGHT_SWITCH,
        Axis.LEFT_SWITCH,
        Axis.LAST_REFERENCE,
        Axis.ERROR_FLAGS,
        Axis.DRIVER_FLAGS,
    }
)


class SearchProcedure(Enum):
    """What a reference search does; the counter is zero where it ends."""

    LEFT_SWITCH = "left"
    RIGHT_THEN_LEFT = "right_then_left"
    HOME_SWITCH = "home"


class MotorSettings(FileModel):
    """What motor and stage are like; angles are true angles, clockwise positive."""

    full_steps: int = Field(default=200, gt=0, description="per motor turn")
    gear: float = Field(default=72.0, gt=0, description="motor turns per stage turn")
    clockwise_sign: Literal[1, -1] = Field(default=1, description="direction of the counter for a clockwise turn")
    low_switch_deg: float = Field(default=-75.0, description="limit switch at the small end")
    high_switch_deg: float = Field(default=75.0, description="limit switch at the large end")
    home_switch_deg: float = Field(default=0.0, description="where the home switch changes")
    search_procedures: dict[int, SearchProcedure] = Field(
        default_factory=lambda: {
            1: SearchProcedure.LEFT_SWITCH,
            2: SearchProcedure.RIGHT_THEN_LEFT,
            5: SearchProcedure.HOME_SWITCH,
        },
        description="mode number of parameter 193 to what it does: left, right_then_left or home",
    )
    speed_deg_s: float = Field(default=20.0, gt=0, description="parameter 4 after power-up")
    acceleration_deg_s2: float = Field(default=100.0, gt=0, description="parameter 5 after power-up")
    encoder_counts_per_microstep: float = Field(default=1.0, gt=0, description="unit of parameter 209")


@final
class EmulatedMotor:
    """A motor as its module's commands see it: counts, and parameters by number.

    Args:
        settings: what it is like.
        truth: the plant's track of the true stage angle.
    """

    def __init__(self, settings: MotorSettings, truth: Track) -> None:
        self._settings = settings
        mechanics = Mechanics(
            sign=settings.clockwise_sign,
            low_switch_deg=settings.low_switch_deg,
            high_switch_deg=settings.high_switch_deg,
            home_switch_deg=settings.home_switch_deg,
        )
        self._axis = EmulatedAxis(mechanics, truth)
        self._power_up()

    def reset(self, now_s: float) -> None:
        """The motor loses its current; position and parameters are lost."""
        self._axis.power_down(now_s)
        self._power_up()

    def _power_up(self) -> None:
        settings = self._settings
        self._resolution = 8
        per_deg = self._steps_per_deg
        self._parameters: dict[int, int] = {
            Axis.MAX_SPEED: round(settings.speed_deg_s * per_deg),
            Axis.ACCELERATION: round(settings.acceleration_deg_s2 * per_deg),
            Axis.RUN_CURRENT: 128,
            Axis.STANDBY_CURRENT: 8,
            Axis.RIGHT_DISABLE: 0,
            Axis.LEFT_DISABLE: 0,
            Axis.SOFT_STOP: 0,
            Axis.SEARCH_MODE: 1,
            Axis.SEARCH_SPEED: round(settings.speed_deg_s / 2.0 * per_deg),
            Axis.SWITCH_SPEED: round(settings.speed_deg_s / 20.0 * per_deg),
            Axis.SWITCH_DISTANCE: 0,
            Axis.LAST_REFERENCE: 0,
            Axis.MAX_ENCODER_DEVIATION: 0,
            Axis.UNIT_MODE: 1,
        }
        self._target = 0
        self._run_direction = 0
        self._leg = Leg(-math.inf, Outcome.ARRIVED)
        self._search_end_s = -math.inf
        self._searching = False
        self._flag_since_s = math.inf
        self._apply_parameters()

    @property
    def _steps_per_deg(self) -> float:
        return float(self._settings.full_steps << self._resolution) * self._settings.gear / 360.0

    @property
    def target(self) -> int:
        """Target position, counts."""
        return self._target

    def is_searching(self, now_s: float) -> bool:
        """Whether a reference search is under way."""
        return self._searching and now_s < self._search_end_s

    # -- axis parameters

    def read(self, parameter: int, now_s: float) -> int | None:
        """Value of an axis parameter; None if there is no such."""
        per_deg, axis = self._steps_per_deg, self._axis
        match parameter:
            case Axis.TARGET:
                return self._target
            case Axis.ACTUAL:
                return self._actual(now_s)
            case Axis.ACTUAL_SPEED | Axis.TARGET_SPEED:
                return round(axis.speed_deg_s(now_s) * per_deg)
            case Axis.REACHED:
                stands = now_s >= axis.counter.end_s
                return int(stands and not self.is_searching(now_s) and self._actual(now_s) == self._target)
            case Axis.HOME_SWITCH:
                return int(axis.home_pressed(now_s))
            case Axis.RIGHT_SWITCH | Axis.LEFT_SWITCH:
                return int(axis.pressed(1 if parameter == Axis.RIGHT_SWITCH else -1, now_s))
            case Axis.MICROSTEP_RESOLUTION:
                return self._resolution
            case Axis.ENCODER:
                return round(axis.encoder_deg(now_s) * per_deg * self._settings.encoder_counts_per_microstep)
            case Axis.ERROR_FLAGS:
                raised = now_s >= self._flag_since_s
                if raised:
                    self._flag_since_s = math.inf
                return ErrorFlag.DEVIATION if raised else 0
            case Axis.DRIVER_FLAGS:
                return _STANDSTILL_FLAG if axis.speed_deg_s(now_s) == 0.0 else 0
        return self._parameters.get(parameter)

    def write(self, parameter: int, value: int, now_s: float) -> StatusCode:
        """Set an axis parameter; some of them set the motor in motion."""
        per_deg = self._steps_per_deg
        if parameter in _READ_ONLY:
            return StatusCode.WRONG_TYPE
        match parameter:
            case Axis.TARGET:
                self.move(value, now_s)
            case Axis.ACTUAL:
                self._axis.count_from(now_s, value / per_deg)
                self._target = value
            case Axis.TARGET_SPEED:
                self.rotate(value, now_s)
            case Axis.ENCODER:
                self._axis.set_encoder(value / per_deg / self._settings.encoder_counts_per_microstep, now_s)
            case Axis.MICROSTEP_RESOLUTION:
                if not 0 <= value <= 8:
                    return StatusCode.INVALID_VALUE
                self._resolution = value
            case Axis.SEARCH_MODE if value not in self._settings.search_procedures:
                return StatusCode.INVALID_VALUE
            case Axis.MAX_SPEED | Axis.ACCELERATION | Axis.SEARCH_SPEED | Axis.SWITCH_SPEED if value <= 0:
                return StatusCode.INVALID_VALUE
            case _ if parameter not in self._parameters:
                return StatusCode.WRONG_TYPE
            case _ if value < 0:
                return StatusCode.INVALID_VALUE
            case _:
                self._parameters[parameter] = value
        self._apply_parameters()
        return StatusCode.OK

    def _apply_parameters(self) -> None:
        axis, parameters, per_deg = self._axis, self._parameters, self._steps_per_deg
        axis.acceleration_deg_s2 = parameters[Axis.ACCELERATION] / per_deg
        counts = per_deg * self._settings.encoder_counts_per_microstep
        axis.max_deviation_deg = parameters[Axis.MAX_ENCODER_DEVIATION] / counts
        axis.soft_stop = bool(parameters[Axis.SOFT_STOP])
        disabled = {1: parameters[Axis.RIGHT_DISABLE], -1: parameters[Axis.LEFT_DISABLE]}
        axis.enabled_switches = {direction for direction, off in disabled.items() if not off}

    def _actual(self, now_s: float) -> int:
        return round(self._axis.counter_deg(now_s) * self._steps_per_deg)

    # -- motion

    def move(self, target: int, now_s: float) -> None:
        """Start to move to a position."""
        self._target, self._run_direction, self._searching = target, 0, False
        speed = self._parameters[Axis.MAX_SPEED] / self._steps_per_deg
        self._take(self._axis.drive(now_s, target / self._steps_per_deg, speed), now_s)

    def rotate(self, speed: int, now_s: float) -> None:
        """Turn at a signed speed, right positive, until stopped."""
        self._searching = False
        if speed == 0:
            self.stop(now_s)
            return
        self._run_direction = 1 if speed > 0 else -1
        self._take(self._axis.run(now_s, self._run_direction, abs(speed) / self._steps_per_deg), now_s)

    def stop(self, now_s: float) -> None:
        """Brake; ends a reference search, too."""
        self._searching, self._run_direction = False, 0
        self._take(self._axis.brake(now_s), now_s)

    def _take(self, leg: Leg, now_s: float) -> None:
        self._leg = leg
        if leg.outcome is Outcome.DEVIATION:
            self._flag_since_s = leg.end_s
        elif self._flag_since_s > now_s:
            # it would have been raised by the motion that this one replaces
            self._flag_since_s = math.inf

    # -- reference search

    def search(self, kind: int, now_s: float) -> tuple[int, int]:
        """Start, stop or ask for a reference search; returns status and value."""
        match kind:
            case SearchType.START:
                self._plan_search(now_s)
            case SearchType.STOP:
                self.stop(now_s)
            case SearchType.STATUS:
                return StatusCode.OK, int(self.is_searching(now_s))
            case _:
                return StatusCode.WRONG_TYPE, 0
        return StatusCode.OK, 0

    def _plan_search(self, now_s: float) -> None:
        """Plan the whole search: every leg starts where the one before will have ended."""
        axis, per_deg = self._axis, self._steps_per_deg
        fast = self._parameters[Axis.SEARCH_SPEED] / per_deg
        slow = self._parameters[Axis.SWITCH_SPEED] / per_deg
        procedure = self._settings.search_procedures[self._parameters[Axis.SEARCH_MODE]]
        self._searching, self._run_direction, self._search_end_s = True, 0, math.inf
        leg = Leg(now_s, Outcome.LIMIT)
        if procedure is SearchProcedure.RIGHT_THEN_LEFT:
            leg = axis.run(now_s, 1, fast)
        if procedure is SearchProcedure.HOME_SWITCH:
            leg = axis.to_home_switch(now_s, fast)
            found = leg.outcome is Outcome.ARRIVED
        else:
            for direction, speed in ((-1, fast), (1, slow), (-1, slow)):
                if leg.outcome is Outcome.DEVIATION:
                    break
                run = axis.run if direction < 0 else self._release
                leg = run(leg.end_s, direction, speed)
            found = leg.outcome is Outcome.LIMIT
        self._take(leg, now_s)
        if found:
            self._search_end_s = leg.end_s
            self._parameters[Axis.LAST_REFERENCE] = round(axis.counter_deg(leg.end_s) * per_deg)
            axis.count_from(leg.end_s, 0.0)
            self._target = 0
        elif leg.outcome is Outcome.DEVIATION:
            self._search_end_s = leg.end_s

    def _release(self, start_s: float, direction: int, speed_deg_s: float) -> Leg:
        return self._axis.release(start_s, -direction, speed_deg_s)

    # -- faults

    def on_fault(self, fault: Fault, begins: bool, at_s: float) -> None:
        """A fault of the mechanics begins or ends; others change nothing here."""
        axis = self._axis
        match fault.kind:
            case FaultKind.STAGE_STALL:
                axis.set_stalled(begins, at_s)
            case FaultKind.MISSED_STEPS:
                axis.shortfall_deg = abs(fault.amount) if begins else 0.0
                return
            case FaultKind.LIMIT_SWITCH:
                axis.stuck_switch = (1 if fault.amount >= 0 else -1) if begins else 0
            case _:
                return
        self._resume(at_s)

    def _resume(self, now_s: float) -> None:
        """Plan what is under way again, as the mechanics changed."""
        if now_s >= max(self._leg.end_s, self._search_end_s if self._searching else -math.inf):
            return
        if self.is_searching(now_s):
            speed = self._axis.speed_deg_s(now_s)
            leg = self._axis.run(now_s, 1 if speed > 0 else -1, max(abs(speed), 1e-3))
            self._take(leg, now_s)
            # whatever it meets now is not the reference
            self._search_end_s = leg.end_s if leg.outcome is Outcome.DEVIATION else math.inf
        elif self._run_direction:
            self._take(self._axis.run(now_s, self._run_direction, abs(self._axis.speed_deg_s(now_s))), now_s)
        else:
            self.move(self._target, now_s)
