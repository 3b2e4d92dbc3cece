"""Emulators in real time: on TCP, on a pty, and sending UDP, so that any client can be pointed at them.

One thread, one selector. Emulators are called from that thread only, so they need no locks and one plant stays
consistent. Everything listens on loopback unless told otherwise.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import os
import selectors
import socket
import threading
import tty
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import TracebackType
from typing import Final, Self, final

from arl_fixtures.bench.clock import RealClock
from arl_fixtures.bench.links import Detachable
from arl_fixtures.devices.port import Clock
from arl_fixtures.emulators.device import DatagramDevice, StreamDevice
from arl_fixtures.errors import DeviceLostError

LOOPBACK: Final = "127.0.0.1"
_LONGEST_WAIT_S: Final = 0.05
_READ_BYTES: Final = 65536


@dataclass(slots=True, eq=False)
class _Line:
    """One open connection to a device: a client's socket, or the pty."""

    device: StreamDevice
    fileno: int
    read: Callable[[], bytes]
    write: Callable[[bytes], object]
    close: Callable[[], None]
    alive: bool = field(default=True)


@final
class EmulatorServer:
    """Runs emulators until stopped.

    Add devices first, then call `run`, or use it as a context manager, which runs it in a thread of its own::

        server = EmulatorServer()
        host, port = server.add_tcp("chiller", ChillerEmulator(plant))
        with server:
            ...

    Args:
        clock: bench clock of the emulators; real time where not given.
        destination: host that DUTs send to.
    """

    def __init__(self, clock: Clock | None = None, *, destination: str = LOOPBACK) -> None:
        self.clock: Clock = clock or RealClock()
        self._destination = destination
        # epoll waits in whole milliseconds, which is longer than a module takes to answer
        self._selector = selectors.SelectSelector()
        self._lines: list[_Line] = []
        self._due: list[tuple[float, int, _Line, bytes]] = []
        self._order = itertools.count()
        self._senders: list[tuple[DatagramDevice, socket.socket]] = []
        self._sent_until_s = self.clock.now_s
        self._listeners: list[socket.socket] = []
        self._descriptors: list[int] = []
        self._waker, self._alarm = socket.socketpair()
        self._alarm.setblocking(False)
        self._selector.register(self._alarm, selectors.EVENT_READ, self._alarmed)
        self._stopping = False
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None

    def add_tcp(self, name: str, device: StreamDevice, *, host: str = LOOPBACK, port: int = 0) -> tuple[str, int]:
        """Offer a device on a TCP port, to any number of clients at once.

        Returns:
            Host and port; the port is a free one where 0 was asked for.

        Raises:
            DeviceLostError: the address is in use or not ours.
        """
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._bind(listener, name, host, port)
        listener.listen()
        listener.setblocking(False)
        self._listeners.append(listener)
        self._selector.register(listener, selectors.EVENT_READ, lambda: self._accept(listener, device))
        bound_host, bound_port = listener.getsockname()[:2]
        return str(bound_host), int(bound_port)

    def add_pty(self, name: str, device: StreamDevice) -> str:
        """Offer a device on a pseudo-terminal, which a client opens like a serial line.

        Returns:
            Path of the terminal.

        Raises:
            DeviceLostError: the system has no terminal left.
        """
        try:
            ours, theirs = os.openpty()
        except OSError as error:
            raise DeviceLostError(f"{name}: no pseudo-terminal: {error.strerror}") from None
        # their end stays open here too: else every client that leaves would hang up the line
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        self._descriptors += [ours, theirs]
        line = _Line(
            device, ours, lambda: os.read(ours, _READ_BYTES), lambda data: os.write(ours, data), lambda: None
        )
        self._selector.register(ours, selectors.EVENT_READ, lambda: self._hear(line))
        self._lines.append(line)
        return os.ttyname(theirs)

    def add_udp(self, name: str, device: DatagramDevice) -> None:
        """Let a device send, from its own address.

        Raises:
            DeviceLostError: its address is not one of this machine.
        """
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._bind(sender, name, device.address, 0)
        sender.setblocking(False)
        self._senders.append((device, sender))

    def run(self) -> None:
        """Serve until `stop`, then release everything."""
        try:
            while not self._stopping:
                for key, _ in self._selector.select(self._wait_s()):
                    key.data()
                self._deliver()
                self._transmit()
                self._cut()
        finally:
            self._release()

    def stop(self) -> None:
        """End `run` soon; may be called from any thread or signal handler."""
        self._stopping = True
        with contextlib.suppress(OSError):
            self._waker.send(b"\0")

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until the thread ends: after `stop`, or because an emulator failed."""
        if self._thread is not None:
            self._thread.join(timeout_s)

    def __enter__(self) -> Self:
        self._thread = threading.Thread(target=self._run_in_thread, name="emulators", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
        if self._thread is not None:
            self._thread.join()
        if self._failure is not None:
            raise self._failure

    def _run_in_thread(self) -> None:
        try:
            self.run()
        except BaseException as error:  # handed to the thread that waits for this one
            self._failure = error

    @staticmethod
    def _bind(endpoint: socket.socket, name: str, host: str, port: int) -> None:
        try:
            endpoint.bind((host, port))
        except OSError as error:
            endpoint.close()
            raise DeviceLostError(f"{name}: cannot use {host}:{port}: {error.strerror}") from None

    # -- one turn of the loop

    def _wait_s(self) -> float:
        now_s = self.clock.now_s
        next_s = now_s + _LONGEST_WAIT_S
        if self._due:
            next_s = min(next_s, self._due[0][0])
        for device, _ in self._senders:
            next_s = min(next_s, device.next_time_s(now_s))
        return max(next_s - now_s, 0.0)

    def _alarmed(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._alarm.recv(64)

    def _accept(self, listener: socket.socket, device: StreamDevice) -> None:
        try:
            client, _ = listener.accept()
        except OSError:
            return
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setblocking(False)
        line = _Line(device, client.fileno(), lambda: client.recv(_READ_BYTES), client.sendall, client.close)
        self._selector.register(client, selectors.EVENT_READ, lambda: self._hear(line, hang_up=True))
        self._lines.append(line)

    def _hear(self, line: _Line, *, hang_up: bool = False) -> None:
        try:
            data = line.read()
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            if hang_up:
                self._drop(line)
            return
        now_s = self.clock.now_s
        if not _connected(line.device, now_s):
            return
        for time_s, answer in line.device.receive(data, now_s):
            heapq.heappush(self._due, (time_s, next(self._order), line, answer))

    def _deliver(self) -> None:
        now_s = self.clock.now_s
        while self._due and self._due[0][0] <= now_s:
            _, _, line, answer = heapq.heappop(self._due)
            if line.alive:
                # a client that does not read, or has gone, loses the answer as on a real line
                with contextlib.suppress(OSError):
                    line.write(answer)

    def _transmit(self) -> None:
        now_s = self.clock.now_s
        for device, sender in self._senders:
            for port, (_, payload) in device.send(self._sent_until_s, now_s):
                # nobody listening is no concern of a sensor
                with contextlib.suppress(OSError):
                    sender.sendto(payload, (self._destination, port))
        self._sent_until_s = now_s

    def _cut(self) -> None:
        """Hang up where a fault cut the line; a pty only goes quiet."""
        now_s = self.clock.now_s
        for line in [line for line in self._lines if line.fileno not in self._descriptors]:
            if not _connected(line.device, now_s):
                self._drop(line)

    def _drop(self, line: _Line) -> None:
        line.alive = False
        self._lines.remove(line)
        self._selector.unregister(line.fileno)
        line.close()
        line.device.disconnect(self.clock.now_s)

    def _release(self) -> None:
        for line in [line for line in self._lines if line.fileno not in self._descriptors]:
            self._drop(line)
        self._selector.close()
        endpoints: Iterable[socket.socket] = (
            *self._listeners,
            *(s for _, s in self._senders),
            self._alarm,
            self._waker,
        )
        for endpoint in endpoints:
            endpoint.close()
        for descriptor in self._descriptors:
            os.close(descriptor)
        self._lines.clear()
        self._descriptors.clear()


def _connected(device: StreamDevice, now_s: float) -> bool:
    return not isinstance(device, Detachable) or device.is_connected(now_s)
