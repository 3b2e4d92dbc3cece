"""A bench in a lab is the same bench: same bytes, same values, same times as inside one process."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.bench.build import open_bench
from arl_fixtures.bench.config import load_bench
from arl_fixtures.bench.sweep import sweep
from arl_fixtures.devices.port import Datagram
from arl_fixtures.errors import RemoteProtocolError
from arl_fixtures.lab.client import LabClient
from arl_fixtures.lab.datagrams import pack_datagrams, unpack_datagrams
from arl_fixtures.lab.framing import FrameBuffer, encode


def run_session(bench):
    """A little of everything a cycle does."""
    bench.start()
    bench.set_temperature_c = 30.0
    bench.soak(60.0)
    reading = bench.read()
    records = list(sweep(bench, [-3.0, 4.5], frames=2))
    faults = bench.close()
    return reading, records, faults


def test_a_session_in_the_lab_equals_one_inside_the_process(tmp_path):
    config = load_bench("emulated")
    reading, records, faults = run_session(open_bench(config))
    path = tmp_path / "lab.sock"
    command = [sys.executable, "-m", "arl_fixtures.lab", "--bench", "emulated", "--lab", str(path), "--grace", "60"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as lab:
        try:
            assert lab.stdout is not None
            assert str(path) in lab.stdout.readline()
            client = LabClient.connect(path, "test", role="driver")
            in_lab = run_session(open_bench(config, lines=client))
            state = client.inspect()["state"]
            client.close()
        finally:
            lab.terminate()
    assert lab.returncode == 0
    assert not path.exists()
    assert in_lab[0] == reading
    assert in_lab[2] == faults == []
    for ours, theirs in zip(records, in_lab[1], strict=True):
        assert (ours.time_ns, ours.stage_angle_deg) == (theirs.time_ns, theirs.stage_angle_deg)
        assert list(ours.blocks) == list(theirs.blocks)
        for serial, block in ours.blocks.items():
            np.testing.assert_array_equal(block.intensity_counts, theirs.blocks[serial].intensity_counts)
            np.testing.assert_array_equal(block.distance_m, theirs.blocks[serial].distance_m)
    assert not any(state[f"{load}_{n}"] for load in ("dut", "laser") for n in (1, 2, 3))
    assert state["setpoint_c"] == config.safe_temperature_c
    assert not state["stage_moving"]


def test_a_lab_says_in_one_line_what_is_wrong(tmp_path):
    command = [sys.executable, "-m", "arl_fixtures.lab", "--bench", "emulated", "--lab", str(tmp_path / "s")]
    command += ["--fault", "chiller:melted"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "unknown kind 'melted'" in done.stderr


messages = st.lists(
    st.tuples(st.dictionaries(st.text(max_size=5), st.integers() | st.text(max_size=9) | st.none()), st.binary()),
    max_size=5,
)


@given(messages, st.integers(1, 50))
def test_messages_survive_any_splitting(sent, piece):
    stream = b"".join(encode(header, payload) for header, payload in sent)
    buffer, received = FrameBuffer(), []
    for start in range(0, len(stream), piece):
        received += buffer.push(stream[start : start + piece])
    assert [tuple(message) for message in received] == sent


@pytest.mark.parametrize(
    "data",
    [b"\xff" * 8, b"\0\0\0\4\0\0\0\7", encode({})[:4] + b"\0\0\0\2[]", b"\0\0\0\6\0\0\0\2{x"],
)
def test_bytes_that_are_no_message_are_refused(data):
    with pytest.raises(RemoteProtocolError):
        FrameBuffer().push(data)


datagrams = st.lists(
    st.builds(Datagram, st.binary(max_size=40), st.just("127.0.0.11"), st.floats(0, 1e9, allow_nan=False)), max_size=6
)


@given(datagrams, st.integers(1, 20))
def test_bursts_survive_and_cut_ones_are_noticed(burst, cut):
    data = pack_datagrams(burst)
    assert unpack_datagrams(data) == burst
    if burst and cut < 13:
        with pytest.raises(RemoteProtocolError):
            unpack_datagrams(data[:-cut] if len(burst[-1].payload) >= cut else data[:-1])
