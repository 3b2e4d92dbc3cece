"""Records of an MCAP file in the order they lie on the disk, as far as they are whole.

`mcap.StreamReader` gives up at the first record that is cut and copies each message twice. This scan yields views
into the chunk, and of a cut chunk still everything that its compressed bytes decode to.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import lz4.frame  # type: ignore[import-untyped]  # comes without stubs
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from arl_fixtures.errors import DataError
from arl_fixtures.recording.mcap_file import MAGIC

_HEAD: Final = struct.Struct("<BQ")
_CHUNK: Final = struct.Struct("<QQQII")
_MESSAGE: Final = struct.Struct("<HIQQ")
_MAX_CHUNK_BYTES: Final = 1 << 30
_PRIVATE_OPCODES: Final = 0x80
"""From here on the format leaves opcodes to writers; readers pass over them."""


class Message(NamedTuple):
    """One message as it lies in its chunk.

    Attributes:
        topic: its topic.
        msgtype: ROS type name.
        sequence: number within its channel.
        log_time_ns: log time.
        data: CDR bytes, a view that keeps the chunk alive.
    """

    topic: str
    msgtype: str
    sequence: int
    log_time_ns: int
    data: memoryview


@dataclass(slots=True)
class McapScan:
    """One pass over a file; `channels`, `metadata` and `fault` fill up as `messages` runs.

    Attributes:
        path: the file.
        channels: by id.
        schemas: by id.
        metadata: metadata records by name.
        fault: what ended the pass before the file's proper end, empty if it is whole.
        damaged_chunks: whole chunks whose checksum is wrong; their messages are left out.
    """

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    fault: str = ""
    damaged_chunks: int = 0
    _names: dict[int, tuple[str, str]] = field(default_factory=dict)

    def messages(self) -> Iterator[Message]:
        """Every message that can be read.

        Raises:
            DataError: the file cannot be opened or is no MCAP file.
        """
        try:
            stream = self.path.open("rb")
        except OSError as error:
            raise DataError(f"{self.path}: cannot read: {error.strerror}") from None
        with stream:
            magic = stream.read(len(MAGIC))
            if magic != MAGIC:
                raise DataError(f"{self.path}: is no MCAP file (starts with {magic[:8]!r})")
            yield from self._records(stream)

    def topics(self) -> dict[str, str]:
        """Topics declared so far, with their types."""
        return {channel.topic: self._msgtype(channel) for channel in self.channels.values()}

    def _msgtype(self, channel: Channel) -> str:
        schema = self.schemas.get(channel.schema_id)
        return schema.name if schema else ""

    def head(self) -> None:
        """Read what stands before the first message: metadata, and topics as far as declared."""
        for _ in self.messages():
            break
        self.fault = ""

    def _records(self, stream: io.BufferedReader) -> Iterator[Message]:
        while True:
            start = stream.tell()
            head = stream.read(_HEAD.size)
            if len(head) < _HEAD.size:
                self.fault = f"ends at byte {start} without an end mark"
                return
            opcode, length = _HEAD.unpack(head)
            if opcode == Opcode.DATA_END:
                self._end(stream, start, length)
                return
            if not 0 < opcode <= Opcode.DATA_END and opcode < _PRIVATE_OPCODES:
                self.fault = f"no record at byte {start}"
                return
            body = stream.read(length) if length <= _MAX_CHUNK_BYTES else b""
            cut = len(body) < length
            if cut:
                self.fault = f"record at byte {start} is cut: {length} bytes long, {len(body)} there"
            if opcode == Opcode.CHUNK:
                yield from self._walk(self._unpack(body, cut=cut))
            elif not cut and opcode != Opcode.MESSAGE_INDEX:
                yield from self._walk(head + body)
            if cut:
                return

    def _walk(self, records: bytes) -> Iterator[Message]:
        """Messages among these records; the last may be cut."""
        view, at, end = memoryview(records), 0, len(records)
        while at + _HEAD.size <= end:
            opcode, length = _HEAD.unpack_from(records, at)
            at += _HEAD.size
            if at + length > end:
                return
            if opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
                number, sequence, log_time_ns, _ = _MESSAGE.unpack_from(records, at)
                if number in self.channels:
                    topic, msgtype = self._names[number]
                    data = view[at + _MESSAGE.size : at + length]
                    yield Message(topic, msgtype, sequence, log_time_ns, data)
            else:
                self._declare(opcode, records[at : at + length])
            at += length

    def _end(self, stream: io.BufferedReader, start: int, length: int) -> None:
        stream.seek(0, io.SEEK_END)
        size = stream.tell()
        stream.seek(max(size - len(MAGIC), start))
        if size < start + _HEAD.size + length or stream.read() != MAGIC:
            self.fault = f"its index, from byte {start} on, is cut"

    def _declare(self, opcode: int, body: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(body))
        try:
            if opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self.channels[channel.id] = channel
                self._names[channel.id] = (channel.topic, self._msgtype(channel))
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.schemas[schema.id] = schema
            elif opcode == Opcode.METADATA:
                record = Metadata.read(stream)
                self.metadata[record.name] = record.metadata
        except (struct.error, EndOfFile, UnicodeDecodeError) as error:
            raise DataError(f"{self.path}: damaged record (opcode {opcode}): {error}") from None

    def _unpack(self, body: bytes, *, cut: bool) -> bytes:
        """Plain bytes of a chunk: all or nothing when it is whole, what decodes when it is cut."""
        try:
            _, _, size, crc, name_length = _CHUNK.unpack_from(body)
            at = _CHUNK.size + name_length
            compression = bytes(body[_CHUNK.size : at]).decode()
            packed = memoryview(body)[at + 8 :]
            if size > _MAX_CHUNK_BYTES:
                raise ValueError(f"chunk of {size} bytes")
            if cut:
                return _unpack_start(packed, compression, size)
            plain = _UNPACK[compression](packed, size)
            if len(plain) != size or (crc and zlib.crc32(plain) != crc):
                raise ValueError("checksum")
        except KeyError:
            raise DataError(f"{self.path}: chunk compression {compression!r}; expected zstd, lz4 or none") from None
        except (ValueError, struct.error, zstandard.ZstdError, RuntimeError):
            self.damaged_chunks += not cut
            return b""
        return plain


_UNPACK: Final[Mapping[str, Callable[[memoryview, int], bytes]]] = {
    "": lambda data, _size: bytes(data),
    "zstd": lambda data, size: zstandard.ZstdDecompressor().decompress(data, max_output_size=size),
    "lz4": lambda data, _size: bytes(lz4.frame.decompress(data)),
}


def _unpack_start(packed: memoryview, compression: str, size: int) -> bytes:
    """What the first bytes of a chunk decode to, never more than the chunk says it holds."""
    if compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
            return stream.read(size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(bytes(packed), max_length=size))
    return bytes(packed[:size])
