"""What an emulated device is: a thing that receives bytes and sends bytes at bench times of its own choice.

Emulators hold no socket and no clock of their own. Whoever runs them (the virtual links of `arl_fixtures.bench`,
or `arl emulate` in real time) calls `receive` when bytes arrive and `due` to collect what they send.
All emulators of a bench share one `Plant`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable


class Outgoing(NamedTuple):
    """Bytes that leave the device at `time_s` on the bench clock."""

    time_s: float
    data: bytes


class StreamDevice(Protocol):
    """An emulated device on a byte stream (serial line, TCP)."""

    def receive(self, data: bytes, now_s: float) -> list[Outgoing]:
        """Bytes from the host arrived at `now_s`; returns the answers, each with the time it leaves the device."""

    def disconnect(self, now_s: float) -> None:
        """The host closed the line: what the device had half received is forgotten."""


class DatagramDevice(Protocol):
    """An emulated device that sends UDP by itself."""

    @property
    def address(self) -> str:
        """Sender address, as the host sees it."""

    def next_time_s(self, now_s: float) -> float:
        """Earliest time at or after `now_s` at which it will send; infinity while it is off."""

    def send(self, now_s: float, until_s: float) -> list[tuple[int, Outgoing]]:
        """Everything that leaves in `now_s` < time <= `until_s`, as (destination UDP port, datagram) in time order.

        Only called while somebody listens: what nobody hears need not be computed, and skipping must not change
        what is sent later (noise is a function of seed and frame number).
        """


@runtime_checkable
class BulkyDevice(DatagramDevice, Protocol):
    """One that sends much to one port, which is dear to compute, and little to others."""

    @property
    def bulk_port(self) -> int:
        """Destination of what is dear."""

    def send_bulk(self, now_s: float, until_s: float) -> list[tuple[int, Outgoing]]:
        """As `send`, only what goes to that port."""

    def send_rest(self, now_s: float, until_s: float) -> list[tuple[int, Outgoing]]:
        """As `send`, only what goes to others."""
