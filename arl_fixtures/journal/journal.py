"""The journal: append only, on the disk before anything depends on it."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self, final

from arl_fixtures.errors import StorageError
from arl_fixtures.journal import entries as said
from arl_fixtures.journal.entries import Identity, JournalModel, Repair, SessionBegin, SessionResume
from arl_fixtures.journal.lines import FIRST, encode, line_hash, read_lines
from arl_fixtures.journal.record import SessionRecord, read_journal
from arl_fixtures.journal.syncing import End, Syncer

_SHOWN_BYTES: Final = 200

PART_OF_A_STEP: Final = (said.StepBegin, said.Settle, said.Bag, said.Measurement, said.Judgement, said.Note)
"""Nothing depends on these before the end of their step. `append` waits for the disk after any other entry."""


class Clock(Protocol):
    """What a journal asks of the bench clock."""

    @property
    def now_s(self) -> float:
        """Seconds on the bench clock."""

    def utc_ns(self) -> int:
        """Bench UTC, nanoseconds."""


@final
class Journal:
    """One session's journal, open for writing. Only one process has it at a time.

    Made by `create`, `resume` or `reopen`. What was appended outlives the process at once. It outlives the host, too,
    when `append` returns, or, of the types `PART_OF_A_STEP`, one or two flushes of the disk later.
    """

    def __init__(self, path: Path, descriptor: int, clock: Clock) -> None:
        self.path = path
        self._descriptor, self._clock = descriptor, clock
        self._begin_at(End(0, 0, FIRST))

    def _begin_at(self, end: End) -> None:
        self._end, self._syncer = end, Syncer(self._descriptor, end)

    @classmethod
    def create(cls, path: Path, begin: SessionBegin, clock: Clock) -> Self:
        """Begin a session in a new file.

        Raises:
            StorageError: the file exists or cannot be written.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(f"{path.parent}: cannot create: {error.strerror}") from None
        # it gets its name with its first line in it: no death leaves a journal that cannot be read
        unborn = path.with_name(f".{path.name}.new")
        journal = cls(path, _open(unborn, os.O_CREAT), clock)
        with journal._closing_on_error():
            os.ftruncate(journal._descriptor, 0)
            journal.append(begin)
            try:
                path.hardlink_to(unborn)
            except FileExistsError:
                raise StorageError(f"{path}: journal exists already and is not overwritten") from None
            except OSError as error:
                raise StorageError(f"{path}: cannot create: {error.strerror}") from None
            finally:
                unborn.unlink(missing_ok=True)
            _sync_folder(path.parent)
        return journal

    @classmethod
    def reopen(cls, path: Path, clock: Clock) -> Self:
        """Append to an existing file without going on with the session: a guard's safe stop, an acknowledgement.

        A torn last line is cut off and the cut is journalled.

        Raises:
            DataError: the file is damaged before its last line.
            StorageError: another process has it, or it cannot be written.
        """
        journal = cls(path, _open(path, 0), clock)
        with journal._closing_on_error():
            contents = read_lines(path)
            journal._begin_at(End(len(contents.lines), contents.size, contents.last_hash))
            if contents.torn:
                os.ftruncate(journal._descriptor, contents.size)
                shown = contents.torn[:_SHOWN_BYTES].decode("utf-8", "backslashreplace").replace("\x00", "\\0")
                journal.append(Repair(discarded_bytes=len(contents.torn), discarded=shown))
        return journal

    @classmethod
    def resume(cls, path: Path, identity: Identity, clock: Clock, reason: str = "") -> Self:
        """Go on with the session of an existing file; a torn last line is dealt with as in `reopen`.

        Whether the identity is the session's own is for `check_same` to say, before.

        Raises:
            DataError: the file is damaged before its last line.
            StorageError: another process has it, or it cannot be written.
        """
        journal = cls.reopen(path, clock)
        with journal._closing_on_error():
            journal.append(SessionResume(identity=identity, reason=reason))
        return journal

    @staticmethod
    def read(path: Path) -> SessionRecord:
        """What a journal says; see `read_journal`."""
        return read_journal(path)

    def append(self, entry: JournalModel) -> int:
        """Write one entry.

        Returns:
            its sequence number.

        Raises:
            StorageError: it could not be written; the file is as it was before. Or an entry before it could not be
                brought to the disk; the file is as it was when the disk had all of it.
        """
        return self.append_many([entry])

    def append_many(self, entries: Sequence[JournalModel]) -> int:
        """Write several entries, with one sync at most; after a crash any number of the first may be there.

        Returns:
            sequence number of the last.
        """
        time_s, utc_ns = self._clock.now_s, self._clock.utc_ns()
        return self.append_at([(time_s, utc_ns, entry) for entry in entries])

    def append_at(self, stamped: Sequence[tuple[float, int, JournalModel]]) -> int:
        """As `append_many`, each entry with its own bench time in seconds and UTC in nanoseconds."""
        with self._giving_up():
            self._syncer.check()
        lines, (seq, size, prev) = [], self._end
        for number, (time_s, utc_ns, entry) in enumerate(stamped, start=seq):
            lines.append(encode(number, time_s, utc_ns, prev, entry))
            prev = line_hash(lines[-1])
        block = b"".join(lines)
        try:
            _write_all(self._descriptor, block)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, size)
            raise self._cannot_write(error) from None
        self._end = End(seq + len(lines), size + len(block), prev)
        if all(isinstance(entry, PART_OF_A_STEP) for *_, entry in stamped):
            self._syncer.soon(self._end)
        else:
            self.sync()
        return self._end.seq - 1

    def sync(self) -> None:
        """Return when all that was appended is on the disk.

        Raises:
            StorageError: it is not; the file is as it was when the disk had all of it.
        """
        with self._giving_up():
            self._syncer.now(self._end)

    def close(self) -> None:
        """Let go of the file, when all is on the disk.

        Raises:
            StorageError: it could not be brought there.
        """
        if self._descriptor < 0:
            return
        try:
            self.sync()
        finally:
            self._syncer.close()
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextlib.contextmanager
    def _giving_up(self) -> Iterator[None]:
        """Whatever did not reach the disk was never said: others may know of it, but none may rely on it."""
        try:
            yield
        except OSError as error:
            self._end = self._syncer.give_up()
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._end.size)
            raise self._cannot_write(error) from None

    def _cannot_write(self, error: OSError) -> StorageError:
        return StorageError(f"{self.path}: cannot write journal: {error.strerror}")

    @contextlib.contextmanager
    def _closing_on_error(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self.close()
            raise


def _open(path: Path, flags: int) -> int:
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC | flags, 0o644)
    except OSError as error:
        raise StorageError(f"{path}: cannot open journal: {error.strerror}") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise StorageError(f"{path}: journal is in use by another session") from None
    return descriptor


def _write_all(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


def _sync_folder(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
