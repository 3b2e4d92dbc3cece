from __future__ import annotations

import string

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.errors import DataError
from arl_fixtures.recording.images import ImageParser, image_records
from arl_fixtures.recording.messages import IMAGE, typestore

TYPES = {"mono8": np.uint8, "mono16": np.uint16, "32FC1": np.float32}


@given(
    frame_id=st.text(string.ascii_letters, min_size=1, max_size=9),
    encoding=st.sampled_from(sorted(TYPES)),
    shape=st.tuples(st.integers(1, 3), st.integers(1, 5), st.integers(1, 5)),
    stamp_ns=st.integers(0, 2**31 * 10**9 - 1),
    seed=st.integers(0, 99),
)
def test_bytes_are_those_of_rosbags(
    frame_id: str, encoding: str, shape: tuple[int, int, int], stamp_ns: int, seed: int
) -> None:
    images = np.random.default_rng(seed).integers(0, 255, shape).astype(TYPES[encoding])
    stamps = np.full(shape[0], stamp_ns)
    log = np.arange(shape[0], dtype=np.uint64) + 5
    records = image_records(3, frame_id, encoding, first_sequence=7, log_time_ns=log, stamp_ns=stamps, images=images)
    types, parse = typestore().types, ImageParser("/t")
    for k, record in enumerate(records):
        raw = record.tobytes()
        assert raw[:9] == b"\x05" + (len(raw) - 9).to_bytes(8, "little")
        assert raw[9:15] == b"\x03\x00" + (7 + k).to_bytes(4, "little")
        assert raw[15:31] == (5 + k).to_bytes(8, "little") * 2
        stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        expected = types[IMAGE](
            header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id),
            height=shape[1],
            width=shape[2],
            encoding=encoding,
            is_bigendian=0,
            step=shape[2] * images.itemsize,
            data=images[k].view(np.uint8).ravel(),
        )
        assert raw[31:] == bytes(typestore().serialize_cdr(expected, IMAGE))
        parsed_stamp, pixels = parse(memoryview(raw)[31:])
        assert parsed_stamp == stamp_ns
        np.testing.assert_array_equal(pixels, images[k])


@given(st.binary(max_size=80), st.integers(0, 90), st.integers(0, 255))
def test_no_bytes_make_the_parser_fail_otherwise(junk: bytes, at: int, value: int) -> None:
    image = np.arange(6, dtype=np.uint16).reshape(1, 2, 3)
    one = np.ones(1, dtype=np.uint64)
    valid = image_records(1, "f", "mono16", first_sequence=0, log_time_ns=one, stamp_ns=one.astype(int), images=image)
    changed = bytearray(valid[0].tobytes()[31:])
    changed[at % len(changed)] = value
    for data in (junk, bytes(changed), bytes(changed[: at % len(changed)])):
        try:
            _, pixels = ImageParser("/t")(memoryview(data))
        except DataError:
            continue
        assert pixels.nbytes <= len(data)


def test_a_changed_layout_is_seen_though_the_parser_remembers_the_last() -> None:
    one, parse = np.ones(1, dtype=np.uint64), ImageParser("/t")
    for shape in ((1, 2, 3), (1, 3, 2), (1, 2, 3)):
        image = np.arange(6, dtype=np.uint16).reshape(shape)
        raw = image_records(
            1, "f", "mono16", first_sequence=0, log_time_ns=one, stamp_ns=one.astype(int), images=image
        )
        np.testing.assert_array_equal(parse(memoryview(raw[0].tobytes())[31:])[1], image[0])


def test_a_foreign_encoding_is_named() -> None:
    types = typestore().types
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
    rgb = types[IMAGE](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
        height=1,
        width=1,
        encoding="rgb8",
        is_bigendian=0,
        step=3,
        data=np.zeros(3, dtype=np.uint8),
    )
    with pytest.raises(DataError, match=r"/t: .*encoding 'rgb8'; expected mono8"):
        ImageParser("/t")(memoryview(bytes(typestore().serialize_cdr(rgb, IMAGE))))
