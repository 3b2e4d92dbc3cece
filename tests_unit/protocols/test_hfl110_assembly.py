"""Frames from rows: whatever UDP does to the packets, no frame ever holds a row of another."""

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.protocols.frame_assembly import FrameAssembler
from arl_fixtures.protocols.hfl110 import Calibration, FrameEncoder, Hfl110Wire, decode_header

PERIOD_S, SPACING_S = 0.040, 0.0004
PIXELS = np.zeros((32, 128), np.uint16)


def stream(count, *, counts="frames", first=100):
    """Packets of `count` frames; the time stamp, which nobody uses as a key, tells the frame."""
    encoder = FrameEncoder(Hfl110Wire(packet_number_counts=counts), Calibration(fx=58.0))
    packets = []
    for index in range(count):
        rows = encoder.encode(
            frame_number=first + index, timestamp=index, intensity_counts=PIXELS, range_codes=PIXELS
        )
        packets += [(row, index * PERIOD_S + number * SPACING_S) for number, row in enumerate(rows)]
    return packets


def frame_of(payload):
    return decode_header(payload).timestamp


def check_unmixed(frames):
    for frame in frames:
        present = [row for row in frame.rows if row is not None]
        assert len({frame_of(row) for row in present}) == 1
        assert len(present) == frame.arrived
        for number, row in enumerate(frame.rows):
            assert row is None or decode_header(row).row_number == number


def assemble(packets, *, counts="frames", until_s=1e9):
    assembler = FrameAssembler(counts)
    frames = assembler.feed(packets) + assembler.expire(until_s)
    return frames, assembler.counts


@pytest.mark.parametrize("counts", ["frames", "packets", "unknown"])
def test_frames_in_order_are_complete(counts):
    frames, seen = assemble(stream(4, counts=counts), counts=counts)
    assert [frame.arrived for frame in frames] == [32] * 4
    assert [frame_of(frame.rows[0]) for frame in frames] == [0, 1, 2, 3]
    assert [round(frame.first_s / PERIOD_S) for frame in frames] == [0, 1, 2, 3]
    assert (seen.packets, seen.frames, seen.lost_rows, seen.late_packets) == (128, 4, 0, 0)


@pytest.mark.parametrize("counts", ["frames", "packets", "unknown"])
@pytest.mark.parametrize("lost", [0, 15, 31])
def test_a_lost_row_costs_that_row_only(counts, lost):
    packets = stream(3, counts=counts)
    del packets[32 + lost]
    frames, seen = assemble(packets, counts=counts)
    assert [frame.arrived for frame in frames] == [32, 31, 32]
    assert frames[1].rows[lost] is None
    assert (seen.lost_rows, seen.incomplete_frames) == (1, 1)
    check_unmixed(frames)


@pytest.mark.parametrize("counts", ["frames", "packets", "unknown"])
def test_exactly_one_frame_of_packets_lost_in_the_middle_mixes_nothing(counts):
    packets = stream(3, counts=counts)
    del packets[10 : 10 + 32]
    frames, _ = assemble(packets, counts=counts)
    check_unmixed(frames)
    assert [frame.arrived for frame in frames] == [10, 22, 32]


def test_a_row_that_comes_after_its_frame_was_delivered_is_dropped_and_counted():
    packets = stream(3)
    late = packets.pop(5)
    packets.insert(31 + 32 + 4, late)
    frames, seen = assemble(packets)
    assert [frame.arrived for frame in frames] == [31, 32, 32]
    assert seen.late_packets == 1
    check_unmixed(frames)


def test_a_row_that_comes_during_the_next_frame_still_counts():
    packets = stream(2)
    late = packets.pop(31)
    packets.insert(40, late)
    frames, seen = assemble(packets)
    assert [frame.arrived for frame in frames] == [32, 32]
    assert seen.late_packets == 0
    check_unmixed(frames)


def test_duplicates_are_dropped_and_counted():
    packets = stream(2)
    packets.insert(4, packets[3])
    frames, seen = assemble(packets)
    assert [frame.arrived for frame in frames] == [32, 32]
    assert seen.duplicates == 1


def test_an_incomplete_frame_is_given_up_after_the_time_out():
    assembler = FrameAssembler(timeout_s=0.060)
    packets = stream(1)[:20]
    assert assembler.feed(packets) == []
    last_s = packets[-1][1]
    assert assembler.expire(last_s + 0.059) == []
    (frame,) = assembler.expire(last_s + 0.061)
    assert (frame.arrived, frame.rows[20:]) == (20, [None] * 12)


def test_a_frame_entered_in_its_middle_is_marked_and_not_counted_as_loss():
    frames, seen = assemble(stream(2)[12:])
    assert [frame.cut for frame in frames] == [True, False]
    assert (seen.lost_rows, seen.frames) == (0, 1)


def test_reset_forgets_what_is_half_received():
    assembler = FrameAssembler()
    packets = stream(3)
    assembler.feed(packets[:50])
    assembler.reset()
    frames = assembler.feed(packets[60:])
    assert [(frame.cut, frame.arrived) for frame in frames] == [(True, 4), (False, 32)]
    assert assembler.counts.lost_rows == 0


def test_frames_that_never_came_are_counted():
    packets = stream(6)
    del packets[32 : 4 * 32]
    frames, seen = assemble(packets)
    assert [frame_of(frame.rows[0]) for frame in frames] == [0, 4, 5]
    assert seen.lost_frames == 3


def test_a_restart_of_the_sensor_is_no_loss():
    frames, seen = assemble(
        stream(2, first=5000) + [(payload, time_s + 3.0) for payload, time_s in stream(2, first=0)]
    )
    assert len(frames) == 4
    assert seen.lost_frames == 0


def test_a_sensor_that_restarts_early_counts_the_same_numbers_again():
    packets = stream(3)
    assembler = FrameAssembler()
    frames = assembler.feed(packets)
    frames += assembler.feed([(payload, time_s + 2.0) for payload, time_s in packets])
    assert [frame.arrived for frame in frames] == [32] * 6
    assert assembler.counts.late_packets == 0


def test_a_row_with_another_calibration_is_dropped():
    packets = stream(2)
    payload, time_s = packets[40]
    packets[40] = (payload[:22] + b"\xff" + payload[23:], time_s)
    frames, seen = assemble(packets)
    assert [frame.arrived for frame in frames] == [32, 31]
    assert seen.malformed == 1


def test_a_corrupt_first_row_does_not_condemn_the_others():
    packets = stream(2)
    payload, time_s = packets[32]
    packets[32] = (payload[:22] + b"\xff" + payload[23:], time_s)
    frames, _ = assemble(packets)
    assert [frame.arrived for frame in frames] == [32, 31]
    assert frames[1].rows[0] is None


def test_packets_of_other_length_or_row_are_counted_as_malformed():
    good = stream(1)
    bad_row = good[0][0][:16] + (32).to_bytes(4, "big") + good[0][0][20:]
    frames, seen = assemble([(b"", 0.0), (bytes(1371), 0.0), (bad_row, 0.0), *good])
    assert len(frames) == 1
    assert seen.malformed == 3


def test_garbage_in_the_number_field_cannot_fill_the_memory():
    assembler = FrameAssembler()
    packets = []
    for index, (payload, time_s) in enumerate(stream(20)):
        packets.append((payload[:12] + index.to_bytes(4, "big") + payload[16:], time_s))
    assembler.feed(packets)
    assert len(assembler._open) <= 8


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    lost=st.floats(0, 0.3),
    doubled=st.floats(0, 0.2),
    displacement=st.integers(0, 40),
    chunks=st.lists(st.integers(1, 70), max_size=10),
)
def test_shuffles_losses_duplicates_and_splits_never_mix_frames(seed, lost, doubled, displacement, chunks):
    rng = random.Random(seed)
    packets = [p for p in stream(6) if rng.random() >= lost for _ in range(1 + (rng.random() < doubled))]
    order = sorted(range(len(packets)), key=lambda index: index + rng.uniform(0, displacement))
    times = sorted(time_s for _, time_s in packets)
    packets = [(packets[index][0], time_s) for index, time_s in zip(order, times, strict=True)]
    assembler, frames, start = FrameAssembler(), [], 0
    for size in [*chunks, len(packets)]:
        frames += assembler.feed(packets[start : start + size])
        start += size
    frames += assembler.expire(1e9)
    check_unmixed(frames)
    seen = assembler.counts
    assert seen.packets == len(packets)
    assert sum(frame.arrived for frame in frames) + seen.duplicates + seen.late_packets == len(packets)
    assert len({frame.key for frame in frames}) == len(frames)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), lost=st.floats(0, 0.3), displacement=st.integers(0, 6))
def test_without_a_number_to_rely_on_losses_and_small_disorder_mix_nothing(seed, lost, displacement):
    rng = random.Random(seed)
    packets = [p for p in stream(6, counts="unknown") if rng.random() >= lost]
    by_frame = {}
    for payload, time_s in packets:
        by_frame.setdefault(frame_of(payload), []).append((payload, time_s))
    packets = []
    for rows in by_frame.values():
        order = sorted(range(len(rows)), key=lambda index: index + rng.uniform(0, displacement))
        packets += [(rows[index][0], time_s) for index, (_, time_s) in zip(order, rows, strict=True)]
    frames, _ = assemble(packets, counts="unknown")
    check_unmixed(frames)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.binary(max_size=40) | st.just(bytes(1372)) | st.just(b"\xff" * 1244), st.floats(0, 1))))
def test_garbage_never_crashes(packets):
    for counts in ("frames", "packets", "unknown"):
        frames, seen = assemble(packets, counts=counts)
        assert seen.packets == len(packets)
        assert all(0 < frame.arrived <= 32 for frame in frames)
