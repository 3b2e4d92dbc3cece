from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.protocols import huber_pb as pb
from arl_fixtures.protocols.huber_pb import Address, Request, Status

words = st.integers(0, 0xFFFF)
addresses = st.integers(0, 0xFF)


def test_the_published_bytes():
    assert pb.encode_request(Address.SETPOINT) == bytes.fromhex("7B 4D 30 30 2A 2A 2A 2A 0D 0A")
    assert pb.encode_reply(Address.SETPOINT, pb.encode_temperature(25.0)) == b"{S0009C4\r\n"


@pytest.mark.parametrize(
    ("temperature_c", "word"),
    [(25.0, 0x09C4), (-20.0, 0xF830), (-23.15, 0xF6F5), (-40.0, 0xF060), (85.0, 0x2134), (19.99, 0x07CF)],
)
def test_temperatures_are_rounded_hundredths(temperature_c: float, word: int):
    assert pb.encode_temperature(temperature_c) == word
    assert pb.decode_temperature(word) == pytest.approx(temperature_c, abs=1e-9)


def test_temperatures_beyond_the_signed_range_are_unsigned():
    assert pb.decode_temperature(round(400.0 * 100)) == 400.0
    assert pb.decode_temperature(0xC4F9) == -151.11


@pytest.mark.parametrize("word", [0x7FFF, 0xC504])
def test_words_without_a_value(word: int):
    assert pb.decode_temperature(word) is None


@pytest.mark.parametrize("temperature_c", [327.67, -151.0, -151.2, 500.1])
def test_temperatures_that_cannot_be_sent(temperature_c: float):
    with pytest.raises(LocalProtocolError):
        pb.encode_temperature(temperature_c)


@given(st.integers(-15111, 50000))
def test_every_temperature_survives(hundredths: int):
    try:
        word = pb.encode_temperature(hundredths / 100.0)
    except LocalProtocolError:
        assert hundredths & 0xFFFF in (pb.NOT_AVAILABLE, pb.SENSOR_MISSING)
        return
    decoded_c = pb.decode_temperature(word)
    assert decoded_c is not None
    assert round(decoded_c * 100.0) == hundredths


@given(addresses, words)
def test_a_reply_is_found_in_garbage_and_by_its_address_only(address: int, word: int):
    reply = pb.encode_reply(address, word)
    other = pb.encode_reply(address ^ 1, word ^ 1)
    assert pb.find_reply(b"\x00{S0" + other + b"xy" + reply + b"{S", address) == word
    assert pb.find_reply(other, address) is None
    assert pb.find_reply(reply[:-1], address) is None


def test_replies_may_be_in_lower_case():
    assert pb.find_reply(b"{S0aff0c\r\n", 0x0A) == 0xFF0C


@given(st.lists(st.tuples(addresses, st.none() | words), max_size=5), st.data())
def test_requests_survive_any_split(requests: list[tuple[int, int | None]], data: st.DataObject):
    sent = b"".join(pb.encode_request(*request) for request in requests)
    buffer, heard = bytearray(), []
    while sent:
        count = data.draw(st.integers(1, len(sent)))
        buffer += sent[:count]
        sent = sent[count:]
        heard += pb.take_requests(buffer)
    assert heard == [Request(*request) for request in requests]
    assert not buffer


@pytest.mark.parametrize(
    "line", [b"{M0009C\r\n", b"{M00***\r\n", b"{m00****\r\n", b"{M00****\n", b"{S00****\r\n", b"{M0G0000\r\n"]
)
def test_malformed_requests_are_nothing(line: bytes):
    assert pb.take_requests(bytearray(line)) == []


@given(st.binary(max_size=200))
def test_noise_is_no_request_and_does_not_block_the_next(noise: bytes):
    buffer = bytearray(noise)
    pb.take_requests(buffer)
    buffer += b"\r\n" + pb.encode_request(0x16, 1)
    assert pb.take_requests(buffer)[-1] == Request(0x16, 1)


@given(st.integers(0, 0x7FFF), st.sampled_from(["lsb", "msb16", "msb15"]))
def test_status_bits_survive_every_order(bits: int, order: pb.StatusBitOrder):
    assert pb.decode_status(pb.encode_status(Status(bits), order), order) == bits


def test_status_bit_zero_is_where_the_order_says():
    assert pb.encode_status(Status.CONTROLLING, "lsb") == 0x0001
    assert pb.encode_status(Status.CONTROLLING, "msb16") == 0x8000
    assert pb.encode_status(Status.CONTROLLING, "msb15") == 0x4000


@given(st.integers(0, 2**32 - 1), st.sampled_from(["1b_high", "1c_high"]))
def test_serial_numbers_survive_both_orders(serial: int, order: pb.SerialWordOrder):
    assert pb.decode_serial(*pb.encode_serial(serial, order), order) == serial


def test_serial_words_are_swapped_between_the_orders():
    assert pb.encode_serial(0x0001_0002, "1b_high") == (1, 2)
    assert pb.encode_serial(0x0001_0002, "1c_high") == (2, 1)
