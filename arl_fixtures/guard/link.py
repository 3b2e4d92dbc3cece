"""The test's side of the guard: ports that reach the devices through it, and what happens when it is gone."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, final

from arl_fixtures.bench.drivers import Kind
from arl_fixtures.bench.guard_settings import Action
from arl_fixtures.devices.port import Clock, StreamPort
from arl_fixtures.errors import ArlError, DeviceLostError, InterlockError
from arl_fixtures.guard.core import Request
from arl_fixtures.guard.runtime import NoGuardError, process_state, started
from arl_fixtures.lab.client import ERRORS, LabClock, Unsent
from arl_fixtures.lab.framing import Link, Message, PeerLostError

_SAFE_STATE_S: Final = 5.0
"""It may be busy making the bench safe after the last test when this one comes."""
_BURIAL_S: Final = 30.0
_TAKEOVER_TRIES: Final = 100
"""After the guard is dead, or should be at last."""
_TAKEOVER_PAUSE_S: Final = 0.02


@final
class GuardLink:
    """A connection to the guard.

    Args:
        link: to its socket.
        pid: process number of the guard; killed when it no longer answers, for its lines must become free.
        sha256: of the bench file, which must be the guard's.
        clock: the bench clock.
        lab: number of this process in the lab; 0 with real hardware.
        patience_s: wall time after which a guard that does not answer counts as dead.

    Raises:
        NoGuardError: it ended before it answered.
        InterlockError: it refuses; the message says what stopped the bench, or who drives it.
        ConfigError: it runs with another version of the bench file.
    """

    def __init__(self, link: Link, pid: int, *, sha256: str, clock: Clock, lab: int, patience_s: float) -> None:
        self._link, self.pid, self._clock = link, pid, clock
        self._patience_s, self._started = patience_s, started(pid)
        self.lost = ""
        self.unsent: Unsent | None = None
        self._announced = False
        self.request: Request | None = None
        self.cause = ""
        self.actions: list[tuple[str, str]] = []
        self.driven = True
        hello = {"op": "hello", "sha256": sha256, "lab": lab}
        try:
            answer = self._link.ask(hello, timeout_s=patience_s + _SAFE_STATE_S)
        except PeerLostError as error:
            raise NoGuardError(f"the guard (process {pid}) does not answer: {error}") from None
        self.last_stop = answer.header.get("stop")
        self._understood(answer)

    def ask(self, op: str, payload: bytes = b"", *, wait_s: float = 0.0, **header: Any) -> Message:  # noqa: ANN401 - JSON
        """Have the guard do something.

        Args:
            op, header, payload: the request.
            wait_s: bench time that it may take by itself.

        Raises:
            InterlockError: the guard has made the bench safe, or is gone.
            DeviceError: what the line says.
        """
        self.flush()
        self.announce()
        if self.lost:
            raise InterlockError(self.lost)
        try:
            answer = self._link.ask({"op": op, **header}, payload, timeout_s=self._patience_s + wait_s)
        except PeerLostError as error:
            self._mourn(str(error))
            self._announced = True
            raise InterlockError(self.lost) from None
        return self._understood(answer)

    def tell(self, op: str, **header: Any) -> None:  # noqa: ANN401 - JSON
        """Say something that has no answer.

        Raises:
            InterlockError: the guard is gone, and that has not been said before.
        """
        self.flush()
        self.announce()
        if self.lost:
            return
        try:
            self._link.send({"op": op, **header})
        except PeerLostError as error:
            self._mourn(str(error))
        self.announce()

    def flush(self) -> None:
        """Send what is to be written before anything else happens."""
        if (unsent := self.unsent) is not None:
            self.unsent = None
            self.ask("write", unsent.data, line=unsent.line, drain=unsent.drain)

    def announce(self) -> None:
        """The first to meet the loss of the guard ends the session by it; whoever comes then, makes safe.

        Raises:
            InterlockError: the guard is gone, and that has not been said before.
        """
        if self.lost and not self._announced:
            self._announced = True
            raise InterlockError(self.lost)

    def check(self) -> None:
        """Hear whether the guard is still there.

        Raises:
            InterlockError: it is gone.
        """
        if not self.lost:
            try:
                self._link.take(0.0)
            except PeerLostError as error:
                self._mourn(str(error))
        if self.lost:
            self._announced = True
            raise InterlockError(self.lost)

    @property
    def buried(self) -> bool:
        """Whether nothing is left of the guard's process that could hold a line."""
        return started(self.pid) != self._started or process_state(self.pid) in {"Z", "X"}

    def close(self) -> None:
        """Hang up."""
        self._link.close()

    def _understood(self, answer: Message) -> Message:
        header = answer.header
        if isinstance(self._clock, LabClock):
            self._clock.note(float(header["now_s"]))
        request = header.get("request")
        self.request = None if request is None else Request(Action(request[0]), str(request[1]))
        self.cause, self.driven = str(header.get("cause", "")), header.get("state") in {"armed", "holding"}
        self.actions = [(str(step), str(fault)) for step, fault in header.get("actions", ())]
        if "error" in header:
            raise ERRORS.get(header["error"], InterlockError)(str(header["message"]))
        return answer

    def _mourn(self, why: str) -> None:
        """The guard is dead, or as good as: make sure of it, so that its lines are free."""
        self.unsent = None
        self.lost = f"the guard (process {self.pid}) is gone: {why}"
        self._link.close()
        if started(self.pid) == self._started:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(self.pid, signal.SIGKILL)


@final
class GuardedPort:
    """A control line, through the guard; by itself once the guard is lost.

    Args:
        kind: role of the device.
        name: the URL, for messages.
        link: to the guard.
        open_line: opens the line itself.
    """

    def __init__(self, kind: Kind, name: str, link: GuardLink, open_line: Callable[[], StreamPort]) -> None:
        self.name = name
        self._kind, self._link, self._open_line = kind, link, open_line
        self._direct: StreamPort | None = None
        self._drain = False

    def write(self, data: bytes) -> None:
        """Send all of `data`, together with the next request; that the line is gone is said by that one."""
        if (direct := self._line()) is not None:
            direct.write(data)
            return
        self._link.flush()
        self._link.unsent = Unsent(self._kind, data, self._take_drain())

    def read(self, timeout_s: float) -> bytes:
        """What has arrived, or nothing at time-out."""
        if (direct := self._line()) is not None:
            return direct.read(timeout_s)
        payload, drain, unsent = b"", self._take_drain(), self._link.unsent
        if unsent is not None and unsent.line == self._kind:
            payload, drain, self._link.unsent = unsent.data, unsent.drain, None
        return self._ask("read", payload, drain=drain, timeout_s=timeout_s, wait_s=timeout_s).payload

    def drain(self) -> bytes:
        """Forget what lies unread before the next request; says nothing about it, which saves an exchange."""
        if (direct := self._line()) is not None:
            return direct.drain()
        self._drain = True
        return b""

    def reopen(self) -> None:
        """Close and open the line again."""
        if (direct := self._line()) is not None:
            direct.reopen()
        else:
            self._ask("reopen")

    def close(self) -> None:
        """Done with the line, which stays with the guard."""
        if self._direct is not None:
            self._direct.close()
            self._direct = None

    def _ask(self, op: str, payload: bytes = b"", **header: Any) -> Message:  # noqa: ANN401 - JSON
        return self._link.ask(op, payload, line=self._kind, **header)

    def _take_drain(self) -> bool:
        drain, self._drain = self._drain, False
        return drain

    def _line(self) -> StreamPort | None:
        """The line itself, if the guard is lost."""
        self._link.announce()
        if not self._link.lost:
            return None
        if self._direct is None:
            self._direct = self._take_over()
        return self._direct

    def _take_over(self) -> StreamPort:
        """Open the line; the kernel may take a moment to bury the guard and free it, on a busy machine a long one."""
        deadline_s, left = time.monotonic() + _BURIAL_S, _TAKEOVER_TRIES
        while left > 1:
            try:
                return self._open_line()
            except DeviceLostError:
                if self._link.buried or time.monotonic() > deadline_s:
                    left -= 1
                threading.Event().wait(_TAKEOVER_PAUSE_S)
        return self._open_line()


@final
class BeatingClock:
    """The bench clock of a guarded test: long sleeps give signs of life.

    Args:
        clock: the bench clock.
        link: to the guard.
        beat_s: longest sleep without a sign of life.
    """

    def __init__(self, clock: Clock, link: GuardLink, beat_s: float) -> None:
        self._clock, self._link, self._beat_s = clock, link, beat_s

    @property
    def now_s(self) -> float:
        """Seconds on the bench clock."""
        return self._clock.now_s

    def utc_ns(self) -> int:
        """Bench UTC."""
        return self._clock.utc_ns()

    def sleep(self, duration_s: float) -> None:
        """Let bench time pass."""
        end_s = self._clock.now_s + duration_s
        while (left_s := end_s - self._clock.now_s) > 0.0:
            self._link.tell("beat")
            self._clock.sleep(min(left_s, self._beat_s))


def connect_guard(
    socket: Path, pid: int, *, sha256: str, clock: Clock, lab: int, patience_s: float
) -> GuardLink:
    """Connect to the guard that listens at a socket.

    Raises:
        NoGuardError: nobody listens there.
        InterlockError: the guard refuses.
    """
    try:
        link = Link.connect(socket)
    except PeerLostError as error:
        raise NoGuardError(f"no guard: {error}") from None
    try:
        return GuardLink(link, pid, sha256=sha256, clock=clock, lab=lab, patience_s=patience_s)
    except ArlError:
        link.close()
        raise
