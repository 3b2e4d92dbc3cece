from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.errors import LocalProtocolError
from arl_fixtures.protocols import tmcl
from arl_fixtures.protocols.tmcl import Axis, Command, Reply, Request, StatusCode

byte = st.integers(0, 255)
values = st.integers(tmcl.VALUE_MIN, tmcl.VALUE_MAX)


@pytest.mark.parametrize(
    ("request_", "frame"),
    [
        (Request(1, Command.MOVE, 0, 0, 51200), "01 04 00 00 00 00 C8 00 CD"),
        (Request(1, Command.MOVE, 0, 0, -1000), "01 04 00 00 FF FF FC 18 17"),
        (Request(1, Command.MOVE, 1, 0, 12800), "01 04 01 00 00 00 32 00 38"),
        (Request(1, Command.STOP), "01 03 00 00 00 00 00 00 04"),
        (Request(1, Command.GET_AXIS, Axis.ACTUAL), "01 06 01 00 00 00 00 00 08"),
        (Request(1, Command.GET_AXIS, Axis.ACTUAL_SPEED), "01 06 03 00 00 00 00 00 0A"),
        (Request(1, Command.GET_AXIS, Axis.REACHED), "01 06 08 00 00 00 00 00 0F"),
        (Request(1, Command.GET_AXIS, Axis.ERROR_FLAGS), "01 06 CF 00 00 00 00 00 D6"),
        (Request(1, Command.GET_AXIS, Axis.DRIVER_FLAGS), "01 06 D0 00 00 00 00 00 D7"),
        (Request(1, Command.SET_AXIS, Axis.MAX_SPEED, 0, 51200), "01 05 04 00 00 00 C8 00 D2"),
        (Request(1, Command.SET_AXIS, Axis.ACTUAL, 0, 0), "01 05 01 00 00 00 00 00 07"),
        (Request(1, Command.REFERENCE_SEARCH, 0), "01 0D 00 00 00 00 00 00 0E"),
        (Request(1, Command.REFERENCE_SEARCH, 1), "01 0D 01 00 00 00 00 00 0F"),
        (Request(1, Command.REFERENCE_SEARCH, 2), "01 0D 02 00 00 00 00 00 10"),
        (Request(1, Command.GET_VERSION, 1), "01 88 01 00 00 00 00 00 8A"),
    ],
)
def test_the_published_requests(request_: Request, frame: str):
    assert tmcl.encode_request(request_) == bytes.fromhex(frame)
    assert tmcl.decode_request(bytes.fromhex(frame)) == request_


@pytest.mark.parametrize(
    ("reply", "frame"),
    [
        (Reply(2, 1, StatusCode.OK, Command.MOVE, 51200), "02 01 64 04 00 00 C8 00 33"),
        (Reply(2, 1, StatusCode.OK, Command.GET_AXIS, -1000), "02 01 64 06 FF FF FC 18 7F"),
        (Reply(2, 1, StatusCode.WRONG_CHECKSUM, Command.MOVE, 0), "02 01 01 04 00 00 00 00 08"),
        (Reply(2, 1, StatusCode.INVALID_VALUE, Command.MOVE, 0), "02 01 04 04 00 00 00 00 0B"),
    ],
)
def test_the_published_replies(reply: Reply, frame: str):
    assert tmcl.encode_reply(reply) == bytes.fromhex(frame)
    assert tmcl.find_reply(bytes.fromhex(frame), host=2, module=1, command=reply.command) == reply


@given(byte, byte, byte, byte, values)
def test_requests_survive(module: int, command: int, kind: int, motor: int, value: int):
    request = Request(module, command, kind, motor, value)
    assert tmcl.decode_request(tmcl.encode_request(request)) == request


@given(values, st.integers(0, 8), st.integers(1, 255))
def test_a_changed_byte_is_noticed(value: int, place: int, change: int):
    frame = bytearray(tmcl.encode_request(Request(1, Command.MOVE, 0, 0, value)))
    frame[place] ^= change
    assert tmcl.decode_request(bytes(frame)) is None


@given(values, st.binary(max_size=12), st.binary(max_size=12))
def test_a_reply_is_found_between_garbage(value: int, before: bytes, after: bytes):
    reply = Reply(2, 1, StatusCode.OK, Command.GET_AXIS, value)
    received = before + tmcl.encode_reply(reply) + after
    found = tmcl.find_reply(received, host=2, module=1, command=Command.GET_AXIS)
    # garbage may itself be a frame, but only if every field and the checksum fit by chance
    assert found is not None
    assert found == reply or tmcl.encode_reply(found) in received


@given(values, st.integers(0, 8))
def test_a_cut_reply_is_no_reply(value: int, length: int):
    frame = tmcl.encode_reply(Reply(2, 1, StatusCode.OK, Command.GET_AXIS, value))
    assert tmcl.find_reply(frame[:length], host=2, module=1, command=Command.GET_AXIS) is None


def test_replies_of_others_are_skipped():
    other_module = tmcl.encode_reply(Reply(2, 3, StatusCode.OK, Command.GET_AXIS, 7))
    other_command = tmcl.encode_reply(Reply(2, 1, StatusCode.OK, Command.MOVE, 7))
    event = tmcl.encode_reply(Reply(2, 1, StatusCode.REACHED, Command.GET_AXIS, 7))
    ours = tmcl.encode_reply(Reply(2, 1, StatusCode.OK, Command.GET_AXIS, 8))
    received = other_module + other_command + event + ours
    found = tmcl.find_reply(received, host=2, module=1, command=Command.GET_AXIS)
    assert found is not None
    assert found.value == 8


def test_a_wanted_value_tells_two_replies_apart():
    received = b"".join(tmcl.encode_reply(Reply(2, 1, StatusCode.OK, Command.SET_GLOBAL, n)) for n in (1, 2))
    found = tmcl.find_reply(received, host=2, module=1, command=Command.SET_GLOBAL, value=2)
    assert found is not None
    assert found.value == 2
    assert tmcl.find_reply(received, host=2, module=1, command=Command.SET_GLOBAL, value=3) is None


def test_both_forms_of_the_version():
    text = tmcl.encode_version_text(2, "1240V105")
    assert len(text) == tmcl.FRAME_BYTES
    assert tmcl.find_version_text(b"\xff" + text, host=2) == "1240V105"
    assert tmcl.find_version_text(text[:-1], host=2) is None
    assert tmcl.decode_version(tmcl.encode_version(1240, 1, 5)) == (1240, 1, 5)
    with pytest.raises(LocalProtocolError):
        tmcl.encode_version_text(2, "1240V1.05")


def test_what_does_not_fit_is_refused():
    with pytest.raises(LocalProtocolError):
        tmcl.encode_request(Request(1, 4, 0, 0, 2**31))
    with pytest.raises(LocalProtocolError):
        tmcl.encode_request(Request(256, 4))
    with pytest.raises(LocalProtocolError):
        tmcl.decode_request(b"short")
