"""Wall time as it would pass on a machine that has nothing else to do.

Where bench time passes as on the wall, a guard has two seconds to act. A machine with other work keeps processes
waiting for a processor or the disk, and what passes meanwhile tells nothing of them. So time is not taken from the
wall alone: while any process that counts wants to run and is not let, it stands; while they run it passes as they
use the processor, so that one that computes for ever does not freeze it; while all sleep or are stopped, as on the
wall.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, final

_TICK_S: Final = 0.01
_LONGEST_TICK_S: Final = 2.0 * _TICK_S
"""Who looks later than that was kept waiting itself, and cannot tell what the others did."""
_WANTS_TO_RUN: Final = frozenset({"R", "D"})
_CPU_TICK_S: Final = 1.0 / os.sysconf("SC_CLK_TCK")


class _Stat(NamedTuple):
    """What the kernel tells of a process or thread."""

    state: str
    parent: int
    cpu_s: float


@final
class OwnTime:
    """Seconds that pass for a few processes, whatever else the machine does. Looked at by a thread of its own.

    Args:
        processes: gives the numbers of those that count; with them do all that they start, whoever starts them.
    """

    def __init__(self, processes: Callable[[], Iterable[int]]) -> None:
        self._processes = processes
        self._now_s = 0.0
        self._roots: set[int] = set()
        self._family: set[int] = set()
        self._listed: set[int] = set()
        self._cpu_s: dict[int, float] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look_again_and_again, name="own time", daemon=True)

    def __call__(self) -> float:
        """Seconds since it was started."""
        return self._now_s

    def start(self) -> None:
        """Time begins to pass."""
        self._thread.start()

    def stop(self) -> None:
        """Time stands still for ever."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _look_again_and_again(self) -> None:
        before_s = time.monotonic()
        while not self._stop.wait(_TICK_S):
            at_once, used_s = self._look()
            now_s = time.monotonic()
            passed_s = min(now_s - before_s, _LONGEST_TICK_S)
            self._now_s += passed_s if at_once else min(passed_s, used_s)
            before_s = now_s

    def _look(self) -> tuple[bool, float]:
        """Whether all who have something to do do it at once, for they have nothing; and the processor time used."""
        self._meet()
        waits, used_s, cpu_s = False, 0.0, {}
        for pid in self._family:
            stat = _stat(f"/proc/{pid}/stat")
            if stat is None:
                continue
            cpu_s[pid] = stat.cpu_s
            used_s += stat.cpu_s - self._cpu_s.get(pid, 0.0 if pid not in self._roots else stat.cpu_s)
            waits = waits or any(state in _WANTS_TO_RUN for state in _states(pid))
        self._cpu_s = cpu_s
        return not waits, used_s

    def _meet(self) -> None:
        """Who is there, and who of those that have come since the last look was started by one that counts."""
        roots = set(self._processes())
        listed = set(_numbers("/proc"))
        # a process that begins to count may have started others before
        come = listed if roots - self._roots else listed - self._listed
        self._roots |= roots
        self._family = (self._family | roots) & listed
        for pid in sorted(come - self._family):
            stat = _stat(f"/proc/{pid}/stat")
            if stat is not None and stat.parent in self._family:
                self._family.add(pid)
        self._listed = listed


def _states(pid: int) -> list[str]:
    """State of every thread, but not of the one that looks."""
    mine = threading.get_native_id()
    stats = [_stat(f"/proc/{pid}/task/{thread}/stat") for thread in _numbers(f"/proc/{pid}/task") if thread != mine]
    return [stat.state for stat in stats if stat is not None]


def _numbers(folder: str) -> list[int]:
    try:
        return [int(name) for name in os.listdir(folder) if name.isdigit()]  # noqa: PTH208 ten times as fast
    except OSError:
        return []


def _stat(path: str) -> _Stat | None:
    try:
        with open(path, "rb", buffering=0) as file:  # noqa: PTH123 many times a second
            text = file.read(1024)
    except OSError:
        return None
    # the name in parentheses may hold anything
    fields = text.rpartition(b")")[2].split()
    if len(fields) < 13:
        return None
    return _Stat(fields[0].decode(), int(fields[1]), (int(fields[11]) + int(fields[12])) * _CPU_TICK_S)
