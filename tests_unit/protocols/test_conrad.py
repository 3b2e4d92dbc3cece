from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.protocols import conrad
from arl_fixtures.protocols.conrad import Command, Frame

byte = st.integers(0, 255)


@pytest.mark.parametrize(
    ("frame", "data"),
    [
        (Frame(Command.SETUP, 1, 0), "01 01 00 00"),
        (Frame(0xFE, 1, 0x10), "FE 01 10 EF"),
        (Frame(Command.SETUP, 2, 0), "01 02 00 03"),
        (Frame(Command.GET_PORT, 1, 0), "02 01 00 03"),
        (Frame(0xFD, 1, 0x31), "FD 01 31 CD"),
        (Frame(Command.SET_PORT, 1, 0xA4), "03 01 A4 A6"),
        (Frame(0xFC, 1, 0), "FC 01 00 FD"),
        (Frame(Command.SET_SINGLE, 1, 1), "06 01 01 06"),
        (Frame(0xF9, 1, 1), "F9 01 01 F9"),
        (Frame(Command.DEL_SINGLE, 1, 1), "07 01 01 07"),
        (Frame(0xF8, 1, 1), "F8 01 01 F8"),
        (Frame(Command.TOGGLE, 1, 0x30), "08 01 30 39"),
        (Frame(0xF7, 1, 0x30), "F7 01 30 C6"),
    ],
)
def test_the_published_frames(frame: Frame, data: str):
    assert conrad.encode(frame) == bytes.fromhex(data)
    assert conrad.decode(bytes.fromhex(data)) == frame


@given(byte, byte, byte, st.integers(0, 3), st.integers(1, 255))
def test_a_changed_byte_is_noticed(command: int, address: int, data: int, place: int, change: int):
    sent = bytearray(conrad.encode(Frame(command, address, data)))
    assert conrad.decode(bytes(sent)) == (command, address, data)
    sent[place] ^= change
    assert conrad.decode(bytes(sent)) is None


@given(byte, st.binary(max_size=3).filter(lambda b: 0xFD not in b and 0x02 not in b))
def test_a_reply_is_found_behind_lost_bytes(port: int, before: bytes):
    received = before + conrad.encode(Frame(0xFD, 1, port))
    assert conrad.find_reply(received, Command.GET_PORT, 1) == Frame(0xFD, 1, port)
    assert conrad.find_reply(received[:-1], Command.GET_PORT, 1) is None
    assert conrad.find_reply(received, Command.GET_PORT, 9) is None


def test_a_frame_come_back_is_told_from_an_answer():
    returned = conrad.find_reply(conrad.encode(Frame(Command.GET_PORT, 1, 0)), Command.GET_PORT, 1)
    assert returned is not None
    assert returned.command == Command.GET_PORT


def test_the_board_complains_about_a_wrong_check_byte():
    assert conrad.find_error(bytes.fromhex("00 FF 01 00 FE"), 1) == Frame(conrad.ERROR, 1, 0)
    assert conrad.find_error(bytes.fromhex("FF 01 00 FF"), 1) is None


@given(st.integers(0, 5), st.binary(max_size=2), byte)
def test_set_up_ends_when_the_last_board_passed_it_on(boards: int, garbage: bytes, version: int):
    frames = [Frame(0xFE, 1 + n, version) for n in range(boards)]
    received = b"".join(conrad.encode(frame) for frame in (*frames, Frame(Command.SETUP, 1 + boards, 0)))
    assert conrad.find_setup_end(received, 1) == tuple(frames)
    assert conrad.find_setup_end(received[:-1], 1) is None
    found = conrad.find_setup_end(garbage + received, 1)
    assert found is not None
    assert found[-boards:] == tuple(frames) if boards else True


def test_a_lost_answer_does_not_shorten_the_chain():
    """The number after the last board tells that one is missing."""
    broken = bytearray(bytes.fromhex("FE 01 10 EF 01 02 00 03"))
    broken[3] ^= 1
    assert conrad.find_setup_end(bytes(broken), 1) is None


@pytest.mark.parametrize(("relay", "mask"), [(1, 0x01), (8, 0x80)])
def test_relays_are_bits(relay: int, mask: int):
    assert conrad.mask(relay) == mask


@pytest.mark.parametrize("relay", [0, 9])
def test_relays_that_do_not_exist(relay: int):
    with pytest.raises(LocalProtocolError):
        conrad.mask(relay)


def test_what_is_no_byte_is_refused():
    with pytest.raises(LocalProtocolError):
        conrad.encode(Frame(1, 256, 0))
