"""The sentinel: where test and guard die together, it has the next guard there at once.

It is forked from the guard when a test takes the bench, so that all that a guard needs is loaded: nothing is to be
found, read or imported any more when lasers are on and nobody is left. It has a session of its own, holds neither
lease nor line, and does nothing but wait. Whether anything is to be done says the mark of the session that nobody has
ended, `Places.driven`, and nothing else; whoever makes the bench safe takes it away.

    guard     test              sentinel
    lives     whatever          waits; a guard that no longer renews its lease after the test has died, lives no more
    is gone   lives             leaves it to the test to make safe; looks again when that has ended, or had its time
    is gone   dead or stopped   calls the next guard, again and again, until the mark is gone

The guard in turn replaces a sentinel that died. The lease decides, as always, which of two guards is the guard.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import signal
import threading
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Final, final

from arl_fixtures.bench.guard_settings import GuardSettings
from arl_fixtures.errors import ArlError
from arl_fixtures.guard.bookkeeping import now_utc
from arl_fixtures.guard.runtime import Places, append_log, lease_holder, process_state

RETRY_FOR_S: Final = 300.0
"""For how long guards are called again where the one before did not make the bench safe, besides their own time."""
_OWN_TIME_S: Final = 10.0
"""What a living test has, beyond `heartbeat_timeout_s` to notice the death of its guard, to make the bench safe."""
_LOOK_S: Final = 0.5
_SHORTEST_PAUSE_S: Final = 0.02
_LONGEST_PAUSE_S: Final = 1.0


@final
class Sentinel:
    """The guard's side: post it, see that it stands, dismiss it.

    Args:
        places: files of the bench's guard.
        settings: its times.
        call_guard: runs the next guard and returns when that has ended; called in a process of its own.
    """

    def __init__(self, places: Places, settings: GuardSettings, call_guard: Callable[[], None]) -> None:
        self._places, self._settings, self._call_guard = places, settings, call_guard
        self._test, self._test_fd = 0, -1
        self.pid = 0
        """Its process number; 0 while none stands."""
        self._pid_fd = self._life_line = -1
        self._posted_s = float("-inf")

    def begin(self, test: int) -> None:
        """Post it for a session; the mark of the session must lie there."""
        self.end()
        try:
            self._test_fd = os.pidfd_open(test)
        except ProcessLookupError:
            # it has died already
            self._test_fd = -1
        except OSError as error:
            self._note("no sentinel", fault=str(error.strerror))
            return
        self._test = test
        self._post()

    def tend(self, *, needed: bool) -> None:
        """Replace it if it has died; dismiss it if the bench is safe."""
        if not needed:
            self.end()
        elif self._test and not self._stands() and time.monotonic() >= self._posted_s + _LOOK_S:
            self._dismiss()
            self._post()

    def end(self) -> None:
        """It sees that nobody holds its life line any more, and goes if no mark lies there."""
        self._dismiss()
        if self._test_fd >= 0:
            os.close(self._test_fd)
        self._test, self._test_fd = 0, -1

    def _post(self) -> None:
        self._posted_s = time.monotonic()
        reader, writer = os.pipe()
        try:
            pid = _fork(lambda: self._watch(reader).stand(), keep={reader, self._test_fd})
            self._pid_fd = os.pidfd_open(pid)
        except OSError as error:
            os.close(writer)
            self._note("no sentinel", fault=str(error.strerror))
            return
        finally:
            os.close(reader)
        self.pid, self._life_line = pid, writer
        self._note("sentinel", pid=pid)

    def _watch(self, life_line: int) -> Watch:
        return Watch(self._places, self._settings, self._call_guard, self._test, self._test_fd, life_line)

    def _stands(self) -> bool:
        return self.pid != 0 and not _ready([self._pid_fd], 0.0)

    def _dismiss(self) -> None:
        if not self.pid:
            return
        os.close(self._life_line)
        if not self._places.driven.exists():
            _ready([self._pid_fd], _LONGEST_PAUSE_S)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self.pid, os.WNOHANG)
        os.close(self._pid_fd)
        self.pid = 0

    def _note(self, what: str, **detail: Any) -> None:  # noqa: ANN401 - details are the entry's own
        _note(self._places, what, **detail)


@final
class Watch:
    """What the sentinel does.

    Args:
        places: files of the bench's guard.
        settings: its times.
        call_guard: runs the next guard and returns when that has ended.
        test: process number of the test.
        test_fd: readable when that is dead, whoever bears its number then; −1: it was dead from the beginning.
        life_line: readable when the guard is gone, or has dismissed the sentinel.
    """

    def __init__(
        self,
        places: Places,
        settings: GuardSettings,
        call_guard: Callable[[], None],
        test: int,
        test_fd: int,
        life_line: int,
    ) -> None:
        self._places, self._settings, self._call_guard = places, settings, call_guard
        self._test, self._test_fd, self._life_line = test, test_fd, life_line
        self._mark = b""
        self._mark = self._read_mark()

    def stand(self) -> None:
        """Wait until nobody drives the bench any more, whoever has ended it."""
        while not _ready([self._life_line], _LOOK_S):
            if not self._test_lives() and self.marked and not self._guard_renews():
                break
        leave_it_until_s = time.monotonic() + self._settings.heartbeat_timeout_s + _OWN_TIME_S
        while self.marked and self._test_lives() and time.monotonic() < leave_it_until_s:
            _ready([self._test_fd], _LOOK_S)
        self._call_until_safe()

    @property
    def marked(self) -> bool:
        """Whether nobody has ended the session that this is about."""
        return bool(self._mark) and self._read_mark() == self._mark

    def _call_until_safe(self) -> None:
        left_s, pause_s = RETRY_FOR_S, _SHORTEST_PAUSE_S
        while self.marked and left_s > 0.0:
            if not self._guard_renews():
                _note(self._places, "nobody is left: the next guard is called")
                self._run_guard()
                left_s -= pause_s
            threading.Event().wait(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)

    def _run_guard(self) -> None:
        """In a process of its own: should it die, too, there is one who calls another."""
        pid = _fork(self._come)
        pid_fd = os.pidfd_open(pid)
        try:
            while not _ready([pid_fd], _LOOK_S):
                if not self.marked:
                    return
            os.waitpid(pid, 0)
        finally:
            os.close(pid_fd)

    def _come(self) -> None:
        try:
            self._call_guard()
        except ArlError as error:
            _note(self._places, "the guard that was called did not start", fault=" ".join(str(error).split()))

    def _test_lives(self) -> bool:
        if self._test_fd < 0 or _ready([self._test_fd], 0.0):
            return False
        return not (self._settings.watch_stopped and process_state(self._test) in {"T", "t"})

    def _guard_renews(self) -> bool:
        return lease_holder(self._places.lease, lease_s=self._settings.lease_s) != 0

    def _read_mark(self) -> bytes:
        try:
            return self._places.driven.read_bytes()
        except FileNotFoundError:
            return b""
        except OSError:
            # a disk that fails is no reason to leave
            return self._mark


def _note(places: Places, what: str, **detail: Any) -> None:  # noqa: ANN401 - details are the entry's own
    append_log(places, [{"utc": now_utc(), "what": what, **detail}])


def _fork(work: Callable[[], None], *, keep: Collection[int] = ()) -> int:
    """Do `work` in a process of its own that shares nothing with this one but `keep`; returns its number."""
    pid = os.fork()
    if pid:
        return pid
    status = 70
    try:
        _leave_behind(keep)
        work()
        status = 0
    finally:
        # nothing of the process that this was a copy of is to be tidied up here
        os._exit(status)


def _leave_behind(keep: Collection[int]) -> None:
    """Neither terminal nor signal of the process it was may reach this one, and it holds on to nothing of it."""
    os.setsid()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    # objects of that process must not close what is opened here under their numbers
    gc.freeze()
    null = os.open(os.devnull, os.O_RDWR)
    for standard in range(3):
        os.dup2(null, standard)
    for entry in list(Path("/proc/self/fd").iterdir()):
        descriptor = int(entry.name)
        if descriptor > 2 and descriptor not in keep:
            # the listing's own is closed already
            with contextlib.suppress(OSError):
                os.close(descriptor)


def _ready(descriptors: Collection[int], timeout_s: float) -> bool:
    """Whether one of them can be read, or is at its end, within `timeout_s`."""
    return bool(select.select(list(descriptors), [], [], timeout_s)[0])
