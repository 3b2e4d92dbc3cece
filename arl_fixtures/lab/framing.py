"""Messages on a Unix socket: a JSON object and raw bytes, each frame with its lengths in front.

    length of all that follows (u32) | length of the JSON (u32) | JSON object, UTF-8 | payload

Nothing else is ever read from such a socket: no pickle, nothing that constructs objects.
"""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, final

from arl_fixtures.errors import ArlError, RemoteProtocolError

_LENGTHS: Final = struct.Struct(">II")
_LARGEST_FRAME: Final = 1 << 28
_CHUNK: Final = 1 << 18


class PeerLostError(ArlError):
    """The process at the other end is gone or does not answer. Callers turn this into an error of their own."""


class Message(NamedTuple):
    """A JSON object and bytes."""

    header: dict[str, Any]
    payload: bytes = b""


def encode(header: Mapping[str, Any], payload: bytes = b"") -> bytes:
    """One frame."""
    text = json.dumps(header, separators=(",", ":")).encode()
    return _LENGTHS.pack(4 + len(text) + len(payload), len(text)) + text + payload


@final
class FrameBuffer:
    """Bytes as they come, to messages."""

    def __init__(self) -> None:
        self._data = bytearray()

    def push(self, data: bytes) -> list[Message]:
        """Add bytes and take every complete message.

        Raises:
            RemoteProtocolError: what came is no frame.
        """
        self._data += data
        messages = []
        while len(self._data) >= _LENGTHS.size:
            total, text_bytes = _LENGTHS.unpack_from(self._data)
            if total > _LARGEST_FRAME or text_bytes + 4 > total:
                raise RemoteProtocolError(f"frame of {total} bytes with {text_bytes} bytes of JSON")
            end = 4 + total
            if len(self._data) < end:
                break
            text = bytes(self._data[_LENGTHS.size : _LENGTHS.size + text_bytes])
            payload = bytes(self._data[_LENGTHS.size + text_bytes : end])
            del self._data[:end]
            messages.append(Message(_object(text), payload))
        return messages


def _object(text: bytes) -> dict[str, Any]:
    try:
        header = json.loads(text)
    except ValueError:
        header = None
    if not isinstance(header, dict):
        raise RemoteProtocolError(f"expected a JSON object, got {text[:60]!r}")
    return header


@final
class Peer:
    """Server side of a connection: never blocks, however slow the other end is.

    Args:
        connection: an accepted socket.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._socket = connection
        self._incoming = FrameBuffer()
        self._outgoing = bytearray()

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    @property
    def pid(self) -> int:
        """Process at the other end, by the kernel's word."""
        credentials = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
        return int(struct.unpack("3i", credentials)[0])

    @property
    def unsent(self) -> bool:
        """Whether bytes wait for the other end to read."""
        return bool(self._outgoing)

    def receive(self) -> list[Message]:
        """What has arrived.

        Raises:
            PeerLostError: the other end closed, died, or sends nonsense.
        """
        try:
            data = self._socket.recv(_CHUNK)
        except BlockingIOError:
            return []
        except OSError as error:
            raise PeerLostError(f"connection lost: {error.strerror}") from None
        if not data:
            raise PeerLostError("connection closed")
        try:
            return self._incoming.push(data)
        except RemoteProtocolError as error:
            raise PeerLostError(str(error)) from None

    def send(self, header: Mapping[str, Any], payload: bytes = b"") -> None:
        """Queue a message and send what the kernel takes now."""
        self._outgoing += encode(header, payload)
        self.flush()

    def flush(self) -> None:
        """Send what the kernel takes; a lost connection is noticed by `receive`."""
        while self._outgoing:
            try:
                sent = self._socket.send(self._outgoing)
            except BlockingIOError:
                return
            except OSError:
                self._outgoing.clear()
                return
            del self._outgoing[:sent]

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


@final
class Link:
    """Client side of a connection: blocks, within stated times on the wall clock.

    Args:
        connection: a connected socket.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._socket = connection
        self._incoming = FrameBuffer()
        self._unread: list[Message] = []
        self._number = 0

    @classmethod
    def connect(cls, path: Path) -> Self:
        """Connect to a Unix socket.

        Raises:
            PeerLostError: nobody listens there.
        """
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.connect(str(path))
        except OSError as error:
            connection.close()
            raise PeerLostError(f"{path}: {error.strerror or error}") from None
        return cls(connection)

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    def send(self, header: Mapping[str, Any], payload: bytes = b"", *, timeout_s: float = 10.0) -> None:
        """Send a message.

        Raises:
            PeerLostError: the other end is gone, or took nothing for `timeout_s`.
        """
        data = memoryview(encode(header, payload))
        while data:
            try:
                data = data[self._socket.send(data) :]
            except BlockingIOError:
                if not select.select([], [self._socket], [], timeout_s)[1]:
                    raise PeerLostError(f"takes no message for {timeout_s:g} s") from None
            except OSError as error:
                raise PeerLostError(f"connection lost: {error.strerror or error}") from None

    def take(self, timeout_s: float | None) -> Message | None:
        """The next message; None when none came in `timeout_s` (None: wait for ever).

        Raises:
            PeerLostError: the other end is gone, or sends nonsense.
        """
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        while not self._unread:
            try:
                data = self._socket.recv(_CHUNK)
            except BlockingIOError:
                left_s = None if deadline_s is None else deadline_s - time.monotonic()
                if left_s is not None and left_s <= 0.0:
                    return None
                select.select([self._socket], [], [], left_s)
                continue
            except OSError as error:
                raise PeerLostError(f"connection lost: {error.strerror or error}") from None
            if not data:
                raise PeerLostError("connection closed")
            try:
                self._unread += self._incoming.push(data)
            except RemoteProtocolError as error:
                raise PeerLostError(str(error)) from None
        return self._unread.pop(0)

    def post(self, header: Mapping[str, Any], payload: bytes = b"") -> None:
        """Send a request; its answer is what `answer` gives, and no other.

        Raises:
            PeerLostError: the other end is gone.
        """
        self._number += 1
        self.send({**header, "n": self._number}, payload)

    def answer(self, timeout_s: float | None = None) -> Message | None:
        """The answer to the last request; None when it did not come in `timeout_s`.

        Answers to earlier ones, from whose waiting this process was torn by an exception, are passed over.

        Raises:
            PeerLostError: the other end is gone.
        """
        while (message := self.take(timeout_s)) is not None:
            if message.header.get("n") == self._number:
                return message
        return None

    def ask(self, header: Mapping[str, Any], payload: bytes = b"", *, timeout_s: float | None = None) -> Message:
        """Send a request and wait for its answer.

        Raises:
            PeerLostError: the other end is gone, or did not answer within `timeout_s`.
        """
        self.post(header, payload)
        answer = self.answer(timeout_s)
        if answer is None:
            raise PeerLostError(f"no answer to '{header.get('op')}' for {timeout_s:g} s")
        return answer

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def listen(path: Path) -> socket.socket:
    """A Unix socket that only this user can connect to; a socket file left by a dead process is replaced.

    Raises:
        ArlError: somebody listens there already, or the path cannot be used.
    """
    if path.is_socket():
        try:
            Link.connect(path).close()
        except PeerLostError:
            path.unlink(missing_ok=True)
        else:
            raise ArlError(f"{path}: somebody listens there already")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listener.bind(str(path))
        path.chmod(0o600)
        listener.listen(8)
    except OSError as error:
        listener.close()
        raise ArlError(f"{path}: cannot listen: {error.strerror or error}") from None
    listener.setblocking(False)
    return listener
