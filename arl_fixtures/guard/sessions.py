"""Who is connected to the guard, and what they said. Hearing never blocks, and never touches a device."""

from __future__ import annotations

import select
import socket
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, final

from arl_fixtures.lab.framing import Message, Peer, PeerLostError, listen

NEEDS_TURN: Final = frozenset({"hello", "write", "read", "reopen", "bye", "listen", "ack"})
"""Requests that wait for their turn; everything else is heard at once."""


@dataclass(slots=True, eq=False)
class Session:
    """One connected process.

    Attributes:
        peer: the connection.
        pid: process at the other end, by the kernel's word.
        lab: its number in the lab; 0 with real hardware.
        inbox: requests that wait for their turn.
    """

    peer: Peer
    pid: int
    lab: int = 0
    inbox: deque[Message] = field(default_factory=deque)

    def fileno(self) -> int:
        """For `select`."""
        return self.peer.fileno()


@final
class Sessions:
    """Everybody connected.

    Args:
        path: where to listen.
        on_request: called when a request that waits for its turn has come.
        on_word: called for everything else, with its message.
        on_lost: called when a session has ended by itself.
    """

    def __init__(
        self,
        path: Path,
        *,
        on_request: Callable[[Session], None],
        on_word: Callable[[Session, Message], None],
        on_lost: Callable[[Session], None],
    ) -> None:
        self._path = path
        self._listener: socket.socket = listen(path)
        self._on_request, self._on_word, self._on_lost = on_request, on_word, on_lost
        self.all: list[Session] = []

    def sockets(self) -> list[Any]:
        """Everything that may speak."""
        return [self._listener, *self.all]

    def hear(self) -> None:
        """Take what everybody has said."""
        for speaker in select.select(self.sockets(), [], [], 0.0)[0]:
            if speaker is self._listener:
                self._accept()
            elif speaker in self.all:
                self._hear_one(speaker)

    def end(self, session: Session) -> None:
        """Hang up."""
        if session in self.all:
            self.all.remove(session)
            session.peer.close()

    def close(self) -> None:
        """Hang up on everybody and listen no longer."""
        for session in list(self.all):
            self.end(session)
        self._listener.close()
        self._path.unlink(missing_ok=True)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except BlockingIOError:
            return
        peer = Peer(connection)
        self.all.append(Session(peer, peer.pid))

    def _hear_one(self, session: Session) -> None:
        session.peer.flush()
        try:
            self._dispatch(session, session.peer.receive())
        except (PeerLostError, TypeError, ValueError):
            # who speaks nonsense is as good as gone
            self.end(session)
            self._on_lost(session)

    def _dispatch(self, session: Session, messages: list[Message]) -> None:
        for message in messages:
            if message.header.get("op") in NEEDS_TURN:
                if message.header["op"] == "hello":
                    session.lab = int(message.header.get("lab", 0))
                session.inbox.append(message)
                self._on_request(session)
            else:
                self._on_word(session, message)


@final
class Ear:
    """Hears everybody while the guard waits; `cut` says when waiting must end.

    Args:
        sessions: everybody.
        cut: whether something more urgent is to be done.
    """

    def __init__(self, sessions: Sessions, cut: Callable[[], bool]) -> None:
        self._sessions, self._cut = sessions, cut

    def sockets(self) -> Sequence[Any]:
        """Everything that may speak."""
        return self._sessions.sockets()

    def attend(self) -> bool:
        """Hear; true if the waiting is to be cut short."""
        self._sessions.hear()
        return self._cut()
