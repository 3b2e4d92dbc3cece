"""Names that go to disk and onto topics. Serial numbers are bytes from outside: none of them may leave its folder."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

from arl_fixtures.errors import StorageError

_NOT_FILE = re.compile(r"[^A-Za-z0-9._+-]+")
_NOT_TOPIC = re.compile(r"[^A-Za-z0-9]+")
_MAX_LENGTH = 80


def safe_file_name(text: str) -> str:
    """One plain path component made from any text: no separator, no leading dot, at most 80 characters.

    A text that had to be changed gets six hex digits of its hash, so that two texts never share a name.

    >>> safe_file_name("c0003-07-up+25C")
    'c0003-07-up+25C'
    >>> safe_file_name("../../etc/passwd")
    'etc_passwd-3754d6'
    """
    name = _NOT_FILE.sub("_", text).lstrip("._-")[:_MAX_LENGTH].rstrip("_")
    if name == text and name:
        return name
    return f"{name or 'unnamed'}-{_digest(text)}"


def inside(folder: Path, name: str) -> Path:
    """`folder / name`, refused when it would lie outside `folder`.

    Raises:
        StorageError: the name climbs out of the folder or is absolute.
    """
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise StorageError(f"{name!r} would lie outside the output folder {folder}")
    return path


def bag_name(step_id: str, attempt: int) -> str:
    """Folder of one attempt: `c0003-07-up+25C` for the first, `c0003-07-up+25C-attempt2` for the second."""
    return safe_file_name(step_id if attempt == 1 else f"{step_id}-attempt{attempt}")


def topic_tokens(serials: Sequence[str]) -> dict[str, str]:
    """A ROS name for each serial number (`dut_SN_HFL110_0001`), unique among them and the same on each run.

    Raises:
        StorageError: two DUTs with one serial number.
    """
    if len(set(serials)) != len(serials):
        raise StorageError(f"two DUTs bear the same serial number: {', '.join(serials)}")
    tokens = {serial: "dut_" + (_NOT_TOPIC.sub("_", serial).strip("_") or "unnamed") for serial in serials}
    plain = list(tokens.values())
    return {
        serial: token if plain.count(token) == 1 else f"{token}_{_digest(serial)}" for serial, token in tokens.items()
    }


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:6]
