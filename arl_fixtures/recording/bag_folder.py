"""A rosbag2 folder (metadata.yaml + one MCAP file) that is whole or does not bear its name.

While it is written the folder is called `NAME.part`; `close` brings everything to the disk and renames it in one
step. An existing folder is never touched.
"""

from __future__ import annotations

import functools
import hashlib
import os
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal, Self, final

from mcap.records import Schema

import arl_fixtures
from arl_fixtures.errors import DataError, StorageError
from arl_fixtures.recording.block_yaml import block_yaml
from arl_fixtures.recording.mcap_file import McapFile, fsync
from arl_fixtures.recording.messages import typestore

PART_SUFFIX: Final = ".part"
METADATA_RECORD: Final = "arl"
Durability = Literal["volatile", "transient_local"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BagReceipt:
    """A finished bag.

    Attributes:
        path: its folder.
        sha256: content hash as `bag_sha256` computes it.
        size_bytes: of all its files.
        message_count: messages in it.
    """

    path: Path
    sha256: str
    size_bytes: int
    message_count: int

    def __str__(self) -> str:
        return (
            f"{self.path}: {self.message_count} messages, {self.size_bytes / 1e6:.1f} MB, SHA-256 {self.sha256[:12]}…"
        )


@final
class BagFolder:
    """Write one bag.

    Args:
        path: final folder; its parent is made when missing.
        custom_data: text to text, for metadata.yaml and the MCAP record `arl`.

    Raises:
        StorageError: the folder or its `.part` exists, or cannot be written.
    """

    def __init__(self, path: Path, custom_data: Mapping[str, str]) -> None:
        self.path = path
        self.part = path.with_name(path.name + PART_SUFFIX)
        self._custom = dict(custom_data)
        self._channels: dict[str, int] = {}
        self._topics: list[dict[str, Any]] = []
        self._open = True
        if path.exists():
            raise StorageError(f"{path}: a bag of this name exists already and is not overwritten")
        try:
            self.part.mkdir(parents=True)
        except FileExistsError:
            raise StorageError(
                f"{self.part}: an unfinished bag is in the way; keep what is whole with `arl recover`, then remove it"
            ) from None
        except OSError as error:
            raise StorageError(f"{self.part}: cannot create: {error.strerror}") from None
        library = f"arl-fixtures {arl_fixtures.__version__}"
        self.file = McapFile(self.part / f"{path.name}_0.mcap", library)
        self.file.metadata(METADATA_RECORD, self._custom)

    def topic(
        self, name: str, msgtype: str, durability: Durability = "volatile", schema: Schema | None = None
    ) -> int:
        """Channel id of a topic, declared when new.

        Args:
            name: topic.
            msgtype: ROS type name.
            durability: offered durability.
            schema: definition to use as it is; by default that of the ROS 2 type of this name.
        """
        if name in self._channels:
            return self._channels[name]
        if schema is None:
            definition, _ = typestore().generate_msgdef(msgtype, ros_version=2)
            schema = Schema(id=0, name=msgtype, encoding="ros2msg", data=definition.encode())
        known = msgtype in typestore().types
        self._channels[name] = self.file.channel(name, schema, _qos_text(durability))
        self._topics.append(
            {
                "name": name,
                "type": msgtype,
                "serialization_format": "cdr",
                "offered_qos_profiles": [_qos(durability)],
                "type_description_hash": typestore().hash_rihs01(msgtype) if known else "",
            }
        )
        return self._channels[name]

    @property
    def counts(self) -> dict[str, int]:
        """Messages so far, by topic."""
        return {name: self.file.counts[channel] for name, channel in self._channels.items()}

    def close(self) -> BagReceipt:
        """Finish the bag and give it its name.

        Raises:
            StorageError: it could not be written; the `.part` folder stays for `arl recover`.
        """
        if not self._open:
            raise StorageError(f"{self.path}: bag is closed already")
        self._open = False
        try:
            self.file.flush()
            information = block_yaml(self._information())
            self.file.metadata("rosbag2", {"serialized_metadata": information.strip()})
        except StorageError:
            self.file.abort()
            raise
        mcap_sha256, mcap_bytes = self.file.close()
        text = f"rosbag2_bagfile_information:\n{textwrap.indent(information, '  ')}".encode()
        try:
            _write_durably(self.part / "metadata.yaml", text)
            _sync_folder(self.part)
            if self.path.exists():
                raise StorageError(f"{self.path}: a bag of this name exists already and is not overwritten")
            self.part.rename(self.path)
            _sync_folder(self.path.parent)
        except OSError as error:
            raise StorageError(f"{self.part}: cannot write: {error.strerror}") from None
        digests = {self.file.path.name: mcap_sha256, "metadata.yaml": hashlib.sha256(text).hexdigest()}
        return BagReceipt(
            path=self.path,
            sha256=_combine(digests),
            size_bytes=mcap_bytes + len(text),
            message_count=sum(self.file.counts.values()),
        )

    def abort(self) -> None:
        """Leave the `.part` folder as it is, without index."""
        if self._open:
            self._open = False
            self.file.abort()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self.abort()
        elif self._open:
            self.close()

    def _information(self) -> dict[str, Any]:
        counts = self.file.counts
        total = sum(counts.values())
        start = self.file.first_ns if total else 0
        duration = {"nanoseconds": self.file.last_ns - start if total else 0}
        starting_time = {"nanoseconds_since_epoch": start}
        name = self.file.path.name
        return {
            "version": 9,
            "storage_identifier": "mcap",
            "relative_file_paths": [name],
            "duration": duration,
            "starting_time": starting_time,
            "message_count": total,
            "topics_with_message_count": [
                {"topic_metadata": topic, "message_count": counts[self._channels[topic["name"]]]}
                for topic in self._topics
            ],
            "compression_format": "",
            "compression_mode": "",
            "files": [{"path": name, "starting_time": starting_time, "duration": duration, "message_count": total}],
            "custom_data": self._custom,
            "ros_distro": "jazzy",
        }


def bag_sha256(path: Path) -> str:
    """Content hash of a bag folder: SHA-256 of what `sha256sum *` prints inside it.

    Raises:
        DataError: it is not a readable folder.
    """
    digests = {}
    try:
        for file in sorted(path.iterdir()):
            with file.open("rb") as stream:
                digests[file.name] = hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"{path}: cannot read bag: {error.strerror}") from None
    return _combine(digests)


def verify(path: Path, sha256: str) -> None:
    """Check a bag against the hash that its journal holds.

    Raises:
        DataError: the bag is missing or its content differs.
    """
    found = bag_sha256(path)
    if found != sha256:
        raise DataError(f"{path}: content differs from the journal: SHA-256 {found[:12]}…, expected {sha256[:12]}…")


def _combine(digests: Mapping[str, str]) -> str:
    listing = "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    return hashlib.sha256(listing.encode()).hexdigest()


def _qos(durability: Durability) -> dict[str, Any]:
    forever = {"sec": 9223372036, "nsec": 854775807}
    return {
        "history": "keep_last",
        "depth": 10,
        "reliability": "reliable",
        "durability": durability,
        "deadline": forever,
        "lifespan": forever,
        "liveliness": "automatic",
        "liveliness_lease_duration": forever,
        "avoid_ros_namespace_conventions": False,
    }


@functools.cache
def _qos_text(durability: Durability) -> str:
    return block_yaml([_qos(durability)]).strip()


def _write_durably(path: Path, data: bytes) -> None:
    with path.open("xb") as stream:
        stream.write(data)
        stream.flush()
        fsync(stream.fileno())


def _sync_folder(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fsync(descriptor)
    finally:
        os.close(descriptor)
