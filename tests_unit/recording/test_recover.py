from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording.bag_folder import BagReceipt, verify
from arl_fixtures.recording.messages import typestore
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.recover import recover
from arl_fixtures.recording.scan import McapScan

Item = tuple[str, int, bytes]


class Whole:
    """A whole bag, what is in it, and where its chunks end."""

    def __init__(self, path: Path) -> None:
        self.file = next(path.glob("*.mcap"))
        self.data = self.file.read_bytes()
        self.items = [(m.topic, m.log_time_ns, bytes(m.data)) for m in McapScan(self.file).messages()]
        with self.file.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        self.chunks = sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset)

    def messages_in_whole_chunks(self, size: int) -> int:
        """By the library's own reader, from the chunks that lie wholly in the first `size` bytes."""
        with self.file.open("rb") as stream:
            chunks = [
                record for record in StreamReader(stream, emit_chunks=True).records if isinstance(record, Chunk)
            ]
        ends = [chunk.chunk_start_offset + chunk.chunk_length for chunk in self.chunks]
        return sum(
            isinstance(record, Message)
            for chunk, end in zip(chunks, ends, strict=True)
            if end <= size
            for record in breakup_chunk(chunk)
        )


def items_of(path: Path) -> list[Item]:
    with Reader(path) as reader:
        return [(connection.topic, time_ns, bytes(data)) for connection, time_ns, data in reader.messages()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, wide_bag: Callable[[Path], BagReceipt]) -> Whole:
    return Whole(wide_bag(tmp_path_factory.mktemp("whole") / "step").path)


def check_cut(whole: Whole, size: int, folder: Path) -> None:
    part = folder / f"cut{size}.part"
    part.mkdir()
    (part / "step_0.mcap").write_bytes(whole.data[:size])
    if size < whole.chunks[0].chunk_start_offset + 100:
        with pytest.raises(DataError, match=r"nothing to recover|is no MCAP file"):
            recover(part)
        assert [path.name for path in folder.iterdir()] == [part.name]
        return
    try:
        report = recover(part)
    except DataError:
        # of the first chunk nothing decodes yet
        assert size < whole.chunks[0].chunk_start_offset + whole.chunks[0].chunk_length
        return
    assert report.path == folder / f"cut{size}.recovered"
    found = items_of(report.path)
    kept = len(found)
    assert kept == sum(report.messages.values())
    assert sorted(found) == sorted(whole.items[:kept]), "what is kept is the recording from its start, without a gap"
    assert kept >= whole.messages_in_whole_chunks(size)
    verify(report.path, report.sha256)
    bag = StepBag(report.path)
    assert bag.metadata.recovered
    assert (kept == len(whole.items)) or report.fault
    list(bag.blocks())


def test_a_cut_at_each_boundary_keeps_every_complete_message(whole: Whole, tmp_path: Path) -> None:
    ends = [chunk.chunk_start_offset + chunk.chunk_length for chunk in whole.chunks]
    sizes = {end + d for end in [8, ends[0], ends[-1], len(whole.data)] for d in (-1, 0, 1)} & set(
        range(len(whole.data) + 1)
    )
    for size in sorted(sizes):
        folder = tmp_path / str(size)
        folder.mkdir()
        check_cut(whole, size, folder)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_cut_at_any_byte_keeps_every_complete_message(
    whole: Whole, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    check_cut(whole, data.draw(st.integers(0, len(whole.data))), tmp_path_factory.mktemp("cut"))


def test_within_a_cut_chunk_the_messages_that_decode_are_kept(whole: Whole, tmp_path: Path) -> None:
    large = max(whole.chunks, key=lambda chunk: chunk.uncompressed_size)
    size = large.chunk_start_offset + large.chunk_length - 100
    check_cut(whole, size, tmp_path)
    assert len(items_of(tmp_path / f"cut{size}.recovered")) > whole.messages_in_whole_chunks(size)


@pytest.mark.parametrize("compression", CompressionType)
def test_a_cut_file_of_another_writer_gives_what_decodes(
    compression: CompressionType, whole: Whole, metadata: StepMetadata, tmp_path: Path
) -> None:
    path = tmp_path / "other.mcap"
    writer = Writer(str(path), compression=compression, chunk_size=10**9)
    writer.start("ros2")
    writer.add_metadata("arl", metadata.to_custom_data())
    channels: dict[str, int] = {}
    for message in McapScan(whole.file).messages():
        if message.topic not in channels:
            definition, _ = typestore().generate_msgdef(message.msgtype, ros_version=2)
            schema = writer.register_schema(message.msgtype, "ros2msg", definition.encode())
            channels[message.topic] = writer.register_channel(message.topic, "cdr", schema)
        writer.add_message(channels[message.topic], message.log_time_ns, bytes(message.data), message.log_time_ns)
    writer.finish()

    assert sorted(items_of(recover(path, tmp_path / "all").path)) == sorted(whole.items)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found = items_of(recover(path, tmp_path / "half").path)
    assert len(whole.items) / 4 < len(found) < len(whole.items)
    assert sorted(found) == sorted(whole.items[: len(found)])


def test_zeros_that_a_blackout_leaves_behind_are_no_messages(whole: Whole, tmp_path: Path) -> None:
    size = whole.chunks[-1].chunk_start_offset
    path = tmp_path / "step_0.mcap"
    path.write_bytes(whole.data[:size] + bytes(4096))
    report = recover(path)
    assert f"no record at byte {size}" in report.fault
    assert sorted(items_of(report.path)) == sorted(whole.items[: sum(report.messages.values())])


@given(data=st.data())
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_damage_makes_it_fail_otherwise(
    small_bag: bytes, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("bad")
    damaged = bytearray(small_bag)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    (folder / "x.mcap").write_bytes(damaged)
    with contextlib.suppress(DataError):
        report = recover(folder / "x.mcap", folder / "out")
        assert len(items_of(report.path)) == sum(report.messages.values())


def test_a_recovered_step_gives_the_angles_that_were_finished(
    whole: Whole, metadata: StepMetadata, wide_blocks: list[AngleBlock], tmp_path: Path
) -> None:
    third = whole.chunks[2]
    path = tmp_path / "step_0.mcap"
    path.write_bytes(whole.data[: third.chunk_start_offset + third.chunk_length + 10])
    bag = StepBag(recover(path).path)
    found = list(bag.blocks())
    assert bag.metadata.step_id == metadata.step_id
    assert len(found) == 3
    for one, other in zip(found, wide_blocks, strict=False):
        np.testing.assert_array_equal(one.distance_m, other.distance_m)
        assert (one.dut, one.angle_index, one.stage_angle_deg) == (
            other.dut,
            other.angle_index,
            other.stage_angle_deg,
        )


def test_a_cut_bag_is_named_by_the_reader(whole: Whole, tmp_path: Path) -> None:
    folder = tmp_path / "step"
    folder.mkdir()
    (folder / "metadata.yaml").write_bytes((whole.file.parent / "metadata.yaml").read_bytes())
    (folder / "step_0.mcap").write_bytes(whole.data[:-40])
    with pytest.raises(DataError, match=r"step_0\.mcap: is cut short: its index.*arl recover"):
        list(StepBag(folder).blocks())


def test_what_cannot_be_recovered_is_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such folder"):
        recover(tmp_path / "nowhere")
    with pytest.raises(DataError, match="0 MCAP files"):
        recover(tmp_path)
    (tmp_path / "x.mcap").write_text("not a bag at all")
    with pytest.raises(DataError, match="is no MCAP file"):
        recover(tmp_path / "x.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap"]
