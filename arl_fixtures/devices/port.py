"""What a driver needs of the world: a clock and a port. `arl_fixtures.bench` implements both.

A driver never knows whether time is real or virtual, nor whether a port ends in hardware or in an emulator.
Time is seconds on the *bench clock*; all time-outs of drivers are on that clock.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Clock(Protocol):
    """The bench clock. Virtual clocks jump when everyone waits."""

    @property
    def now_s(self) -> float:
        """Seconds since the start of the session, never running backwards."""

    def utc_ns(self) -> int:
        """Bench time as nanoseconds since 1970-01-01 UTC, for time stamps."""

    def sleep(self, duration_s: float) -> None:
        """Let bench time pass."""


class StreamPort(Protocol):
    """An ordered byte stream to one device: serial line or TCP connection."""

    @property
    def name(self) -> str:
        """The URL as written in the bench file, for messages."""

    def write(self, data: bytes) -> None:
        """Send all of `data`. Raises DeviceLostError."""

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, at least one byte, or `b""` when nothing came in `timeout_s`. Raises DeviceLostError."""

    def drain(self) -> bytes:
        """Take what lies unread, without waiting."""

    def reopen(self) -> None:
        """Close and open again: whatever was under way on the line is gone. Raises DeviceLostError."""

    def close(self) -> None:
        """Release the line. Closing twice is no error."""


class Datagram(NamedTuple):
    """One UDP payload with its sender's address and the bench time of its arrival."""

    payload: bytes
    sender: str
    time_s: float


class DatagramPort(Protocol):
    """A UDP socket that listens at one port; several devices may send to it."""

    @property
    def name(self) -> str:
        """The URL as written in the bench file, for messages."""

    def receive(self, timeout_s: float) -> list[Datagram]:
        """All datagrams that have arrived, in order; empty when none came in `timeout_s`."""

    def discard(self, before_s: float = float("inf")) -> int:
        """Forget what lies unread and arrived before `before_s`; returns how many datagrams that were."""

    def close(self) -> None:
        """Release the socket. Closing twice is no error."""
