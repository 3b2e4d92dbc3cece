"""A bag that was cut, rewritten from what is whole in it: every complete message, with index and metadata."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from arl_fixtures.errors import DataError
from arl_fixtures.recording.bag_folder import METADATA_RECORD, PART_SUFFIX, BagFolder
from arl_fixtures.recording.messages import typestore
from arl_fixtures.recording.metadata import RECOVERED_FROM
from arl_fixtures.recording.scan import McapScan, Message

RECOVERED_SUFFIX: Final = ".recovered"


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What came of a recovery.

    Attributes:
        source: the file that was read; it stays as it is.
        path: the new bag.
        sha256: content hash of the new bag.
        messages: messages kept, by topic; 0 for a topic that was declared and has none.
        fault: where and how the source ends, empty if it is whole.
        damaged_chunks: chunks left out because their checksum was wrong.
    """

    source: Path
    path: Path
    sha256: str
    messages: Mapping[str, int]
    fault: str
    damaged_chunks: int

    def __str__(self) -> str:
        kept = f"{sum(self.messages.values())} messages on {len(self.messages)} topics kept"
        lost = f"; {self.damaged_chunks} damaged chunks left out" if self.damaged_chunks else ""
        return f"{self.path}: {kept}{lost}; source {self.fault or 'was whole'}"


def recover(bag: Path, out: Path | None = None) -> Recovery:
    """Rewrite a bag from what is whole in it. It may be cut at any byte.

    Args:
        bag: bag folder, `.part` folder or MCAP file.
        out: folder of the new bag; by default beside the old one, `NAME.recovered`.

    Raises:
        DataError: there is no MCAP file, or no complete message in it.
        StorageError: the new bag is there already or cannot be written.
    """
    source = _mcap_file(bag)
    scan = McapScan(source)
    messages = _until_damage(scan)
    first = next(messages, None)
    if first is None:
        raise DataError(f"{source}: holds no complete message, nothing to recover ({scan.fault or 'it is empty'})")
    custom = dict(scan.metadata.get(METADATA_RECORD, {}))
    with BagFolder(out or _default_path(bag), custom | {RECOVERED_FROM: bag.name}) as folder:
        _declare(scan, folder)
        _copy(scan, folder, first)
        for message in messages:
            _copy(scan, folder, message)
        _declare(scan, folder)
        receipt = folder.close()
        kept = folder.counts
    return Recovery(
        source=source,
        path=receipt.path,
        sha256=receipt.sha256,
        messages=kept,
        fault=scan.fault,
        damaged_chunks=scan.damaged_chunks,
    )


def _mcap_file(bag: Path) -> Path:
    if bag.is_file():
        return bag
    files = sorted(bag.glob("*.mcap")) if bag.is_dir() else []
    if len(files) != 1:
        found = f"{len(files)} MCAP files in it" if bag.is_dir() else "no such folder"
        raise DataError(f"{bag}: cannot recover: {found}; expected one")
    return files[0]


def _default_path(bag: Path) -> Path:
    name = bag.name.removesuffix(PART_SUFFIX).removesuffix(".mcap")
    return bag.with_name(name + RECOVERED_SUFFIX)


def _until_damage(scan: McapScan) -> Iterator[Message]:
    try:
        yield from scan.messages()
    except DataError as error:
        if not scan.channels:
            raise
        scan.fault = str(error)


def _declare(scan: McapScan, folder: BagFolder) -> None:
    """Topics seen so far, also those without a message."""
    for channel in scan.channels.values():
        schema = scan.schemas.get(channel.schema_id)
        if schema is None:
            continue
        durable = "transient_local" in channel.metadata.get("offered_qos_profiles", "")
        # a definition that we know cannot have been damaged
        foreign = None if schema.name in typestore().types else schema
        if foreign is None or _is_text(schema.data):
            folder.topic(channel.topic, schema.name, "transient_local" if durable else "volatile", foreign)


def _is_text(data: bytes) -> bool:
    try:
        data.decode()
    except UnicodeDecodeError:
        return False
    return True


def _copy(scan: McapScan, folder: BagFolder, message: Message) -> None:
    if message.topic not in folder.counts:
        _declare(scan, folder)
    if message.topic in folder.counts:  # else its schema is lost, and without it nobody can read the message
        folder.file.message(folder.topic(message.topic, message.msgtype), message.log_time_ns, message.data)
        folder.file.seal()
