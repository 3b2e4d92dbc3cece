"""Long waits are shared: whoever waits for a device lets others do something meanwhile, such as look at the rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, final

from arl_fixtures.devices.port import Clock

Idle = Callable[[], None]
"""What is done in a break of a wait. It may raise, which ends the wait, and may ask any device, this one too."""

BREAK_S: Final = 0.65
"""Longest wait without a break."""


def nothing() -> None:
    """Nobody has anything to do."""


@final
class Breaks:
    """The breaks of one wait; each comes between two exchanges, never inside one.

    Args:
        clock: the bench clock.
        idle: what is done in them.
    """

    def __init__(self, clock: Clock, idle: Idle) -> None:
        self._clock, self._idle = clock, idle
        self._last_s = clock.now_s

    def sleep(self, duration_s: float) -> None:
        """Let time pass; who must be there in time at its end is."""
        clock = self._clock
        end_s = clock.now_s + duration_s
        while (left_s := end_s - clock.now_s) > BREAK_S:
            clock.sleep(BREAK_S)
            self.take()
        clock.sleep(left_s)

    def take(self) -> bool:
        """A break, if it is time for one; returns whether it was."""
        if self._clock.now_s - self._last_s < BREAK_S - 1e-9:
            return False
        self._idle()
        self._last_s = self._clock.now_s
        return True
