from __future__ import annotations

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from arl_fixtures.errors import LocalProtocolError, RemoteProtocolError
from arl_fixtures.protocols import dcon
from arl_fixtures.protocols.dcon import Config, RangeFault, Value

OVER, UNDER = Value(None, RangeFault.OVER), Value(None, RangeFault.UNDER)
values = st.one_of(
    st.integers(-2700, 13720).map(lambda tenths: Value(tenths / 10.0, None)), st.sampled_from([OVER, UNDER])
)


@pytest.mark.parametrize(
    ("text", "check"),
    [
        ("$012", b"B7"),
        ("!01200600", b"AA"),
        ("#01", b"84"),
        ("$01M", b"D2"),
        ("!017018", b"52"),
        ("!010F0600", b"BE"),
        ("!010F0640", b"C2"),
        ("?01", b"A0"),
        ("#014", b"B8"),
        (">+0025.1+0024.9+0031.0+0045.5+9999.9+0000.0+0000.0+0000.0", b"DC"),
    ],
)
def test_the_published_checksums(text: str, check: bytes):
    assert dcon.encode(text, with_checksum=True) == text.encode() + check + b"\r"
    assert dcon.encode(text, with_checksum=False) == text.encode() + b"\r"


def test_the_published_reading():
    text = "+0025.1+0024.9+0031.0+0045.5+9999.9+0000.0+0000.0+0000.0"
    assert len(">" + text) == 57
    assert dcon.parse_values(text) == (
        *(Value(value_c, None) for value_c in (25.1, 24.9, 31.0, 45.5)),
        OVER,
        *(Value(0.0, None),) * 3,
    )


def test_a_broken_wire_reads_as_over_range_in_both_dialects():
    """ADAM's text is five characters without a point, so the channels after it are not where they were."""
    assert dcon.parse_values("+0025.1+9999+0031.0-0000-0012.5") == (
        Value(25.1, None), OVER, Value(31.0, None), UNDER, Value(-12.5, None),
    )  # fmt: skip
    assert dcon.parse_values("+0025.1+9999.9-9999.9-0000.0") == (Value(25.1, None), OVER, UNDER, Value(0.0, None))


@given(st.lists(values, min_size=1, max_size=8), st.sampled_from(["adam", "icp"]))
def test_values_survive_in_both_dialects(sent: list[Value], dialect: dcon.RangeDialect):
    text = "".join(dcon.format_value(value, dialect) for value in sent)
    assert dcon.parse_values(text) == tuple(sent)


def test_zero_is_never_written_as_under_range():
    assert dcon.format_value(Value(-0.04, None), "adam") == "+0000.0"


@pytest.mark.parametrize("value_c", [9999.0, -12345.6, None])
def test_values_that_do_not_fit_are_refused(value_c: float | None):
    with pytest.raises(LocalProtocolError):
        dcon.format_value(Value(value_c, None), "icp")


@pytest.mark.parametrize("text", ["", "25.1", "+25.1x", "+0025.1+", "01", "++1", "+0025.1 +0024.9"])
def test_what_is_no_reading_is_refused(text: str):
    with pytest.raises(RemoteProtocolError):
        dcon.parse_values(text)


texts = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=40)


@given(st.sampled_from(">!?"), texts, st.binary(max_size=20), st.booleans())
def test_a_reply_is_found_behind_garbage(lead: str, body: str, garbage: bytes, checked: bool):
    assume(b"\r" not in garbage)
    if not checked:
        # without checksum an answer can only be told by its lead character
        assume(not set(body) & set(">!?"))
    line = dcon.encode(lead + body, with_checksum=checked)
    found = dcon.find_replies(garbage + line, with_checksum=checked)
    if not any(byte in b">!?" for byte in garbage):
        assert found == [lead + body]
    assert dcon.find_replies(garbage + line[:-1], with_checksum=checked) == []


@given(st.sampled_from(">!?"), st.text(st.sampled_from("0123456789+-."), max_size=40), st.data())
def test_one_flipped_bit_never_passes_the_checksum(lead: str, body: str, data: st.DataObject):
    line = bytearray(dcon.encode(lead + body, with_checksum=True))
    place = data.draw(st.integers(0, len(line) - 4))
    line[place] ^= 1 << data.draw(st.integers(0, 6))
    assume(line[place] != 0x0D)
    assert not any(len(found) == len(lead + body) for found in dcon.find_replies(bytes(line), with_checksum=True))


@given(
    st.lists(st.text(st.sampled_from("#$%~0123456789ABCM"), min_size=1, max_size=10), max_size=4),
    st.booleans(),
    st.data(),
)
def test_requests_survive_any_split(requests: list[str], checked: bool, data: st.DataObject):
    sent = b"".join(dcon.encode(request, with_checksum=checked) for request in requests)
    buffer, heard = bytearray(), []
    while sent:
        count = data.draw(st.integers(1, len(sent)))
        buffer += sent[:count]
        sent = sent[count:]
        heard += dcon.take_requests(buffer, with_checksum=checked)
    assert heard == requests


def test_a_request_with_a_wrong_checksum_is_nothing():
    assert dcon.take_requests(bytearray(b"#0185\r#0184\r"), with_checksum=True) == ["#01"]


@given(st.binary(max_size=2000))
def test_noise_neither_blocks_nor_grows_the_buffer(noise: bytes):
    buffer = bytearray(noise)
    dcon.take_requests(buffer, with_checksum=True)
    assert len(buffer) <= 256
    buffer += b"\r" + dcon.encode("#01", with_checksum=True)
    assert dcon.take_requests(buffer, with_checksum=True)[-1] == "#01"


def test_the_published_configurations():
    assert dcon.parse_config("!010F0600", 1) == Config(dcon.TYPE_K, 6, 0)
    with_checksum = dcon.parse_config("!010F0640", 1)
    assert with_checksum.checksum
    assert with_checksum.engineering
    assert dcon.format_config(with_checksum, 1) == "!010F0640"
    with pytest.raises(RemoteProtocolError):
        dcon.parse_config("!020F0640", 1)


@pytest.mark.parametrize("text", ["", "#01\r", "#0°"])
def test_what_cannot_be_sent_is_refused(text: str):
    with pytest.raises(LocalProtocolError):
        dcon.encode(text, with_checksum=False)
