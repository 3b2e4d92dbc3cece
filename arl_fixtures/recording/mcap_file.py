"""An MCAP file written from behind a bounded queue.

`mcap.writer.Writer` compresses at one fixed level on the caller's thread and handles each message in Python; measured
on this bench's frames that is 0.17 ms of the sweep's own time each. Here the caller hands over whole runs of message
records; one worker compresses, hashes and writes them, nearly all of it outside the interpreter lock.
All other records are made by the `mcap` library.
"""

from __future__ import annotations

import hashlib
import os
import queue
import struct
import threading
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, final

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from arl_fixtures.errors import StorageError
from arl_fixtures.recording.images import UInt64Array, message_record

MAGIC: Final = b"\x89MCAP0\r\n"
CHUNK_BYTES: Final = 256 * 1024
QUEUE_CHUNKS: Final = 8
ZSTD_LEVEL: Final = 1


@dataclass(slots=True)
class _Chunk:
    """Message records not yet on disk."""

    parts: list[bytes | memoryview] = field(default_factory=list)
    size: int = 0
    first_ns: int = 2**63 - 1
    last_ns: int = 0
    index: dict[int, list[tuple[UInt64Array, UInt64Array]]] = field(default_factory=dict)

    def add(self, channel: int, records: memoryview | bytes, log_time_ns: UInt64Array, record_size: int) -> None:
        offsets = np.arange(len(log_time_ns), dtype=np.uint64) * np.uint64(record_size) + np.uint64(self.size)
        self.index.setdefault(channel, []).append((log_time_ns, offsets))
        self.parts.append(records)
        self.size += record_size * len(log_time_ns)
        self.first_ns = min(self.first_ns, int(log_time_ns.min()))
        self.last_ns = max(self.last_ns, int(log_time_ns.max()))


@final
class McapFile:
    """Append messages; `close` writes index and summary.

    Args:
        path: new file.
        library: what the header names as writer.

    Raises:
        StorageError: from any method, when the file cannot be written.
    """

    def __init__(self, path: Path, library: str) -> None:
        self.path = path
        self.counts: dict[int, int] = {}
        self.first_ns, self.last_ns = 2**63 - 1, 0
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self._chunk = _Chunk()
        self._chunk_indexes: list[ChunkIndex] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._hash = hashlib.sha256()
        self._offset = 0
        self._failure: Exception | None = None
        self._closed = False
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            raise StorageError(f"{path}: cannot create: {error.strerror}") from None
        self._queue: queue.Queue[bytes | _Chunk | tuple[str, bytes] | None] = queue.Queue(QUEUE_CHUNKS)
        self._worker = threading.Thread(target=self._work, name=f"bag {path.name}", daemon=True)
        self._worker.start()
        self._queue.put(MAGIC + _bytes(Header("ros2", library)))

    # --- caller's side ---

    def metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record at once, before whatever messages come next."""
        self.flush()
        self._put((name, _bytes(Metadata(name, dict(data)))))

    def channel(self, topic: str, schema: Schema, qos: str) -> int:
        """Declare a topic; its schema is written with the first one of its type, under an id of this file.

        Returns:
            channel id for `append` and `message`.
        """
        schema_id = next((known.id for known in self.schemas.values() if known.name == schema.name), 0)
        declared = b""
        if not schema_id:
            schema_id = len(self.schemas) + 1
            own = Schema(id=schema_id, name=schema.name, encoding=schema.encoding, data=schema.data)
            self.schemas[schema_id] = own
            declared = _bytes(own)
        channel = Channel(
            id=len(self.channels) + 1,
            topic=topic,
            message_encoding="cdr",
            metadata={"offered_qos_profiles": qos},
            schema_id=schema_id,
        )
        self.channels[channel.id] = channel
        self.counts[channel.id] = 0
        self._put(declared + _bytes(channel))
        return channel.id

    def message(self, channel: int, log_time_ns: int, data: bytes | memoryview) -> None:
        """Append one message."""
        record = message_record(channel, self.counts[channel], log_time_ns, data)
        self.append(channel, record, np.array([log_time_ns], dtype=np.uint64), len(record))

    def append(self, channel: int, records: memoryview | bytes, log_time_ns: UInt64Array, record_size: int) -> None:
        """Append message records of equal size, as `messages.image_records` makes them."""
        if not len(log_time_ns):
            return
        self._chunk.add(channel, records, log_time_ns, record_size)
        self.counts[channel] += len(log_time_ns)

    def seal(self) -> None:
        """Hand the messages so far to the disk if they fill a chunk; waits only while the queue is full."""
        if self._chunk.size >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand the messages so far to the disk, however few."""
        if self._chunk.size:
            self.first_ns = min(self.first_ns, self._chunk.first_ns)
            self.last_ns = max(self.last_ns, self._chunk.last_ns)
            self._put(self._chunk)
            self._chunk = _Chunk()

    def close(self) -> tuple[str, int]:
        """Write what is left, index and summary, down to the platter.

        Returns:
            SHA-256 of the file in hex, its size in bytes.
        """
        self.flush()
        self._stop_worker()
        try:
            self.raise_failure()
            self._write(_bytes(DataEnd(0)))
            self._write(self._summary())
            fsync(self._file.fileno())
        except OSError as error:
            raise _storage_error(self.path, error) from None
        finally:
            self._file.close()
        return self._hash.hexdigest(), self._offset

    def abort(self) -> None:
        """Stop without index and summary; what the queue holds still goes to the disk."""
        self._stop_worker()
        self._file.close()

    def raise_failure(self) -> None:
        """Report a failure of the worker, on the caller's thread."""
        if isinstance(self._failure, OSError):
            raise _storage_error(self.path, self._failure)
        if self._failure is not None:
            raise self._failure

    # --- worker's side ---

    def _put(self, item: bytes | _Chunk | tuple[str, bytes]) -> None:
        if self._failure is not None:
            self.abort()  # nobody may leave a thread behind, whatever he does with the error
            self.raise_failure()
        self._queue.put(item)

    def _stop_worker(self) -> None:
        if not self._closed:
            self._closed = True
            self._queue.put(None)
            self._worker.join()

    def _work(self) -> None:
        compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        while (item := self._queue.get()) is not None:
            if self._failure is not None:
                continue  # keep taking, so that the caller is never stuck in a full queue
            try:
                if isinstance(item, _Chunk):
                    self._write_chunk(item, compressor)
                elif isinstance(item, tuple):
                    name, record = item
                    self._metadata_indexes.append(MetadataIndex(self._offset, len(record), name))
                    self._write(record)
                else:
                    self._write(item)
            except Exception as error:  # whatever it is, it belongs to the caller's thread
                self._failure = error

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            written = self._file.write(view)
            self._hash.update(view[:written])
            self._offset += written or 0
            view = view[written:]

    def _write_chunk(self, chunk: _Chunk, compressor: zstandard.ZstdCompressor) -> None:
        plain = b"".join(chunk.parts)
        packed = compressor.compress(plain)
        head = struct.pack("<QQQII", chunk.first_ns, chunk.last_ns, len(plain), zlib.crc32(plain), 4)
        body = head + b"zstd" + struct.pack("<Q", len(packed))
        start = self._offset
        self._write(struct.pack("<BQ", Opcode.CHUNK, len(body) + len(packed)) + body + packed)
        index_start = self._offset
        offsets: dict[int, int] = {}
        index = bytearray()
        for channel, runs in chunk.index.items():
            offsets[channel] = index_start + len(index)
            entries = np.stack([np.concatenate(column) for column in zip(*runs, strict=True)], axis=1)
            raw = entries.astype("<u8", copy=False).tobytes()
            index += struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + len(raw), channel, len(raw)) + raw
        self._write(bytes(index))
        self._chunk_indexes.append(
            ChunkIndex(
                chunk_length=index_start - start,
                chunk_start_offset=start,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=chunk.last_ns,
                message_index_length=len(index),
                message_index_offsets=offsets,
                message_start_time=chunk.first_ns,
                uncompressed_size=len(plain),
            )
        )

    def _summary(self) -> bytes:
        total = sum(self.counts.values())
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self._chunk_indexes),
            message_count=total,
            message_end_time=self.last_ns if total else 0,
            message_start_time=self.first_ns if total else 0,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self.schemas),
        )
        groups: tuple[tuple[Opcode, list[McapRecord]], ...] = (
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, list(self._chunk_indexes)),
            (Opcode.METADATA_INDEX, list(self._metadata_indexes)),
        )
        start, body, offsets = self._offset, b"", b""
        for opcode, records in groups:
            group = b"".join(_bytes(record) for record in records)
            if group:
                offsets += _bytes(SummaryOffset(opcode, start + len(body), len(group)))
            body += group
        offset_start = start + len(body)
        body += offsets
        crc = zlib.crc32(body + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start))
        return body + _bytes(Footer(start, offset_start, crc)) + MAGIC


def fsync(descriptor: int) -> None:
    """Down to the platter. Its own name, so that a test can take the platter away."""
    os.fsync(descriptor)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]  # mcap does not annotate it


def _storage_error(path: Path, error: OSError) -> StorageError:
    return StorageError(f"{path}: cannot write: {error.strerror or error}; what is on disk so far: arl recover")
