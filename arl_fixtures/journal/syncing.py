"""From the page cache to the disk: at once where somebody must know, soon for all else.

A written line outlives the death of its process; to outlive that of the host it must be flushed, which takes the disk
milliseconds. Whoever measures does not wait for that: a thread flushes, once for all that was written meanwhile.
"""

from __future__ import annotations

import os
import threading
from queue import SimpleQueue
from typing import NamedTuple, final


class End(NamedTuple):
    """Where a journal ends.

    Attributes:
        seq: number of the next line.
        size: of the file, bytes.
        prev: what the next line bears as `prev`.
    """

    seq: int
    size: int
    prev: str


@final
class Syncer:
    """Flushes one file. All methods but the thread's own are for one caller.

    Args:
        descriptor: of the file, open for writing; whoever opened it closes it, after `close`.
        end: how far it is on the disk already.
    """

    def __init__(self, descriptor: int, end: End) -> None:
        self._descriptor = descriptor
        self._written = self._synced = end
        self._flushing = threading.Lock()
        # no Event: the exception of a signal may leave it with its lock held, and whoever sets it next waits forever
        self._wanted: SimpleQueue[None] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._failure: OSError | None = None
        self._closing = False

    def soon(self, end: End) -> None:
        """All up to `end` was written; have it flushed, and do not wait."""
        self._written = end
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
            self._thread.start()
        self._wanted.put(None)

    def now(self, end: End) -> None:
        """All up to `end` was written; return when it is on the disk.

        Raises:
            OSError: it is not.
        """
        self._written = end
        with self._flushing:
            self.check()
            self._flush()

    def check(self) -> None:
        """Has all gone well so far?

        Raises:
            OSError: a flush that nobody waited for has failed.
        """
        if self._failure is not None:
            raise self._failure

    def give_up(self) -> End:
        """After a failure: forget what is not on the disk; returns how far it is."""
        with self._flushing:
            self._written, self._failure = self._synced, None
            return self._synced

    def close(self) -> None:
        """End the thread; what it has not flushed by then is not flushed."""
        if self._thread is not None:
            self._closing = True
            self._wanted.put(None)
            self._thread.join()
            self._thread = None

    def _flush(self) -> None:
        end = self._written
        if end.size > self._synced.size:
            os.fdatasync(self._descriptor)
            self._synced = end

    def _run(self) -> None:
        while True:
            self._wanted.get()
            while not self._wanted.empty():
                self._wanted.get()
            if self._closing:
                return
            with self._flushing:
                try:
                    if self._failure is None:
                        self._flush()
                except OSError as error:
                    self._failure = error
