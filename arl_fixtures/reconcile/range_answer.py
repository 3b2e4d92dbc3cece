"""What a range answers to a change of the light: as in the simulation itself, whose threshold weak returns meet late.

A comparator at a fixed level makes distances of the signal, and a simulation that has one shows by how much: its
distance less the true range is one curve over its signal, whatever is looked at. What an effect does to the light
before the comparator it then does to the distance as well, without a parameter of its own (Kilpelä et al., Rev. Sci.
Instrum. 72 (2001) 13). Light that a converter or a number changes behind it leaves the distance alone: the table
decides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import distances, per_table, pure_rows, signals, simulated_range_m
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View

_BEYOND = 0.5
"""How far beyond its ends, in the logarithm of the signal, a curve goes on: no simulation shows what comes there."""
_KNOTS, _FEWEST = 24, 12
"""Points of a curve at most, and rows for each at least."""
_LEAST_M, _CLEAR = 1e-4, 5.0
"""What a curve must span: in metres, and how many times its rows' scatter about it."""
_RATHER = 0.5
"""Share of what a curve over the range leaves, up to which one over the signal may leave: dim surfaces lie far."""
_FALLS, _WINDS = 0.1, 1.3
"""Share of its span by which a curve over the signal may rise; and how much farther one over the range must go up and
down than it comes to be none: each of a few targets has its range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """A distance over the logarithm of a signal, straight between points and a little beyond them.

    Attributes:
        distance, signal: channels.
        light: natural logarithms of the signal, ascending; range: distance there, in its unit.
    """

    distance: str
    signal: str
    light: tuple[float, ...]
    range: tuple[float, ...]

    def to(self, before: State, after: State) -> None:
        """Let the distance after an effect answer to what this did to the signal, where both are positive."""
        if self.distance not in before or self.signal not in before:
            return
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = self._at(np.log(after[self.signal])) - self._at(np.log(before[self.signal]))
        after[self.distance] = after[self.distance] + np.where(np.isfinite(moved), moved, 0.0)

    def _at(self, log: FloatArray) -> FloatArray:
        x, y = np.asarray(self.light), np.asarray(self.range)
        low, high = (float((y[b] - y[a]) / (x[b] - x[a])) for a, b in ((0, 1), (-2, -1)))
        beyond = np.clip(log - x[0], -_BEYOND, 0.0), np.clip(log - x[-1], 0.0, _BEYOND)
        outside = low * beyond[0] + high * beyond[1]
        return np.asarray(np.interp(log, x, y) + outside)


def answers(view: View) -> tuple[Answer, ...]:
    """Of each pair of a distance and a signal of a table the curve that its simulation shows, if it does."""
    return per_table(view, "range answers", lambda: _answers(view))


def _answers(view: View) -> tuple[Answer, ...]:
    table = view.columns
    if "true_range_m" not in table.numbers:
        return ()
    found = []
    for distance in distances(view):
        metre = per_metre(unit_of(distance))
        true = simulated_range_m(view) * metre
        late = table.numbers[f"sim_{distance}"] - true
        for signal in signals(view):
            with np.errstate(divide="ignore", invalid="ignore"):
                light = np.log(table.numbers[f"sim_{signal}"])
            good = pure_rows(view) & np.isfinite(late) & np.isfinite(light) & np.isfinite(true)
            at, by, left = _curve(light[good], late[good])
            _, over_range, rest = _curve(true[good], late[good])
            span = float(np.ptp(by)) if at.size > 1 else 0.0
            if span <= max(_CLEAR * left, _LEAST_M * metre) or np.sum(np.diff(by).clip(0.0)) > _FALLS * span:
                continue
            steps = np.diff(over_range)
            if left < _RATHER * rest or np.sum(np.abs(steps)) > _WINDS * abs(np.sum(steps)):
                found.append(Answer(distance=distance, signal=signal, light=_numbers(at), range=_numbers(by)))
    return tuple(found)


def _curve(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Medians of both in as many parts of x, and how far rows usually lie from the straight lines between them."""
    nothing = np.empty(0), np.empty(0), np.inf
    parts = int(min(_KNOTS, x.size // _FEWEST))
    if parts < 2:
        return nothing
    order = np.argsort(x, kind="stable")
    pieces = np.array_split(order, parts)
    at, by = (np.array([np.median(values[piece]) for piece in pieces]) for values in (x, y))
    own: NDArray[np.bool_] = np.concatenate([[True], np.diff(at) > 1e-9])
    at, by = at[own], by[own]
    if at.size < 2:
        return nothing
    return at, by, float(np.median(np.abs(y - np.interp(x, at, by))))


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(f"{value:.9g}") for value in values)
