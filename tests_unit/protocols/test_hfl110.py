"""Frame packets: the vectors of the protocol description, both layouts, and round trips."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.protocols.hfl110 import (
    PACKETS,
    Calibration,
    FrameEncoder,
    Hfl110Wire,
    PixelFlag,
    decode_frames,
    decode_header,
    layout_of,
)

HEADER = bytes.fromhex(
    "00010001010203040506070800000007"
    "00000000000068420000704200007e42"
    "00007841000000000000000000000000"
    "000000000000803e0000000000000000"
    "0000003f00000000000000000000803e"
    "000000000000803f00000000"
)
CALIBRATION = Calibration(fx=58, fy=60, cx=63.5, cy=15.5, r4=0.25, mount_yaw_rad=0.5, mount_z_m=0.25, mount_x_m=1.0)
WIRE = Hfl110Wire()
OLD = Hfl110Wire(layout="0.0.20")


def random_frame(seed=0):
    rng = np.random.default_rng(seed)
    return rng.integers(0, 4096, (32, 128), np.uint16), rng.integers(0, 0x3101, (32, 128), np.uint16)


def encode(wire=WIRE, number=7, seed=0, **more):
    intensity, codes = random_frame(seed)
    return FrameEncoder(wire, CALIBRATION).encode(
        frame_number=number, timestamp=0x0102030405060708, intensity_counts=intensity, range_codes=codes, **more
    )


def row(pixel_bytes=b"", offset=92, length=1372):
    packet = bytearray(HEADER.ljust(length, b"\0"))
    packet[offset : offset + len(pixel_bytes)] = pixel_bytes
    return bytes(packet)


def test_lengths_and_offsets_are_those_of_the_description():
    new, old = PACKETS["0.1.0"], PACKETS["0.0.20"]
    assert (new.itemsize, old.itemsize) == (1372, 1244)
    offsets = {name: new.fields[name][1] for name in ("packet_number", "row_number", "fx", "r4", "status")}
    assert offsets == {"packet_number": 12, "row_number": 16, "fx": 20, "r4": 52, "status": 88}
    assert [new.fields[name][1] for name in ("ranges", "intensities", "flags")] == [92, 604, 1244]
    assert old.fields["flags"][1] == 1116


def test_header_vector_is_written():
    assert encode()[0][:92] == HEADER


def test_header_vector_is_read():
    header = decode_header(HEADER.ljust(1372, b"\0"))
    assert header.calibration == CALIBRATION
    assert (header.udp_version, header.pca_version, header.status) == (1, 1, 0)
    assert header.timestamp == 0x0102030405060708
    assert (header.packet_number, header.row_number, header.layout) == (7, 0, "0.1.0")


@pytest.mark.parametrize(
    ("code", "metres"),
    [("0080", 0.5), ("0100", 1.0), ("0a00", 10.0), ("3100", 49.0), ("3101", None), ("ffff", None), ("0000", 0.0)],
)
def test_range_vectors(code, metres):
    frames = decode_frames([row(bytes.fromhex(code))] + [row()] * 31, WIRE)
    value = frames.distance_m[0, 0, 31, 0]
    assert np.isnan(value) if metres is None else value == metres


def test_pixels_lie_where_the_parsing_code_reads_them():
    pixels = bytes.fromhex("0100020003000400")
    frames = decode_frames([row(pixels), *[row()] * 30, row(pixels, offset=604)], WIRE)
    assert frames.distance_m[0, :, 31, :2].tolist() == [[1.0, 3.0], [2.0, 4.0]]
    assert frames.intensity_counts[0, :, 0, :2].tolist() == [[256, 768], [512, 1024]]


def test_row_zero_is_the_bottom_of_the_image():
    rows = [row((number * 256).to_bytes(2, "big")) for number in range(32)]
    assert decode_frames(rows, WIRE).distance_m[0, 0, :, 0].tolist() == list(range(31, -1, -1))


@pytest.mark.parametrize("wire", [WIRE, OLD], ids=["0.1.0", "0.0.20"])
def test_frames_come_back_as_they_went(wire):
    flags = np.random.default_rng(9).integers(0, 256, (32, 128), np.uint8)
    rows = encode(wire, seed=1, flags=flags) + encode(wire, number=8, seed=2, flags=flags)
    frames = decode_frames(rows, wire)
    for index, seed in enumerate((1, 2)):
        intensity, codes = random_frame(seed)
        assert np.array_equal(frames.intensity_counts[index, 0], intensity)
        assert np.array_equal(frames.distance_m[index, 0], (codes / 256).astype(np.float32))
        assert not frames.intensity_counts[index, 1].any()
        assert np.isnan(frames.distance_m[index, 1]).all()
        assert np.array_equal(frames.flags[index], flags)
    assert frames.row_valid.all()
    assert {layout_of(payload) for payload in rows} == {wire.layout}


def test_both_returns_are_carried_and_do_not_stay_for_the_next_frame():
    encoder = FrameEncoder(WIRE, CALIBRATION)
    first, second = random_frame(3), random_frame(4)
    both = encoder.encode(
        frame_number=1,
        timestamp=0,
        intensity_counts=np.stack([first[0], second[0]]),
        range_codes=np.stack([first[1], second[1]]),
    )
    frames = decode_frames(both, WIRE)
    assert np.array_equal(frames.intensity_counts[0], np.stack([first[0], second[0]]))
    one = encoder.encode(frame_number=2, timestamp=0, intensity_counts=first[0], range_codes=first[1])
    assert np.isnan(decode_frames(one, WIRE).distance_m[0, 1]).all()


def test_missing_rows_are_masked_and_only_these():
    rows: list[bytes | None] = list(encode(seed=5))
    rows[0] = rows[20] = None
    frames = decode_frames(rows, WIRE)
    assert np.flatnonzero(~frames.row_valid[0]).tolist() == [11, 31]
    assert np.isnan(frames.distance_m[0, :, 11]).all()
    assert not frames.intensity_counts[0, :, 31].any()
    intensity, _ = random_frame(5)
    kept = frames.row_valid[0]
    assert np.array_equal(frames.intensity_counts[0, 0, kept], intensity[kept])
    assert frames.corrupt_rows == 0


def test_rows_with_impossible_intensities_are_masked_and_counted():
    rows = encode(seed=5)
    rows[4] = rows[4][:700] + b"\xff\xfe" + rows[4][702:]
    frames = decode_frames(rows, WIRE)
    assert frames.corrupt_rows == 1
    assert np.flatnonzero(~frames.row_valid[0]).tolist() == [27]


def test_layouts_may_even_be_mixed_in_one_frame():
    rows = encode(WIRE, seed=6)[:16] + encode(OLD, seed=6)[16:]
    frames = decode_frames(rows, WIRE)
    assert np.array_equal(frames.intensity_counts[0, 0], random_frame(6)[0])
    assert frames.row_valid.all()


def test_disputed_facts_are_settings():
    wire = Hfl110Wire(no_return_code=0, range_offset_m=-0.5, range_limit_m=20.0)
    frames = decode_frames([row(bytes.fromhex("00000000020000001500"))] + [row()] * 31, wire)
    assert np.isnan(frames.distance_m[0, 0, 31, 0])
    assert frames.distance_m[0, 0, 31, 1] == pytest.approx(1.5)
    assert np.isnan(frames.distance_m[0, 0, 31, 2])


def test_packet_numbers_may_count_packets():
    numbers = [
        decode_header(payload).packet_number
        for payload in encode(Hfl110Wire(packet_number_counts="packets"), number=2**27)
    ]
    assert numbers == list(range(32))


@pytest.mark.parametrize("length", [0, 91, 1116, 1243, 1245, 1371, 1373])
def test_other_lengths_are_refused(length):
    with pytest.raises(RemoteProtocolError, match=f"{length} bytes"):
        decode_header(bytes(length))
    with pytest.raises(RemoteProtocolError, match=f"{length} bytes"):
        decode_frames([bytes(length)] * 32, WIRE)


def test_a_row_beyond_the_image_is_refused():
    packet = bytearray(HEADER.ljust(1372, b"\0"))
    packet[16:20] = (32).to_bytes(4, "big")
    with pytest.raises(RemoteProtocolError, match="row 32"):
        decode_header(bytes(packet))


def test_what_cannot_be_encoded_is_our_fault():
    with pytest.raises(LocalProtocolError, match="32 x 128"):
        FrameEncoder(WIRE, CALIBRATION).encode(
            frame_number=0,
            timestamp=0,
            intensity_counts=np.zeros((16, 128), np.uint16),
            range_codes=np.zeros((16, 128), np.uint16),
        )
    with pytest.raises(LocalProtocolError, match="32 rows"):
        decode_frames([None] * 31, WIRE)


def test_flag_bits():
    assert PixelFlag.CROSSTALK | PixelFlag.SATURATED | PixelFlag.SUPERIMPOSED == 0b1011


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), missing=st.sets(st.integers(0, 31)), length=st.sampled_from([1372, 1244]))
def test_garbage_of_the_right_length_never_crashes(seed, missing, length):
    rng = np.random.default_rng(seed)
    rows = [None if index in missing else rng.bytes(length) for index in range(32)]
    frames = decode_frames(rows, WIRE)
    valid = frames.row_valid[0]
    assert frames.corrupt_rows + len(missing) + valid.sum() == 32
    assert frames.intensity_counts.max() <= WIRE.full_counts
    assert np.nanmax(np.append(frames.distance_m, 0)) <= 49.0
