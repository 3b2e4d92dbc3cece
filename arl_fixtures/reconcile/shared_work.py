"""Independent pieces of one search on all cores: each in whichever process is free, with the result that one gives.

The processes are forked where the work begins, so that they hold the table and all that was worked out of it without
a copy; what they find comes back as references to what both sides hold, and as numbers. Where nothing can be forked
(another system, a program with threads of its own) the work is done here, and so is what a process failed to do.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from arl_fixtures.reconcile.told_results import told_as, told_from

Item = TypeVar("Item")
Result = TypeVar("Result")

MOST_PROCESSES = 4
"""Beyond these the longest single piece takes the time, and each of them may fill memory of its own."""
_PROCESSES: ContextVar[int] = ContextVar("processes", default=1)


def cores() -> int:
    """Processes to work in: as many as there are cores; 1 where threads run already, which a fork would break."""
    if sys.platform != "linux" or threading.active_count() > 1:
        return 1
    return min(len(os.sched_getaffinity(0)), MOST_PROCESSES)


@contextmanager
def processes(count: int) -> Iterator[None]:
    """Work that may be shared is, among so many processes."""
    token = _PROCESSES.set(count)
    try:
        yield
    finally:
        _PROCESSES.reset(token)


def each(work: Callable[[Item], Result], items: Sequence[Item], known: Iterable[object] = ()) -> list[Result]:
    """What `work` makes of every item, in order.

    Args:
        work: must not depend on what it did before, but for what it keeps to be faster.
        items: longest work first.
        known: objects that results may hold and that are to stay the same ones, not copies of these.
    """
    count = min(_PROCESSES.get(), len(items))
    if count < 2:
        return [work(item) for item in items]
    held = {id(one): one for one in known}
    context = multiprocessing.get_context("fork")
    turn = context.Value("l", 0)

    def taken() -> Iterator[int]:
        while True:
            with turn.get_lock():
                index, turn.value = turn.value, turn.value + 1
            if index >= len(items):
                return
            yield index

    def beside(to: Connection) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever asked stops this process
        _PROCESSES.set(1)
        found = []
        with suppress(Exception):  # who asked meets it at the same item, and tells
            for index in taken():
                found.append((index, work(items[index])))
        with suppress(Exception):
            to.send_bytes(told_as(found, held))

    others = []
    results: dict[int, Result] = {}
    try:
        for _ in range(count - 1):
            here, there = context.Pipe(duplex=False)
            other = context.Process(target=beside, args=(there,), daemon=True)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of threads that hold nothing of ours
                other.start()
            there.close()
            others.append((other, here))
        for index in taken():
            results[index] = work(items[index])
        for _, here in others:
            results |= _received(here, held)
    finally:
        for other, here in others:
            other.kill()
            other.join()
            here.close()
    return [results[index] if index in results else work(item) for index, item in enumerate(items)]


def _received(here: Connection, held: dict[int, object]) -> dict[int, Any]:
    """What a process found; nothing where it died."""
    with suppress(EOFError, OSError):
        return dict(told_from(here.recv_bytes(), held))
    return {}
