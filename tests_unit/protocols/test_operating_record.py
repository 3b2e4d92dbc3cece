"""The operating record: its documented bytes, and refusal of everything that is not one."""

import struct
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.protocols.operating_record import SIGNALS, OperatingRecord, decode_record, encode_record
from arl_fixtures.twin.operating import OperatingSettings, operating_data

RECORD = OperatingRecord(
    serial="SN-1", frame_counter=7, timestamp_us=1_000_000, values={"tec_current_a": 0.5, "rail_1v8_v": 1.75}
)


def test_bytes_are_those_of_the_description():
    body = (
        b"ARLO"
        + bytes.fromhex("0001")
        + b"SN-1".ljust(26, b"\0")
        + bytes.fromhex("00000007 00000000000f4240 0002 0010 3f000000 0041 3fe00000")
    )
    assert encode_record(RECORD) == body + struct.pack(">I", zlib.crc32(body))


def test_every_nominal_signal_has_a_number():
    values = operating_data(OperatingSettings(), 40.0)
    read = decode_record(encode_record(OperatingRecord(serial="S", frame_counter=0, timestamp_us=0, values=values)))
    assert read.values == pytest.approx(values, rel=1e-6)


@settings(deadline=None)
@given(
    serial=st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=26),
    counter=st.integers(0, 2**32 - 1),
    values=st.dictionaries(
        st.one_of(st.sampled_from(sorted(SIGNALS.values())), st.just("signal_60000")),
        st.floats(width=32, allow_nan=False),
        max_size=10,
    ),
)
def test_round_trip(serial, counter, values):
    record = OperatingRecord(serial=serial, frame_counter=counter, timestamp_us=5, values=values)
    assert decode_record(encode_record(record)) == record


@settings(deadline=None)
@given(st.integers(0, len(encode_record(RECORD)) - 1), st.integers(1, 255))
def test_one_wrong_byte_is_noticed(place, change):
    wrong = bytearray(encode_record(RECORD))
    wrong[place] ^= change
    with pytest.raises(RemoteProtocolError):
        decode_record(bytes(wrong))


@settings(deadline=None)
@given(st.binary(max_size=120))
def test_garbage_is_refused(payload):
    with pytest.raises(RemoteProtocolError):
        decode_record(payload)
    with pytest.raises(RemoteProtocolError):
        decode_record(b"ARLO\0\1" + payload)


@settings(deadline=None)
@given(st.integers(0, len(encode_record(RECORD)) - 1))
def test_a_record_cut_short_is_refused(length):
    with pytest.raises(RemoteProtocolError):
        decode_record(encode_record(RECORD)[:length])


def test_a_signal_without_a_number_is_our_fault():
    with pytest.raises(LocalProtocolError, match="'warp_core_v' has no number"):
        encode_record(OperatingRecord(serial="S", frame_counter=0, timestamp_us=0, values={"warp_core_v": 1.0}))
