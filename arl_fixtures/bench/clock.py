"""The bench clock, real or virtual. No code outside this file and `links` knows which one runs.

A virtual clock holds events. Whoever waits lets it run: it jumps from event to event until what is waited for
has happened or the deadline is reached. There is one waiting thread, so the order of events is the same each run.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Callable
from typing import Final, final

from arl_fixtures.errors import LocalProtocolError

VIRTUAL_EPOCH_NS: Final = 1_767_225_600_000_000_000
"""2026-01-01T00:00:00Z: virtual sessions start here, so that the same seed gives the same bytes."""


@final
class RealClock:
    """Wall time, monotonic."""

    virtual = False

    def __init__(self) -> None:
        self._start_s = time.monotonic()
        self._epoch_ns = time.time_ns()

    @property
    def now_s(self) -> float:
        """Seconds since the clock was made."""
        return time.monotonic() - self._start_s

    def utc_ns(self) -> int:
        """Start of the clock in UTC plus monotonic time since: never jumps with the system time."""
        return self._epoch_ns + round(self.now_s * 1e9)

    def sleep(self, duration_s: float) -> None:
        """Block the calling thread."""
        if duration_s > 0:
            time.sleep(duration_s)


@final
class VirtualClock:
    """Discrete-event time.

    Args:
        epoch_ns: UTC of `now_s` = 0.
        start_s: bench time at the start (a resumed session goes on where its journal ended).
    """

    virtual = True

    def __init__(self, *, epoch_ns: int = VIRTUAL_EPOCH_NS, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._epoch_ns = self._host_epoch_ns = epoch_ns
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()

    @property
    def now_s(self) -> float:
        """Seconds on the bench clock."""
        return self._now_s

    def utc_ns(self) -> int:
        """Virtual UTC: never jumps, as that of a `RealClock`."""
        return self._epoch_ns + round(self._now_s * 1e9)

    @property
    def host_epoch_ns(self) -> int:
        """The host's UTC at `now_s` = 0, as a bench clock that is made now takes it."""
        return self._host_epoch_ns

    def jump_host(self, jump_s: float) -> None:
        """Somebody sets the host's wall clock; clocks that are there already go on as before."""
        self._host_epoch_ns += round(jump_s * 1e9)

    @property
    def next_event_s(self) -> float:
        """When the next event is due; infinity when there is none."""
        return self._events[0][0] if self._events else float("inf")

    def at(self, time_s: float, action: Callable[[], None]) -> None:
        """Run `action` when the clock reaches `time_s`; equal times run in the order they were asked for."""
        heapq.heappush(self._events, (max(time_s, self._now_s), next(self._order), action))

    def sleep(self, duration_s: float) -> None:
        """Jump, running what is due on the way."""
        self.wait(lambda: False, duration_s)

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Run events until `ready()` holds or `timeout_s` has passed; returns whether it holds.

        Raises:
            LocalProtocolError: an endless wait with nothing left to happen.
        """
        deadline_s = self._now_s + max(timeout_s, 0.0)
        while not ready():
            if self._events and self._events[0][0] <= deadline_s:
                due_s, _, action = heapq.heappop(self._events)
                self._now_s = due_s
                action()
                continue
            if deadline_s == float("inf"):
                msg = "virtual clock: waiting without a time-out for something that will never happen"
                raise LocalProtocolError(msg)
            self._now_s = deadline_s
            return ready()
        return True


AnyClock = RealClock | VirtualClock
