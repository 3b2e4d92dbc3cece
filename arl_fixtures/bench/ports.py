"""Real ports: serial lines, TCP connections and UDP sockets of the bench's host."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable
from typing import Final, final
from urllib.parse import parse_qsl, urlsplit

import serial

from arl_fixtures.devices.port import Clock, Datagram
from arl_fixtures.errors import ConfigError, DeviceLostError

CONNECT_TIMEOUT_S: Final = 3.0
WRITE_TIMEOUT_S: Final = 2.0
RECEIVE_BUFFER_BYTES: Final = 16_000_000
"""What the vendor's own UDP node asks for; the kernel grants at most its `net.core.rmem_max`."""
SO_TIMESTAMPNS: Final = 35
"""Linux: the kernel says when each datagram arrived (socket(7)); Python has no name for it."""
AT_ONCE_S: Final = 1e-3
"""Two clocks that are read in a shorter time than this are read at the same time."""
LONGEST_UNREAD_S: Final = 60.0
"""A datagram that seems to have waited longer tells of a wall clock that was set."""


@final
class SerialPort:
    """A serial line.

    Args:
        name: URL as written, for messages.
        device: path of the line.
        baud: bits per second; 8 data bits, no parity, 1 stop bit.
    """

    def __init__(self, name: str, device: str, *, baud: int) -> None:
        self.name = name
        self._device, self._baud = device, baud
        self._line = self._connect()

    def _connect(self) -> serial.Serial:
        try:
            return serial.Serial(self._device, self._baud, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
        except (OSError, ValueError) as error:
            raise DeviceLostError(f"{self.name}: cannot open the serial line: {_why(error)}") from None

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        try:
            self._line.write(data)
        except OSError as error:
            raise DeviceLostError(f"{self.name}: cannot write: {_why(error)}") from None

    def read(self, timeout_s: float) -> bytes:
        """At least one byte, or nothing at time-out."""
        try:
            self._line.timeout = max(timeout_s, 0.0)
            first = self._line.read(1)
            return bytes(first + self._line.read(self._line.in_waiting)) if first else b""
        except OSError as error:
            raise DeviceLostError(f"{self.name}: the line is gone: {_why(error)}") from None

    def drain(self) -> bytes:
        """Take what lies unread."""
        try:
            return bytes(self._line.read(self._line.in_waiting))
        except OSError as error:
            raise DeviceLostError(f"{self.name}: the line is gone: {_why(error)}") from None

    def reopen(self) -> None:
        """Close and open the line."""
        self.close()
        self._line = self._connect()

    def close(self) -> None:
        """Release the line."""
        with contextlib.suppress(OSError):
            self._line.close()


@final
class TcpPort:
    """A TCP connection.

    Args:
        name: URL as written, for messages.
        host: name or address.
        port: TCP port.
    """

    def __init__(self, name: str, host: str, port: int) -> None:
        self.name = name
        self._address = (host, port)
        self._socket = self._connect()

    def _connect(self) -> socket.socket:
        try:
            connection = socket.create_connection(self._address, timeout=CONNECT_TIMEOUT_S)
        except OSError as error:
            raise DeviceLostError(f"{self.name}: cannot connect: {_why(error)}") from None
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        try:
            self._socket.settimeout(WRITE_TIMEOUT_S)
            self._socket.sendall(data)
        except OSError as error:
            raise DeviceLostError(f"{self.name}: cannot write: {_why(error)}") from None

    def read(self, timeout_s: float) -> bytes:
        """At least one byte, or nothing at time-out."""
        try:
            # zero means not to wait at all: a real time-out is at least a millisecond, as long as some answers take
            self._socket.settimeout(max(timeout_s, 0.0))
            data = self._socket.recv(65536)
        except (TimeoutError, BlockingIOError):
            return b""
        except OSError as error:
            raise DeviceLostError(f"{self.name}: the connection is gone: {_why(error)}") from None
        if not data:
            raise DeviceLostError(f"{self.name}: the device closed the connection")
        return data

    def drain(self) -> bytes:
        """Take what lies unread."""
        taken = bytearray()
        while chunk := self.read(0.0):
            taken += chunk
        return bytes(taken)

    def reopen(self) -> None:
        """Close and connect again."""
        self.close()
        self._socket = self._connect()

    def close(self) -> None:
        """Release the connection."""
        self._socket.close()


@final
class UdpPort:
    """A UDP socket with a thread that empties the kernel's buffer all the time.

    A busy test process must not lose packets that the kernel has received, and the kernel keeps only some tens
    of milliseconds of three sensors; the thread keeps `kept_datagrams` more. A datagram's time is that of its arrival
    in the kernel where this tells it (Linux): one that was read late is not late.

    Args:
        name: URL as written, for messages.
        host: local address to bind.
        port: UDP port.
        clock: bench clock for arrival times.
        kept_datagrams: unread datagrams kept; beyond these the oldest are dropped and counted.
    """

    def __init__(self, name: str, host: str, port: int, clock: Clock, *, kept_datagrams: int = 100_000) -> None:
        self.name = name
        self._clock, self._kept = clock, kept_datagrams
        self.overrun = 0
        self._queue: deque[Datagram] = deque()
        self._arrived = threading.Condition()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        with contextlib.suppress(OSError, AttributeError):
            # beyond rmem_max, where the process may (CAP_NET_ADMIN)
            self._socket.setsockopt(socket.SOL_SOCKET, 33, RECEIVE_BUFFER_BYTES)
        if sys.platform == "linux":
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise DeviceLostError(f"{self.name}: cannot listen on {host}:{port}: {_why(error)}") from None
        self._socket.settimeout(0.2)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._empty_socket, name=f"udp {port}", daemon=True)
        self._thread.start()

    @property
    def bound_port(self) -> int:
        """The UDP port in use (of interest where 0 was asked for)."""
        return int(self._socket.getsockname()[1])

    def _empty_socket(self) -> None:
        while not self._stop.is_set():
            try:
                payload, about, _, sender = self._socket.recvmsg(65536, 256)
            except TimeoutError:
                continue
            except OSError:
                return
            datagram = Datagram(payload, sender[0], self._arrival_s(about))
            with self._arrived:
                self._queue.append(datagram)
                if len(self._queue) > self._kept:
                    self._queue.popleft()
                    self.overrun += 1
                self._arrived.notify()

    def _arrival_s(self, about: Iterable[tuple[int, int, bytes]]) -> float:
        """When a datagram arrived, by the bench clock; `about` came with it."""
        now_s = self._clock.now_s
        for _ in range(10):
            arrival_s, before_s = now_s - _waited_s(about), now_s
            now_s = self._clock.now_s
            if now_s - before_s < AT_ONCE_S:
                break
            # held up between the clocks: the datagram seems to have come as much earlier
        return arrival_s

    def receive(self, timeout_s: float) -> list[Datagram]:
        """All datagrams that have arrived."""
        deadline_s = time.monotonic() + max(timeout_s, 0.0)
        with self._arrived:
            while not self._queue:
                if self._stop.is_set():
                    raise DeviceLostError(f"{self.name}: the socket is closed")
                remaining_s = deadline_s - time.monotonic()
                if remaining_s <= 0 or not self._arrived.wait(remaining_s):
                    break
            taken = list(self._queue)
            self._queue.clear()
        return taken

    def discard(self, before_s: float = float("inf")) -> int:
        """Forget what lies unread and arrived before `before_s`."""
        lost = 0
        with self._arrived:
            while self._queue and self._queue[0].time_s < before_s:
                self._queue.popleft()
                lost += 1
        return lost

    def close(self) -> None:
        """Stop the thread and release the socket."""
        self._stop.set()
        self._thread.join(timeout=2.0)
        self._socket.close()


def open_stream(url: str, *, default_baud: int = 9600) -> SerialPort | TcpPort:
    """Open `serial:///dev/ttyUSB0?baud=9600`, `tcp://host:port` or `socket://host:port`.

    Raises:
        ConfigError: the URL is of no such form.
        DeviceLostError: the line cannot be opened.
    """
    parts = urlsplit(url)
    options = dict(parse_qsl(parts.query))
    if parts.scheme == "serial":
        baud = options.pop("baud", str(default_baud))
        if options or not baud.isdigit() or not parts.path:
            raise ConfigError(f"'{url}': expected serial:///dev/NAME?baud=NUMBER")
        return SerialPort(url, parts.path, baud=int(baud))
    if parts.scheme in {"tcp", "socket"}:
        host, port = host_and_port(url)
        return TcpPort(url, host, port)
    raise ConfigError(f"'{url}': expected serial://, tcp://, socket:// or 'emulated'")


def host_and_port(url: str) -> tuple[str, int]:
    """Host and port of a `scheme://host:port` URL.

    Raises:
        ConfigError: one of them is missing.
    """
    parts = urlsplit(url)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or port is None:
        raise ConfigError(f"'{url}': expected {parts.scheme or 'tcp'}://HOST:PORT")
    return host, port


def _waited_s(about: Iterable[tuple[int, int, bytes]]) -> float:
    """How long a datagram lay in the kernel, from what came with it; 0 where the kernel says nothing."""
    for level, kind, data in about:
        if (level, kind) == (socket.SOL_SOCKET, SO_TIMESTAMPNS) and len(data) == struct.calcsize("@qq"):
            seconds, nanoseconds = struct.unpack("@qq", data)
            waited_s = (time.time_ns() - seconds * 1_000_000_000 - nanoseconds) * 1e-9
            return waited_s if 0.0 <= waited_s < LONGEST_UNREAD_S else 0.0
    return 0.0


def _why(error: Exception) -> str:
    return getattr(error, "strerror", None) or " ".join(str(error).split())
