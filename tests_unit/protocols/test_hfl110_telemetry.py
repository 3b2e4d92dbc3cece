"""Telemetry: the vector of the protocol description, and what a strange serial number becomes."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.protocols.hfl110 import Hfl110Wire
from arl_fixtures.protocols.hfl110_telemetry import Telemetry, decode_telemetry, encode_telemetry

VECTOR = bytes.fromhex(
    "0000000300002642000019c2000003e8"
    "000040419a9941410000003f9a99193f"
    "9a99993f000020420000000000000000"
    "0000000000313030302d3031314c4648"
    "2d4e53"
)
SHOWN = Telemetry(
    serial="SN-HFL110-0001",
    hardware_revision=3,
    sensor_temperature_c=41.5,
    heater_temperature_c=38.25,
    frame_counter=1000,
    battery_switched_v=12.0,
    battery_v=12.1,
    heater_lens=0.5,
    heater_lens_high=0.6,
    lens=1.2,
    acquisition_period_ms=40.0,
)
WIRE = Hfl110Wire()


def test_vector_is_written():
    assert encode_telemetry(SHOWN, WIRE) == VECTOR


def test_vector_is_read():
    read = decode_telemetry(VECTOR, WIRE)
    assert read.serial == "SN-HFL110-0001"
    assert (read.hardware_revision, read.frame_counter, read.feedback) == (3, 1000, 0)
    assert (read.sensor_temperature_c, read.heater_temperature_c) == (41.5, 38.25)
    assert read.battery_v == struct.unpack("<f", struct.pack("<f", 12.1))[0]
    assert read.acquisition_period_ms == 40.0


def test_the_sign_of_the_heater_is_a_setting():
    assert decode_telemetry(VECTOR, Hfl110Wire(heater_sign=1)).heater_temperature_c == -38.25


@pytest.mark.parametrize("length", [0, 66, 68])
def test_other_lengths_are_refused(length):
    with pytest.raises(RemoteProtocolError, match=f"{length} bytes"):
        decode_telemetry(bytes(length), WIRE)


def test_a_serial_number_that_does_not_fit_is_our_fault():
    with pytest.raises(LocalProtocolError, match="26 bytes"):
        encode_telemetry(Telemetry(serial="x" * 27), WIRE)


@settings(deadline=None)
@given(st.binary(min_size=67, max_size=67))
def test_a_serial_number_is_always_printable(payload):
    serial = decode_telemetry(payload, WIRE).serial
    assert serial.isascii()
    assert serial == "" or serial.isprintable()


@settings(deadline=None)
@given(
    serial=st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=26), counter=st.integers(0, 2**32 - 1)
)
def test_round_trip(serial, counter):
    read = decode_telemetry(encode_telemetry(Telemetry(serial=serial, frame_counter=counter), WIRE), WIRE)
    assert (read.serial, read.frame_counter) == (serial, counter)
