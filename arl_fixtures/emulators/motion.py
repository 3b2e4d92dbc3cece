"""Motion of one axis: pieces of constant acceleration, so that position is known at any instant, past ones too."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, final

_KEPT_PIECES: Final = 64


class Piece(NamedTuple):
    """Motion with constant acceleration from `start_s` until the next piece begins (degrees, seconds)."""

    start_s: float
    position_deg: float
    velocity_deg_s: float
    acceleration_deg_s2: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Position and velocity at `time_s`."""
        t = time_s - self.start_s
        return (
            self.position_deg + t * (self.velocity_deg_s + 0.5 * self.acceleration_deg_s2 * t),
            self.velocity_deg_s + self.acceleration_deg_s2 * t,
        )

    @property
    def stands(self) -> bool:
        """Whether nothing moves in it."""
        return self.velocity_deg_s == 0.0 and self.acceleration_deg_s2 == 0.0


def plan_move(
    *,
    start_s: float,
    position_deg: float,
    velocity_deg_s: float,
    target_deg: float,
    speed_deg_s: float,
    acceleration_deg_s2: float,
) -> list[Piece]:
    """Trapezoidal (or triangular) velocity profile from a moving start to rest at the target.

    A start too fast to stop before the target, or in the other direction, brakes first and comes back; one
    faster than `speed_deg_s` brakes to it. All accelerations are of one magnitude.

    Returns:
        Pieces without gaps; the last one stands at `target_deg`.
    """
    a, speed = acceleration_deg_s2, speed_deg_s
    pieces: list[Piece] = []
    t, x, v = start_s, position_deg, velocity_deg_s

    def go(duration_s: float, acceleration: float) -> None:
        nonlocal t, x, v
        if duration_s <= 0.0:
            return
        piece = Piece(t, x, v, acceleration)
        pieces.append(piece)
        x, v = piece.at(t + duration_s)
        t += duration_s

    braking_deg = v * abs(v) / (2.0 * a)
    sign = math.copysign(1.0, target_deg - (x + braking_deg))
    if v * sign < 0.0 or (v != 0.0 and abs(x + braking_deg - target_deg) < 1e-12):
        go(abs(v) / a, -math.copysign(a, v))
        v = 0.0
    if abs(target_deg - x) > 1e-12:
        if v * sign > speed:
            go((v * sign - speed) / a, -sign * a)
            v = sign * speed
        v_along = v * sign
        way_deg = max((target_deg - x) * sign, 0.0)
        peak = min(speed, math.sqrt(max(a * way_deg + 0.5 * v_along * v_along, 0.0)))
        peak = max(peak, v_along)
        cruise_deg = way_deg - (2.0 * peak * peak - v_along * v_along) / (2.0 * a)
        go((peak - v_along) / a, sign * a)
        v = sign * peak
        go(max(cruise_deg, 0.0) / peak, 0.0)
        go(peak / a, -sign * a)
    pieces.append(Piece(t, target_deg, 0.0, 0.0))
    return pieces


def plan_stop(
    *, start_s: float, position_deg: float, velocity_deg_s: float, acceleration_deg_s2: float
) -> list[Piece]:
    """Brake to rest; the last piece stands."""
    if velocity_deg_s == 0.0:
        return [Piece(start_s, position_deg, 0.0, 0.0)]
    brake = Piece(start_s, position_deg, velocity_deg_s, -math.copysign(acceleration_deg_s2, velocity_deg_s))
    end_s = start_s + abs(velocity_deg_s) / acceleration_deg_s2
    return [brake, Piece(end_s, brake.at(end_s)[0], 0.0, 0.0)]


@final
class Track:
    """Where an axis was (some moves back), is and, as planned, will be.

    Args:
        position_deg: where it stands from the beginning of time.
    """

    def __init__(self, position_deg: float = 0.0) -> None:
        self._pieces = [Piece(-math.inf, position_deg, 0.0, 0.0)]

    def _index(self, time_s: float) -> int:
        # nearly always one of the last few pieces is asked for
        index = len(self._pieces) - 1
        while index > 0 and self._pieces[index].start_s > time_s:
            index -= 1
        return index

    def at(self, time_s: float) -> tuple[float, float]:
        """Position (degrees) and velocity (degrees per second) at `time_s`."""
        piece = self._pieces[self._index(time_s)]
        if piece.stands:
            return piece.position_deg, 0.0
        return piece.at(max(time_s, piece.start_s))

    @property
    def end_s(self) -> float:
        """Time from which it stands for good, as planned."""
        return self._pieces[-1].start_s

    @property
    def end_deg(self) -> float:
        """Where it will stand."""
        return self._pieces[-1].position_deg

    def at_rest(self, start_s: float, end_s: float) -> bool:
        """Whether it does not move anywhere in [start_s, end_s]."""
        return all(piece.stands for piece in self._pieces[self._index(start_s) : self._index(end_s) + 1])

    def replace(self, now_s: float, pieces: list[Piece]) -> None:
        """Go on from `now_s` with `pieces`, of which the last must stand; what was planned is forgotten."""
        kept = self._pieces[: self._index(now_s) + 1]
        if kept[-1].start_s >= now_s:
            kept.pop()
        self._pieces = kept[-_KEPT_PIECES:] + pieces

    def halt(self, time_s: float) -> None:
        """Stand from `time_s` on, at once."""
        position_deg, _ = self.at(time_s)
        self.replace(time_s, [Piece(time_s, position_deg, 0.0, 0.0)])

    def shift(self, now_s: float, by_deg: float) -> None:
        """Relabel positions from `now_s` on: the same motion, counted from another zero."""
        index = self._index(now_s)
        first = self._pieces[index]
        position_deg, velocity_deg_s = self.at(now_s)
        coming = [Piece(now_s, position_deg, velocity_deg_s, first.acceleration_deg_s2), *self._pieces[index + 1 :]]
        self.replace(now_s, [piece._replace(position_deg=piece.position_deg + by_deg) for piece in coming])

    def first_time_beyond(self, level_deg: float, direction: int, after_s: float) -> float:
        """First time at or after `after_s` at which it is at or beyond `level_deg`, going in `direction`.

        Returns:
            The time; infinity if it never gets there. A track already beyond gives `after_s` if it moves on in
            that direction then, else the time at which it next does.
        """
        first = self._index(after_s)
        for index in range(first, len(self._pieces)):
            piece = self._pieces[index]
            if piece.stands:
                continue
            start_s = max(piece.start_s, after_s)
            end_s = self._pieces[index + 1].start_s
            crossing_s = _crossing_s(piece, level_deg, direction, start_s, end_s)
            if crossing_s is not None:
                return crossing_s
        return math.inf


def _crossing_s(piece: Piece, level_deg: float, direction: int, start_s: float, end_s: float) -> float | None:
    x, v = piece.at(start_s)
    a = piece.acceleration_deg_s2
    over = (x - level_deg) * direction
    heading = v * direction
    if over >= -1e-12 and (heading > 0.0 or (heading == 0.0 and a * direction > 0.0)):
        return start_s
    if a == 0.0:
        if heading <= 0.0:
            return None
        t = -over / heading
        return start_s + t if start_s + t <= end_s else None
    # 0.5 a t² + v t + (x - level) = 0, the earliest root at which it goes in `direction`
    discriminant = v * v - 2.0 * a * (x - level_deg)
    if discriminant < 0.0:
        return None
    root = math.sqrt(discriminant)
    for t in sorted(((-v - root) / a, (-v + root) / a)):
        if 0.0 <= t <= end_s - start_s + 1e-12 and (v + a * t) * direction > 0.0:
            return start_s + t
    return None
