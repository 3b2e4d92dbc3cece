"""What of a guard lies on disk: where it listens, who holds the bench, and why it was stopped last.

Everything is in one folder per bench, readable by its user only: `$ARL_RUNTIME_DIR`, else
`$XDG_STATE_HOME/arl`, else `~/.local/state/arl`; a stop must survive a reboot, so it is no folder that is
emptied then.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import signal
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any, Final, final

from arl_fixtures.errors import ArlError, DataError, InterlockError, StorageError

_LONGEST_SOCKET_PATH: Final = 100
_LARGEST_LOG: Final = 2_000_000


class NoGuardError(InterlockError):
    """The guard that was to be spoken to has just ended, or another one came first: look again who guards."""


@dataclass(frozen=True, slots=True)
class Places:
    """Files of the guard of one bench."""

    folder: Path

    @classmethod
    def of(cls, bench: str, runtime: Path | None = None) -> Places:
        """Folder of a bench by its name, made if missing.

        Raises:
            StorageError: it cannot be made, or belongs to somebody else.
        """
        if runtime is None:
            state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
            runtime = Path(os.environ.get("ARL_RUNTIME_DIR") or f"{state}/arl")
        folder = runtime / bench
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            owner = folder.stat().st_uid
        except OSError as error:
            raise StorageError(f"{folder}: cannot keep the guard's state there: {error.strerror}") from None
        if owner != os.getuid():
            raise StorageError(f"{folder}: belongs to another user, who could forge the guard's state")
        if len(str(folder)) > _LONGEST_SOCKET_PATH:
            raise StorageError(f"{folder}: too long for a socket; set ARL_RUNTIME_DIR to a shorter path")
        return cls(folder)

    @property
    def socket(self) -> Path:
        """Where the guard listens."""
        return self.folder / "g.sock"

    @property
    def lease(self) -> Path:
        """Who holds the bench."""
        return self.folder / "lease.json"

    @property
    def driven(self) -> Path:
        """Present while a test drives the bench: whoever finds it with no guard alive finds a bench in any state."""
        return self.folder / "driven.json"

    @property
    def stop(self) -> Path:
        """Why the bench was stopped last."""
        return self.folder / "last_stop.json"

    @property
    def log(self) -> Path:
        """What the guard saw and did, JSON lines."""
        return self.folder / "guard.jsonl"

    @property
    def errors(self) -> Path:
        """Standard error of the guard process."""
        return self.folder / "guard.err"


# -- the lease


def boot_time_s() -> float:
    """Seconds since boot, counting sleep; no change of the wall clock moves it."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


@final
class Lease:
    """The right to guard a bench, held by a lock that the kernel takes back at any death, and renewed.

    Args:
        path: the lease file.
        lease_s: a lease that was not renewed for so long is over: its holder hangs and is killed.

    Raises:
        InterlockError: another guard holds the bench and renews its lease.
    """

    def __init__(self, path: Path, *, lease_s: float) -> None:
        self._path, self._lease_s = path, lease_s
        self._file: IO[str] = _open_private(path)
        try:
            if not self._lock():
                self._fence()
        except BaseException:
            self._file.close()
            raise
        self._renewed_s = float("-inf")
        self.renew()

    def renew(self) -> None:
        """Say that the holder is alive, if it is time to."""
        now_s = boot_time_s()
        if now_s - self._renewed_s < 0.25 * self._lease_s:
            return
        self._renewed_s = now_s
        text = json.dumps({"pid": os.getpid(), "started": started(os.getpid()), "renewed_s": now_s})
        self._file.seek(0)
        self._file.write(text.ljust(200) + "\n")
        self._file.flush()

    def release(self) -> None:
        """Give the bench up."""
        self._file.close()

    def _lock(self) -> bool:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _fence(self) -> None:
        """Another process holds the lock: leave it alone while it renews, kill it if it hangs."""
        try:
            holder = json.loads(self._path.read_text())
            pid, age_s = int(holder["pid"]), boot_time_s() - float(holder["renewed_s"])
            same = holder["started"] == started(pid)
        except (OSError, ValueError, KeyError, TypeError):
            raise InterlockError(f"{self._path}: held by a guard that has not said who it is yet") from None
        if age_s < self._lease_s or not same:
            raise InterlockError(f"another guard (process {pid}) holds this bench; its lease is {age_s:.1f} s old")
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        # the lock is free as soon as the kernel has buried it
        fcntl.flock(self._file, fcntl.LOCK_EX)


def lease_holder(path: Path, *, lease_s: float) -> int:
    """Process number of the guard that holds a bench; 0 if none does, or it hangs."""
    try:
        holder = json.loads(path.read_text())
        pid, age_s = int(holder["pid"]), boot_time_s() - float(holder["renewed_s"])
        alive = bool(holder["started"]) and holder["started"] == started(pid) and process_state(pid) not in {"Z", "X"}
    except (OSError, ValueError, KeyError, TypeError):
        return 0
    return pid if alive and 0.0 <= age_s < lease_s else 0


def wait_for_lease(path: Path, *, timeout_s: float) -> None:
    """Wait until nobody holds a bench any more, but not for ever."""
    deadline_s = time.monotonic() + timeout_s
    pause = threading.Event()
    while lease_holder(path, lease_s=timeout_s) and time.monotonic() < deadline_s:
        pause.wait(0.02)


def started(pid: int) -> str:
    """When a process was started (clock ticks since boot): with the number, its identity. Empty if it is gone."""
    fields = _stat(pid)
    return fields[19] if len(fields) > 19 else ""


def process_state(pid: int) -> str:
    """The kernel's letter: R, S, D, T (stopped), t (traced), Z, X; empty if it is gone or cannot be told."""
    fields = _stat(pid)
    return fields[0] if fields else ""


def _stat(pid: int) -> list[str]:
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return []
    # the name in parentheses may hold anything
    return text.rpartition(")")[2].split()


# -- the last stop


UNDER_WAY: Final = {"all safe actions": "under way"}
"""What cannot be verified yet when a stop begins."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopReport:
    """Why a bench was stopped, what was done, and whether somebody must look.

    Attributes:
        bench: name of the bench.
        cause: what tripped, in words.
        utc: when, ISO 8601.
        bench_time_s: when, on the bench clock.
        actions: each safe action as it was carried out: `time_s`, `step`, `fault` (empty when verified).
        unverified: safe action to why it could not be verified.
        needs_ack: whether nothing may drive the bench before `arl ack`; true while the actions are under way.
        ack_if_verified: whether it must be acknowledged even when every action is verified in the end.
        acknowledged: `by`, `utc`, `note` of the acknowledgement; empty before.
    """

    bench: str
    cause: str
    utc: str
    bench_time_s: float
    actions: list[dict[str, Any]] = field(default_factory=list)
    unverified: dict[str, str] = field(default_factory=dict)
    needs_ack: bool = True
    ack_if_verified: bool = True
    acknowledged: dict[str, str] = field(default_factory=dict)

    @property
    def blocks(self) -> bool:
        """Whether it still has to be acknowledged."""
        return self.needs_ack and not self.acknowledged

    def __str__(self) -> str:
        text = f"bench '{self.bench}' was stopped at {self.utc}: {self.cause}"
        if self.unverified:
            what = "; ".join(f"{step}: {why}" for step, why in self.unverified.items())
            text += f"; could NOT be verified: {what}"
        else:
            text += "; laser and DUT power off, safe set-point and stage stop were verified"
        if self.acknowledged:
            who, note = (self.acknowledged.get(key, "") for key in ("by", "note"))
            text += f"; acknowledged by {who}: {note or 'without a note'}"
        return text


def read_stop(places: Places) -> StopReport | None:
    """The last stop; None if there never was one.

    Raises:
        DataError: the file is damaged. It counts as a stop that nobody has acknowledged.
    """
    try:
        text = places.stop.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DataError(f"{places.stop}: cannot read: {error.strerror}") from None
    try:
        return StopReport(**json.loads(text))
    except (ValueError, TypeError):
        raise DataError(f"{places.stop}: is damaged; look at the bench, then remove the file") from None


def write_stop(places: Places, report: StopReport) -> None:
    """Keep a stop, so that it survives power loss."""
    write_durably(places.stop, json.dumps(asdict(report), indent=1) + "\n")


def write_durably(path: Path, text: str) -> None:
    """Write a file that is whole or the old one, whatever happens.

    Raises:
        StorageError: it cannot be written.
    """
    temporary = path.with_suffix(".new")
    try:
        with _open_private(temporary) as file:
            file.truncate(0)
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise StorageError(f"{path}: cannot write: {error.strerror}") from None


def append_log(places: Places, entries: list[Mapping[str, Any]]) -> None:
    """Add lines to the guard's log; at two megabytes the log begins anew and the old one is kept once.

    A guard must not fall because its disk is full: what cannot be written is lost.
    """
    with contextlib.suppress(OSError, ArlError):
        if places.log.exists() and places.log.stat().st_size > _LARGEST_LOG:
            places.log.replace(places.log.with_suffix(".old.jsonl"))
        with _open_private(places.log, "a") as file:
            file.writelines(json.dumps(entry) + "\n" for entry in entries)


def _open_private(path: Path, mode: str = "r+") -> IO[str]:
    def opener(name: str, flags: int) -> int:
        return os.open(name, flags | os.O_CREAT | os.O_NOFOLLOW, 0o600)

    try:
        return open(path, mode, opener=opener, encoding="utf-8")
    except OSError as error:
        raise StorageError(f"{path}: cannot open: {error.strerror}") from None
