"""Images as MCAP message records, and back.

Images are the bulk of a recording (four for each frame), and all images of one angle differ in stamp and pixels only:
their records are laid out as one array, the header repeated from a template, so that a frame costs a copy and no
Python per message. Tests hold the bytes against rosbags' own serialisation.
"""

from __future__ import annotations

import functools
import struct
from typing import Any, Final, final

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from arl_fixtures.errors import DataError

UInt8Array = npt.NDArray[np.uint8]
UInt64Array = npt.NDArray[np.uint64]

_RECORD_HEAD = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_PIXEL_BYTES: Final = {"mono8": 1, "mono16": 2, "32FC1": 4}


def _image_tail(frame_id: str, height: int, width: int, encoding: str) -> bytes:
    """CDR of an Image from after its stamp up to its pixels."""
    out = bytearray()
    out += _cdr_string(frame_id)
    _pad(out, 8)
    out += struct.pack("<II", height, width)
    out += _cdr_string(encoding)
    out += b"\x00"  # little-endian
    _pad(out, 8)
    step = width * _PIXEL_BYTES[encoding]
    out += struct.pack("<II", step, height * step)
    return bytes(out)


def _cdr_string(text: str) -> bytes:
    raw = text.encode() + b"\x00"
    return struct.pack("<I", len(raw)) + raw


def _pad(out: bytearray, before: int) -> None:
    out += b"\x00" * (-(before + len(out)) % 4)


@functools.cache
def _image_head(channel: int, frame_id: str, height: int, width: int, encoding: str) -> tuple[np.dtype[Any], bytes]:
    tail = _image_tail(frame_id, height, width, encoding)
    layout = np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("encapsulation", "V4"),
            ("sec", "<i4"),
            ("nanosec", "<u4"),
            ("tail", f"V{len(tail)}"),
        ]
    )
    length = layout.itemsize - 9 + height * width * _PIXEL_BYTES[encoding]
    head = _RECORD_HEAD.pack(Opcode.MESSAGE, length, channel, 0, 0, 0) + b"\x00\x01\x00\x00" + bytes(8) + tail
    return layout, head


def image_records(
    channel: int,
    frame_id: str,
    encoding: str,
    *,
    first_sequence: int,
    log_time_ns: UInt64Array,
    stamp_ns: npt.NDArray[np.int64],
    images: npt.NDArray[Any],
) -> UInt8Array:
    """MCAP message records of `n` images on one channel.

    Args:
        channel: MCAP channel id.
        frame_id: optical frame.
        encoding: `mono8`, `mono16` or `32FC1`.
        first_sequence: sequence number of the first.
        log_time_ns: (n,) log times.
        stamp_ns: (n,) stamps of the messages.
        images: (n, H, W) of the encoding's type; the frames may lie apart in memory, each one whole.

    Returns:
        (n, bytes of one record).
    """
    count, height, width = images.shape
    layout, template = _image_head(channel, frame_id, height, width, encoding)
    head = np.frombuffer(template * count, dtype=layout).copy()
    head["sequence"] = np.arange(first_sequence, first_sequence + count, dtype=np.uint32)
    head["log_time"] = head["publish_time"] = log_time_ns
    head["sec"], head["nanosec"] = np.divmod(stamp_ns, 10**9)
    size = layout.itemsize
    records = np.empty((count, size + height * width * _PIXEL_BYTES[encoding]), dtype=np.uint8)
    records[:, :size] = head.view(np.uint8).reshape(count, size)
    # little-endian on disk whatever the machine; no copy where it already is
    pixels = images.astype(images.dtype.newbyteorder("<"), copy=False).reshape(count, height * width)
    records[:, size:] = pixels.view(np.uint8)
    return records


def message_record(channel: int, sequence: int, log_time_ns: int, data: bytes | memoryview) -> bytes:
    """One MCAP message record."""
    head = _RECORD_HEAD.pack(Opcode.MESSAGE, 22 + len(data), channel, sequence, log_time_ns, log_time_ns)
    return head + data


@final
class ImageParser:
    """Reads the Image messages of one topic; a header like the one before, but for the stamp, is not read again.

    Args:
        topic: for error messages.
    """

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._tail = b""
        self._layout: tuple[int, int, int, np.dtype[Any]] = (0, 0, 0, np.dtype(np.uint8))

    def __call__(self, data: memoryview) -> tuple[int, npt.NDArray[Any]]:
        """Stamp and pixels of an Image's CDR.

        Args:
            data: CDR bytes, little-endian.

        Returns:
            stamp in nanoseconds, (H, W) array of uint8, uint16 or float32, a view into `data`.

        Raises:
            DataError: not an Image this tool reads.
        """
        try:
            if not self._tail or bytes(data[12 : 12 + len(self._tail)]) != self._tail:
                self._layout = _image_layout(data)
                self._tail = bytes(data[12 : self._layout[0]])
            start, height, width, dtype = self._layout
            sec, nanosec = _STAMP.unpack_from(data, 4)
            pixels = np.frombuffer(data, dtype=dtype, count=height * width, offset=start)
        except (ValueError, struct.error, IndexError) as error:
            raise DataError(f"topic {self._topic}: not a sensor_msgs/Image this tool reads: {error}") from None
        return sec * 10**9 + nanosec, pixels.reshape(height, width)


_STAMP: Final = struct.Struct("<iI")
_DTYPES: Final = {"mono8": "u1", "8UC1": "u1", "mono16": "u2", "16UC1": "u2", "32FC1": "f4"}


def _image_layout(data: memoryview) -> tuple[int, int, int, np.dtype[Any]]:
    """Offset of the pixels, rows, columns, pixel type."""
    if data[1] != 1:
        raise ValueError("big-endian CDR")
    (length,) = struct.unpack_from("<I", data, 12)
    at = 16 + length
    at += -at % 4
    height, width, length = struct.unpack_from("<III", data, at)
    at += 12
    encoding = bytes(data[at : at + length - 1]).decode(errors="replace")
    at += length
    big_endian = data[at]
    at += 1
    at += -at % 4
    step, size = struct.unpack_from("<II", data, at)
    if encoding not in _DTYPES:
        raise ValueError(f"encoding {encoding!r}; expected {', '.join(_DTYPES)}")
    dtype = np.dtype(_DTYPES[encoding]).newbyteorder(">" if big_endian else "<")
    if step != width * dtype.itemsize or size != step * height:
        raise ValueError(f"{height} rows of {step} bytes do not make {width} columns of {encoding}")
    return at + 8, height, width, dtype
