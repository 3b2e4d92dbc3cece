"""The mechanics of the emulated stage: step counter, true angle, limit switches, stalls and lost steps.

The counter is what the motor module believes, in degrees of stage with right positive; the true angle is what the
plant sees. They run in parallel until steps are lost. Every command is planned to its end at once, including what
limit switches and stall detection will do to it, so that both are known at any time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final, Literal, final

from arl_fixtures.emulators.motion import Piece, Track, plan_move, plan_stop

_FAR_DEG: Final = 36_000.0
_RELEASE_DEG: Final = 0.5


class Outcome(Enum):
    """How a motion will end."""

    ARRIVED = "arrived"
    LIMIT = "limit"
    DEVIATION = "deviation"


@dataclass(frozen=True, slots=True)
class Leg:
    """A motion as planned: when it ends, and how."""

    end_s: float
    outcome: Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanics:
    """How the stage is built.

    Attributes:
        sign: +1 if the counter's right is clockwise.
        low_switch_deg: true angle of the limit switch at the small end.
        high_switch_deg: true angle of the limit switch at the large end.
        home_switch_deg: true angle beyond which the home switch is pressed, seen from the right.
    """

    sign: Literal[1, -1] = 1
    low_switch_deg: float = -75.0
    high_switch_deg: float = 75.0
    home_switch_deg: float = 0.0

    def switch_deg(self, direction: int) -> float:
        """True angle of the right (+1) or left (−1) limit switch."""
        return self.high_switch_deg if direction * self.sign > 0 else self.low_switch_deg


@final
class EmulatedAxis:
    """Counter and true angle of one axis.

    Args:
        mechanics: how it is built.
        truth: the plant's track of the true stage angle, degrees clockwise.

    Attributes:
        acceleration_deg_s2: of every motion.
        max_deviation_deg: the motor stops when the encoder is this far from the counter; 0 = never.
        stuck_switch: right (+1) or left (−1) switch that reads as pressed, 0 = none.
        shortfall_deg: every move loses this much.
        soft_stop: whether limit switches brake instead of stopping at once.
        enabled_switches: directions whose switch stops the motor.
    """

    def __init__(self, mechanics: Mechanics, truth: Track) -> None:
        self._mechanics, self._truth = mechanics, truth
        self.counter = Track(0.0)
        self.acceleration_deg_s2 = 100.0
        self.max_deviation_deg = 0.0
        self.stuck_switch = 0
        self.shortfall_deg = 0.0
        self.soft_stop = False
        self.enabled_switches = {1, -1}
        self._stalled = False
        self._encoder_zero_deg = mechanics.sign * truth.end_deg

    # -- what can be asked

    def counter_deg(self, now_s: float) -> float:
        """Counter, degrees, right positive."""
        return self.counter.at(now_s)[0]

    def speed_deg_s(self, now_s: float) -> float:
        """Speed of the counter."""
        return self.counter.at(now_s)[1]

    def encoder_deg(self, now_s: float) -> float:
        """Encoder on the motor shaft, degrees, right positive."""
        return self._mechanics.sign * self._truth.at(now_s)[0] - self._encoder_zero_deg

    def set_encoder(self, value_deg: float, now_s: float) -> None:
        """Relabel the encoder's present position."""
        self._encoder_zero_deg += self.encoder_deg(now_s) - value_deg

    def pressed(self, direction: int, now_s: float) -> bool:
        """Whether the right (+1) or left (−1) limit switch reads as pressed."""
        beyond_deg = self._true_along(direction, now_s) - self._switch_along(direction)
        return self.stuck_switch == direction or beyond_deg >= -1e-9

    def home_pressed(self, now_s: float) -> bool:
        """Whether the home switch reads as pressed: at its angle and left of it."""
        mechanics = self._mechanics
        return mechanics.sign * (self._truth.at(now_s)[0] - mechanics.home_switch_deg) <= 1e-9

    # -- what can be done to it

    def drive(self, start_s: float, target_deg: float, speed_deg_s: float) -> Leg:
        """Move the counter to `target_deg`, from the motion it is in at `start_s`."""
        offset_deg = self._offset(start_s)
        following = self._follows(start_s)
        x, v = self.counter.at(start_s)
        plan = plan_move(
            start_s=start_s,
            position_deg=x,
            velocity_deg_s=v,
            target_deg=target_deg,
            speed_deg_s=speed_deg_s,
            acceleration_deg_s2=self.acceleration_deg_s2,
        )
        self.counter.replace(start_s, plan)
        if self._stalled:
            self._truth.halt(start_s)
        elif following and not self.shortfall_deg:
            self._truth.replace(start_s, self._mirrored(plan, offset_deg))
        else:
            lost_deg = min(self.shortfall_deg, abs(target_deg - x))
            end_deg = target_deg - math.copysign(lost_deg, target_deg - x)
            angle_deg, turning = self._truth.at(start_s)
            self._truth.replace(
                start_s,
                plan_move(
                    start_s=start_s,
                    position_deg=angle_deg,
                    velocity_deg_s=turning,
                    target_deg=self._mechanics.sign * end_deg + offset_deg,
                    speed_deg_s=speed_deg_s,
                    acceleration_deg_s2=self.acceleration_deg_s2,
                ),
            )
        return self._supervise(start_s)

    def run(self, start_s: float, direction: int, speed_deg_s: float) -> Leg:
        """Move on in one direction until something stops it."""
        return self.drive(start_s, self.counter_deg(start_s) + direction * _FAR_DEG, speed_deg_s)

    def brake(self, start_s: float) -> Leg:
        """Decelerate to rest."""
        offset_deg, following = self._offset(start_s), self._follows(start_s)
        x, v = self.counter.at(start_s)
        plan = plan_stop(
            start_s=start_s, position_deg=x, velocity_deg_s=v, acceleration_deg_s2=self.acceleration_deg_s2
        )
        self.counter.replace(start_s, plan)
        if following and not self._stalled:
            self._truth.replace(start_s, self._mirrored(plan, offset_deg))
        else:
            self._truth.halt(start_s)
        return Leg(self.counter.end_s, Outcome.ARRIVED)

    def release(self, start_s: float, direction: int, speed_deg_s: float) -> Leg:
        """Move a little away from the switch in `direction`, just off it."""
        return self.drive(start_s, self.counter_deg(start_s) - direction * _RELEASE_DEG, speed_deg_s)

    def to_home_switch(self, start_s: float, speed_deg_s: float) -> Leg:
        """Move to where the home switch changes."""
        way_deg = self._mechanics.sign * (self._mechanics.home_switch_deg - self._truth.at(start_s)[0])
        return self.drive(start_s, self.counter_deg(start_s) + way_deg, speed_deg_s)

    def count_from(self, time_s: float, value_deg: float) -> None:
        """Relabel the counter's position from `time_s` on."""
        self.counter.shift(time_s, value_deg - self.counter_deg(time_s))

    def set_stalled(self, stalled: bool, now_s: float) -> None:
        """Block the mechanics, or free them; a motion under way must be commanded again."""
        self._stalled = stalled
        if stalled:
            self._truth.halt(now_s)

    def power_down(self, now_s: float) -> None:
        """Motor without current: it stands, and the counter starts anew."""
        self._truth.halt(now_s)
        self.counter = Track(0.0)
        self._encoder_zero_deg = self._mechanics.sign * self._truth.end_deg

    # -- planning

    def _offset(self, time_s: float) -> float:
        """True angle where the counter would be zero."""
        return self._truth.at(time_s)[0] - self._mechanics.sign * self.counter_deg(time_s)

    def _follows(self, time_s: float) -> bool:
        return abs(self._truth.at(time_s)[1] - self._mechanics.sign * self.speed_deg_s(time_s)) < 1e-9

    def _mirrored(self, plan: list[Piece], offset_deg: float) -> list[Piece]:
        sign = self._mechanics.sign
        return [Piece(t, sign * x + offset_deg, sign * v, sign * a) for t, x, v, a in plan]

    def _true_along(self, direction: int, time_s: float) -> float:
        return self._truth.at(time_s)[0] * self._mechanics.sign * direction

    def _switch_along(self, direction: int) -> float:
        return self._mechanics.switch_deg(direction) * self._mechanics.sign * direction

    def _supervise(self, start_s: float) -> Leg:
        """Cut the plan where a limit switch or the stall detection will stop the motor."""
        limit_s = min((self._limit_s(direction, start_s) for direction in self.enabled_switches), default=math.inf)
        deviation_s = self._deviation_s(start_s)
        stop_s = min(limit_s, deviation_s)
        if stop_s == math.inf:
            return Leg(self.counter.end_s, Outcome.ARRIVED)
        if deviation_s <= limit_s:
            self.counter.halt(stop_s)
            self._truth.halt(stop_s)
            return Leg(stop_s, Outcome.DEVIATION)
        if self.soft_stop:
            return Leg(self.brake(stop_s).end_s, Outcome.LIMIT)
        self.counter.halt(stop_s)
        self._truth.halt(stop_s)
        return Leg(stop_s, Outcome.LIMIT)

    def _limit_s(self, direction: int, start_s: float) -> float:
        """When the motor, going in `direction`, meets a pressed switch on that side."""
        if self.stuck_switch == direction:
            return self.counter.first_time_beyond(-direction * math.inf, direction, start_s)
        turning = direction * self._mechanics.sign
        return self._truth.first_time_beyond(self._mechanics.switch_deg(direction), turning, start_s)

    def _deviation_s(self, start_s: float) -> float:
        allowed_deg = self.max_deviation_deg
        if allowed_deg <= 0.0:
            return math.inf
        if self._stalled:
            encoder_deg = self.encoder_deg(start_s)
            return min(
                self.counter.first_time_beyond(encoder_deg + allowed_deg, 1, start_s),
                self.counter.first_time_beyond(encoder_deg - allowed_deg, -1, start_s),
            )
        end_s = max(self.counter.end_s, self._truth.end_s)
        return end_s if abs(self.encoder_deg(end_s) - self.counter_deg(end_s)) > allowed_deg else math.inf
