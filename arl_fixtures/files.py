"""Files that are there whole or not at all, whenever the process or the host dies."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from arl_fixtures.errors import StorageError


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, or replace one, in one step; its folder is made if need be.

    Raises:
        StorageError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise StorageError(f"{path}: cannot be written: {error.strerror}") from None
