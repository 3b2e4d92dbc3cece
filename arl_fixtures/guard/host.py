"""Where the guard's time and lines come from: real hardware, or a lab. Waiting never makes it deaf to the test."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from typing import Any, Final, Protocol, final

from arl_fixtures.bench.clock import RealClock
from arl_fixtures.bench.config import BenchConfig
from arl_fixtures.bench.drivers import Kind, find_driver
from arl_fixtures.bench.ports import UdpPort, open_stream
from arl_fixtures.devices.port import Clock, DatagramPort, StreamPort
from arl_fixtures.lab.client import LabClient, LabStreamPort

_SLICE_S: Final = 0.02


class Attention(Protocol):
    """What the guard listens to while it waits for something else."""

    def sockets(self) -> Sequence[Any]:
        """Everything that may speak."""

    def attend(self) -> bool:
        """Something spoke: hear it without blocking. True if the waiting is to be cut short."""


class Host(Protocol):
    """Time and lines."""

    @property
    def clock(self) -> Clock:
        """The bench clock."""

    def open(self, kind: Kind) -> StreamPort:
        """Own a control line."""

    def datagrams(self, port: int) -> DatagramPort:
        """Listen at a UDP port.

        Raises:
            DeviceLostError: somebody else does.
        """

    def read(self, port: StreamPort, timeout_s: float, attention: Attention) -> bytes:
        """What arrived on a line within `timeout_s`; empty also when cut short."""

    def sleep(self, until_s: float, attention: Attention) -> None:
        """Let bench time pass until `until_s` or until cut short."""

    def adopt(self, client: int) -> None:
        """From now on the guard acts for a test that waits for it."""

    def release(self, client: int) -> None:
        """The test acts for itself again."""

    def close(self) -> None:
        """Leave."""


@final
class RealHost:
    """Lines as the bench file says, wall time.

    Args:
        config: the bench file.
    """

    def __init__(self, config: BenchConfig) -> None:
        self._config = config
        self.clock: Clock = RealClock()

    def open(self, kind: Kind) -> StreamPort:
        """Own a control line."""
        entry = self._config.devices()[kind]
        return open_stream(entry.url, default_baud=find_driver(entry.driver, kind).default_baud)

    def datagrams(self, port: int) -> DatagramPort:
        """Listen at a UDP port of the host."""
        host = self._config.duts.listen
        return UdpPort(f"udp://{host}:{port}", host, port, self.clock)

    def read(self, port: StreamPort, timeout_s: float, attention: Attention) -> bytes:
        """What arrived on a line within `timeout_s`."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            left_s = deadline_s - time.monotonic()
            if data := port.read(min(max(left_s, 0.0), _SLICE_S)):
                return data
            if left_s <= _SLICE_S:
                return b""
            sockets = attention.sockets()
            if sockets and select.select(sockets, [], [], 0.0)[0] and attention.attend():
                return b""

    def sleep(self, until_s: float, attention: Attention) -> None:
        """Let time pass."""
        while (left_s := until_s - self.clock.now_s) > 0.0:
            if select.select(attention.sockets(), [], [], left_s)[0] and attention.attend():
                return

    def adopt(self, client: int) -> None:
        """Nothing to do: real time waits for nobody."""

    def release(self, client: int) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Nothing is held."""


@final
class LabHost:
    """Lines and time of a lab.

    Args:
        client: connection to it.
    """

    def __init__(self, client: LabClient) -> None:
        self._client = client
        self.clock: Clock = client.clock

    def open(self, kind: Kind) -> StreamPort:
        """Own a control line."""
        return self._client.port(kind)

    def datagrams(self, port: int) -> DatagramPort:
        """Listen at a UDP port of the lab."""
        return self._client.datagrams(port)

    def read(self, port: StreamPort, timeout_s: float, attention: Attention) -> bytes:
        """What arrived on a line within `timeout_s`."""
        if not isinstance(port, LabStreamPort):
            return port.read(timeout_s)
        header, payload = port.reading(timeout_s)
        answer = self._client.ask_attentively("read", header, attention.sockets, attention.attend, payload)
        return answer.payload

    def sleep(self, until_s: float, attention: Attention) -> None:
        """Let the lab's time pass."""
        self._client.ask_attentively("sleep", {"until_s": until_s}, attention.sockets, attention.attend)

    def adopt(self, client: int) -> None:
        """The test waits for the guard, so it must not hold the clock."""
        self._client.adopt(client)

    def release(self, client: int) -> None:
        """The test goes on: it holds the clock again."""
        self._client.release(client)

    def close(self) -> None:
        """Leave the lab."""
        self._client.close()
