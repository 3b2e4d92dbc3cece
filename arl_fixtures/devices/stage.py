"""Rotary stage on a Trinamic motor module, TMCL direct mode on a serial line or through a TCP converter.

Two traps of TMCL are answered here: a position is volatile (a marker in a user variable tells whether the module
restarted), and "position reached" never comes at a limit switch (standing still without it is examined).
"""

from __future__ import annotations

from typing import Final, Literal, final

from pydantic import Field

from arl_fixtures.devices.idling import Breaks, Idle, nothing
from arl_fixtures.devices.interfaces import Identity
from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.devices.tmcl_module import TmclModule, TmclModuleSettings
from arl_fixtures.errors import DeviceError, DeviceTimeoutError, LocalProtocolError
from arl_fixtures.protocols.tmcl import Axis, Command, ErrorFlag, MoveType, SearchType

_HOMED_MARKER: Final = 0x41524C31
_SEARCH_POLL_S: Final = 0.05
_STOP_TIMEOUT_S: Final = 2.0
_RESTARTED: Final = "it restarted and lost its position; home it"


class TmclSettings(TmclModuleSettings):
    """Mechanics and motion; times on the bench clock."""

    full_steps: int = Field(default=200, gt=0, description="per motor turn")
    microsteps: Literal[1, 2, 4, 8, 16, 32, 64, 128, 256] = Field(default=256, description="per full step")
    gear: float = Field(default=72.0, gt=0, description="motor turns per stage turn")
    clockwise_sign: Literal[1, -1] = Field(default=1, description="direction of the counter for a clockwise turn")
    max_speed_deg_s: float = Field(default=20.0, gt=0, description="of the stage")
    acceleration_deg_s2: float = Field(default=100.0, gt=0, description="of the stage, speeding up and braking")
    search_mode: int = Field(default=1, description="of reference search; numbers are specific to the module")
    search_speed_deg_s: float = Field(default=10.0, gt=0, description="towards the switch")
    switch_speed_deg_s: float = Field(default=0.5, gt=0, description="off the switch and back, slowly")
    reference_angle_deg: float = Field(default=-75.0, description="stage angle where the search sets zero")
    reference_window_deg: float = Field(default=3.0, gt=0, description="largest distance from zero after a search")
    minimum_deg: float = Field(default=-70.0, description="it is never sent below")
    maximum_deg: float = Field(default=70.0, description="it is never sent beyond")
    tolerance_deg: float = Field(default=0.02, gt=0, description="between target, counter and encoder at rest")
    encoder: bool = Field(default=True, description="compare the encoder (parameter 209) with the counter")
    encoder_counts_per_microstep: float = Field(default=1.0, gt=0, description="unit of parameter 209")
    pps_per_speed_unit: float = Field(default=1.0, gt=0, description="1: module counts in pps (TMC5160 and alike)")
    pps2_per_acceleration_unit: float = Field(default=1.0, gt=0, description="1: module counts in pps²")
    stop_at_deviation_deg: float = Field(default=1.0, ge=0, description="module stops the motor; 0 = never")
    poll_s: float = Field(default=0.005, gt=0, description="between two looks at 'reached'")
    driver_fault_mask: int = Field(default=0b0001_1110, description="bits of parameter 208 that are faults")
    marker_variable: int = Field(default=50, ge=0, le=55, description="user variable, zero after a restart")

    @property
    def steps_per_deg(self) -> float:
        """Microsteps per degree of stage."""
        return self.full_steps * self.microsteps * self.gear / 360.0


@final
class TmclStage:
    """Driver for one axis of a Trinamic module.

    Before `home`, angles count from where the module was switched on and the stage cannot be sent anywhere.

    Args:
        port: the line.
        clock: the bench clock.
        settings: mechanics, motion and patience.
    """

    def __init__(self, port: StreamPort, clock: Clock, settings: TmclSettings | None = None) -> None:
        self._settings = settings = settings or TmclSettings()
        self._clock = clock
        self._module = TmclModule("stage", port, clock, settings)
        self._homed = False
        self._flags = 0
        self._target_steps: int | None = None
        self._start_steps = 0
        self._arrival_s = 0.0

    @property
    def limits_deg(self) -> tuple[float, float]:
        """Smallest and largest angle it may be sent to."""
        return self._settings.minimum_deg, self._settings.maximum_deg

    def identify(self) -> Identity:
        """Module number and firmware version."""
        number, firmware = self._module.version()
        return Identity(name=f"TMCM-{number}", firmware=firmware)

    def home(self, timeout_s: float, idle: Idle = nothing) -> None:
        """Configure the axis, search the reference and move into the allowed range.

        There no limit switch may be pressed any more: one that is found its reference anywhere.

        Args:
            timeout_s: for all of it.
            idle: what is done meanwhile, now and then.

        Raises:
            DeviceTimeoutError: the search did not end in time; it is stopped.
            DeviceError: the module refused a parameter, the axis stalled, or a limit switch is stuck.
        """
        self._homed, self._flags, self._target_steps = False, 0, None
        self.stop()
        self._configure()
        self._module.do(Command.REFERENCE_SEARCH, SearchType.START)
        deadline_s = self._clock.now_s + timeout_s
        breaks = Breaks(self._clock, idle)
        while self._module.do(Command.REFERENCE_SEARCH, SearchType.STATUS):
            if self._clock.now_s >= deadline_s:
                self._module.do(Command.REFERENCE_SEARCH, SearchType.STOP)
                self.stop()
                raise DeviceTimeoutError(f"{self._module.place}: reference not found within {timeout_s:g} s")
            breaks.sleep(_SEARCH_POLL_S)
            breaks.take()
        trouble = self.fault()
        if trouble:
            raise DeviceError(f"{self._module.place}: reference search failed: {trouble}")
        steps = self._align_encoder()
        if abs(steps) > self._settings.reference_window_deg * self._settings.steps_per_deg:
            raise DeviceError(f"{self._module.place}: reference search ended {steps} microsteps away from its zero")
        self._module.set_user(self._settings.marker_variable, _HOMED_MARKER)
        self._homed, self._start_steps = True, steps
        low, high = self.limits_deg
        self.move_to_deg(min(max(self._settings.reference_angle_deg, low), high))
        try:
            self.wait_until_reached(deadline_s - self._clock.now_s, idle)
            pressed = self._pressed_switches()
            if pressed:
                raise DeviceError(f"{self._module.place}: {pressed} limit switch is pressed at {self._angle_text()}")
        except DeviceError:
            self._homed = False
            raise

    def move_to_deg(self, angle_deg: float) -> None:
        """Start to move; returns at once (two exchanges).

        Raises:
            LocalProtocolError: the angle is outside the limits.
            DeviceError: the stage has not been homed since it was switched on.
        """
        low, high = self.limits_deg
        if not low <= angle_deg <= high:
            raise LocalProtocolError(f"{self._module.place}: {angle_deg:g}° is outside {low:g}° … {high:g}°")
        if not self._homed:
            raise DeviceError(f"{self._module.place}: not homed")
        self._require_marker()
        settings = self._settings
        target = round(settings.clockwise_sign * (angle_deg - settings.reference_angle_deg) * settings.steps_per_deg)
        way_deg = abs(target - self._start_steps) / settings.steps_per_deg
        asked_s = self._clock.now_s
        self._module.do(Command.MOVE, MoveType.ABSOLUTE, target)
        self._target_steps = self._start_steps = target
        # it set off somewhere between question and answer
        began_s = (asked_s + self._clock.now_s) / 2
        self._arrival_s = began_s + _duration_s(way_deg, settings.max_speed_deg_s, settings.acceleration_deg_s2)

    def wait_until_reached(self, timeout_s: float, idle: Idle = nothing) -> float:
        """Wait for the end of the move.

        Most of the expected time is slept through; then `reached` is asked every `poll_s`. Where it stands is
        verified after that, which takes a while on a serial line and does not change since when it stood.

        Args:
            timeout_s: from now.
            idle: what is done meanwhile, now and then.

        Returns:
            Bench time of the answer `reached`: it has stood since then at the latest.

        Raises:
            DeviceError: it stands somewhere else; the message names limit switch, stall, missed steps or restart.
            DeviceTimeoutError: it still moves after `timeout_s`.
        """
        clock = self._clock
        if self._target_steps is None:
            raise LocalProtocolError(f"{self._module.place}: no move was started")
        deadline_s = clock.now_s + timeout_s
        breaks = Breaks(clock, idle)
        breaks.sleep(min(self._arrival_s - clock.now_s, timeout_s))
        while not self._module.axis(Axis.REACHED):
            if not self.moving() and not self._module.axis(Axis.REACHED):
                raise DeviceError(f"{self._module.place}: stands at {self._angle_text()}, {self._why_not_reached()}")
            if clock.now_s >= deadline_s:
                where = self._angle_text()
                raise DeviceTimeoutError(f"{self._module.place}: still moves after {timeout_s:g} s, at {where}")
            breaks.sleep(self._settings.poll_s)
            breaks.take()
        stands_since_s = clock.now_s
        self._verify_arrival(self._target_steps)
        return stands_since_s

    def position_deg(self) -> float:
        """Stage angle by the step counter."""
        return self._to_deg(self._module.axis(Axis.ACTUAL))

    def moving(self) -> bool:
        """Whether the counter runs."""
        return self._module.axis(Axis.ACTUAL_SPEED) != 0

    def stop(self) -> None:
        """Brake, and wait until it stands.

        Raises:
            DeviceError: it still turns after two seconds.
        """
        self._module.do(Command.STOP)
        deadline_s = self._clock.now_s + _STOP_TIMEOUT_S
        while self.moving():
            if self._clock.now_s >= deadline_s:
                raise DeviceError(f"{self._module.place}: still turns {_STOP_TIMEOUT_S:g} s after stop")
            self._clock.sleep(self._settings.poll_s)
        self._start_steps = self._module.axis(Axis.ACTUAL)

    def fault(self) -> str:
        """What is wrong, in words; empty when nothing is. Error flags are kept until the next `home`."""
        # the module forgets its error flags when they are read
        self._flags |= self._module.axis(Axis.ERROR_FLAGS)
        found = []
        if self._flags & ErrorFlag.STALLGUARD:
            found.append("stall detected by load")
        if self._flags & ErrorFlag.DEVIATION:
            found.append("stalled: encoder does not follow")
        driver = self._module.axis(Axis.DRIVER_FLAGS) & self._settings.driver_fault_mask
        if driver:
            found.append(f"motor driver flags {driver:#04x}")
        if self._homed and self._module.user(self._settings.marker_variable) != _HOMED_MARKER:
            self._homed = False
            found.append(_RESTARTED)
        return "; ".join(found)

    def close(self) -> None:
        """Release the line; the stage goes on with what it was told."""
        self._module.close()

    # -- verification

    def _verify_arrival(self, target: int) -> None:
        settings = self._settings
        tolerance = settings.tolerance_deg * settings.steps_per_deg
        actual = self._module.axis(Axis.ACTUAL)
        if abs(actual - target) > tolerance:
            self._require_marker()
            raise DeviceError(
                f"{self._module.place}: stands at {self._to_deg(actual):.3f}°, not {self._to_deg(target):.3f}°"
            )
        if settings.encoder:
            encoder = self._module.axis(Axis.ENCODER) / settings.encoder_counts_per_microstep
            if abs(encoder - actual) > tolerance:
                raise DeviceError(
                    f"{self._module.place}: missed steps: counter says {self._to_deg(actual):.3f}°, "
                    f"encoder {self._to_deg(encoder):.3f}°"
                )

    def _why_not_reached(self) -> str:
        trouble = self.fault()
        if trouble:
            return trouble
        pressed = self._pressed_switches()
        if pressed:
            return f"stopped by the {pressed} limit switch"
        return "target never reached, for no reason the module tells"

    def _pressed_switches(self) -> str:
        right, left = self._module.axis(Axis.RIGHT_SWITCH), self._module.axis(Axis.LEFT_SWITCH)
        return " and ".join(name for name, pressed in (("right", right), ("left", left)) if pressed)

    def _require_marker(self) -> None:
        if self._module.user(self._settings.marker_variable) != _HOMED_MARKER:
            self._homed = False
            raise DeviceError(f"{self._module.place}: {_RESTARTED}")

    def _angle_text(self) -> str:
        return f"{self.position_deg():.3f}°"

    def _to_deg(self, steps: float) -> float:
        settings = self._settings
        if not self._homed:
            return settings.clockwise_sign * steps / settings.steps_per_deg
        return settings.reference_angle_deg + settings.clockwise_sign * steps / settings.steps_per_deg

    def _configure(self) -> None:
        settings, per_deg = self._settings, self._settings.steps_per_deg
        speed_units = per_deg / settings.pps_per_speed_unit
        parameters = {
            Axis.MICROSTEP_RESOLUTION: settings.microsteps.bit_length() - 1,
            Axis.MAX_SPEED: round(settings.max_speed_deg_s * speed_units),
            Axis.ACCELERATION: round(settings.acceleration_deg_s2 * per_deg / settings.pps2_per_acceleration_unit),
            Axis.SEARCH_MODE: settings.search_mode,
            Axis.SEARCH_SPEED: round(settings.search_speed_deg_s * speed_units),
            Axis.SWITCH_SPEED: round(settings.switch_speed_deg_s * speed_units),
        }
        if settings.encoder:
            deviation = settings.stop_at_deviation_deg * per_deg * settings.encoder_counts_per_microstep
            parameters[Axis.MAX_ENCODER_DEVIATION] = round(deviation)
        for parameter, value in parameters.items():
            self._module.set_axis(parameter, value)
        # steps lost before would stop the search at once
        self._align_encoder()
        self._module.axis(Axis.ERROR_FLAGS)

    def _align_encoder(self) -> int:
        """Let the encoder agree with the counter; returns the counter."""
        steps = self._module.axis(Axis.ACTUAL)
        if self._settings.encoder:
            self._module.set_axis(Axis.ENCODER, round(steps * self._settings.encoder_counts_per_microstep))
        return steps


def _duration_s(way_deg: float, speed_deg_s: float, acceleration_deg_s2: float) -> float:
    """Time of a trapezoidal move from rest to rest."""
    if way_deg <= speed_deg_s**2 / acceleration_deg_s2:
        return 2.0 * float((way_deg / acceleration_deg_s2) ** 0.5)
    return way_deg / speed_deg_s + speed_deg_s / acceleration_deg_s2
