from __future__ import annotations

import contextlib
import dataclasses
import math
import resource
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from ruamel.yaml import YAML

from arl_fixtures.errors import DataError, StorageError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording import messages
from arl_fixtures.recording.bag_folder import BagFolder, BagReceipt, bag_sha256, verify
from arl_fixtures.recording.messages import DutTopics
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.names import topic_tokens
from arl_fixtures.recording.reader import StepBag, read_step
from arl_fixtures.recording.writer import StepBagWriter

MakeBag = Callable[[str], BagReceipt]


def assert_equal_bits(one: AngleBlock, other: AngleBlock) -> None:
    for item in dataclasses.fields(AngleBlock):
        left, right = getattr(one, item.name), getattr(other, item.name)
        if isinstance(left, np.ndarray):
            assert left.dtype == right.dtype
            assert left.shape == right.shape, item.name
            assert left.tobytes() == right.tobytes(), item.name
        else:
            assert repr(left) == repr(right), item.name


def assert_same_step(found: Sequence[AngleBlock], expected: Sequence[AngleBlock]) -> None:
    assert {each.dut for each in found} == {each.dut for each in expected}
    for dut in {each.dut for each in expected}:
        left, right = [each for each in found if each.dut == dut], [each for each in expected if each.dut == dut]
        for one, other in zip(left, right, strict=True):
            assert_equal_bits(one, other)


def test_a_step_reads_back_bit_for_bit(make_bag: MakeBag, metadata: StepMetadata, blocks: list[AngleBlock]) -> None:
    receipt = make_bag("step")
    read_metadata, read_blocks = read_step(receipt.path)
    assert read_metadata == metadata
    assert_same_step(list(read_blocks), blocks)


def test_bench_data_read_back(make_bag: MakeBag, blocks: list[AngleBlock]) -> None:
    bag = StepBag(make_bag("step").path)
    list(bag.blocks())
    assert [value for _, value in bag.temperatures_c["T2"]] == [24.9 + k for k in range(len(blocks))]
    assert all(math.isnan(value) for _, value in bag.temperatures_c["coolant"])
    assert [round(math.degrees(angle), 9) for _, angle in bag.stage] == [
        round(each.stage_angle_deg, 9) for each in blocks
    ]
    assert bag.camera_info["SN-1"].distortion[5] == 0.198
    assert bag.short == []


def test_rosbags_opens_it_and_finds_metres_counts_and_metadata(
    make_bag: MakeBag, metadata: StepMetadata, blocks: list[AngleBlock]
) -> None:
    receipt = make_bag("step")
    topics = DutTopics(topic_tokens(metadata.duts)["SN-1"])
    first = blocks[0]
    with AnyReader([receipt.path]) as reader:
        assert reader.message_count == receipt.message_count
        wanted = [connection for connection in reader.connections if connection.topic == topics.distance(1)]
        images = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages(wanted)]
        assert len(images) == 3 * 4
        metres = np.asarray(images[0].data).view(np.float32).reshape(images[0].height, images[0].width)
        np.testing.assert_array_equal(metres, first.distance_m[0, 0])
        assert images[0].header.stamp.sec * 10**9 + images[0].header.stamp.nanosec == first.time_ns[0]
        assert (images[0].encoding, images[0].header.frame_id) == ("32FC1", topics.frame_id)
        (operating,) = (each for each in reader.connections if each.topic == topics.operating)
        _, _, raw = next(iter(reader.messages([operating])))
        status = reader.deserialize(raw, operating.msgtype).status[0]
        assert (status.hardware_id, status.level) == ("SN-1", 0)
        assert {pair.key: pair.value for pair in status.values}["fpga_temperature_c"] == "0.30000000000000004"
    with Reader(receipt.path) as plain:
        assert all(connection.digest.startswith("RIHS01_") for connection in plain.connections)
    information = YAML(typ="safe").load(receipt.path / "metadata.yaml")["rosbag2_bagfile_information"]
    assert information["custom_data"] == metadata.to_custom_data()


def test_mcap_reads_it_with_checksums_and_index(make_bag: MakeBag) -> None:
    receipt = make_bag("step")
    with next(receipt.path.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == receipt.message_count
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert sum(summary.statistics.channel_message_counts.values()) == receipt.message_count
        assert all(index.message_index_offsets for index in summary.chunk_indexes)
        assert {record.name for record in reader.iter_metadata()} == {"arl", "rosbag2"}


def test_equal_input_gives_equal_bytes(make_bag: MakeBag, tmp_path: Path) -> None:
    one = make_bag("a/step")
    assert one.sha256 == make_bag("b/step").sha256 == bag_sha256(one.path)
    verify(one.path, one.sha256)


def test_a_changed_byte_is_found(make_bag: MakeBag) -> None:
    receipt = make_bag("step")
    file = next(receipt.path.glob("*.mcap"))
    data = bytearray(file.read_bytes())
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[-1]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(DataError, match=r"step: content differs from the journal"):
        verify(receipt.path, receipt.sha256)
    with pytest.raises(DataError, match=r"step_0\.mcap"):
        list(read_step(receipt.path)[1])


def test_while_written_it_bears_another_name(
    tmp_path: Path, metadata: StepMetadata, blocks: list[AngleBlock]
) -> None:
    writer = StepBagWriter(tmp_path / "step", metadata)
    writer.block(blocks[0])
    assert [path.name for path in tmp_path.iterdir()] == ["step.part"]
    with pytest.raises(DataError, match="is no whole bag"):
        StepBag(tmp_path / "step.part")
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["step"]


def test_an_error_in_the_sweep_leaves_no_bag_that_looks_whole(tmp_path: Path, metadata: StepMetadata) -> None:
    with pytest.raises(ZeroDivisionError), StepBagWriter(tmp_path / "step", metadata):
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["step.part"]
    assert not (tmp_path / "step.part" / "metadata.yaml").exists()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("bag ")]


@pytest.mark.parametrize("there", ["step", "step.part"])
def test_what_is_there_is_not_touched(there: str, tmp_path: Path, metadata: StepMetadata) -> None:
    (tmp_path / there).mkdir()
    (tmp_path / there / "precious").write_text("x")
    with pytest.raises(StorageError, match=r"not overwritten|unfinished bag is in the way"):
        StepBagWriter(tmp_path / "step", metadata)
    assert [path.name for path in (tmp_path / there).iterdir()] == ["precious"]


@contextlib.contextmanager
def files_no_larger_than(size_bytes: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("limit_bytes", [3_000, 30_000])
def test_a_disk_that_takes_no_more_is_one_clear_error(
    limit_bytes: int, tmp_path: Path, metadata: StepMetadata, make_block: Callable[..., AngleBlock]
) -> None:
    def sweep() -> None:
        with StepBagWriter(tmp_path / "step", metadata) as writer:
            for angle in range(400):
                writer.block(make_block("SN-1", angle, frames=40))
            writer.close()

    with (
        files_no_larger_than(limit_bytes),
        pytest.raises(StorageError, match=r"step_0\.mcap: cannot write: File too"),
    ):
        sweep()
    assert [path.name for path in tmp_path.iterdir()] == ["step.part"]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("bag ")]


def test_a_block_without_frames_keeps_its_shape(
    tmp_path: Path, metadata: StepMetadata, blocks: list[AngleBlock]
) -> None:
    empty = dataclasses.replace(
        blocks[0],
        angle_index=9,
        time_ns=blocks[0].time_ns[:0],
        intensity_counts=blocks[0].intensity_counts[:0],
        distance_m=blocks[0].distance_m[:0],
        row_valid=blocks[0].row_valid[:0],
    )
    with StepBagWriter(tmp_path / "step", metadata) as writer:
        for each in (blocks[0], empty, blocks[2]):
            writer.block(each)
    assert_same_step(list(read_step(tmp_path / "step")[1]), [blocks[0], empty, blocks[2]])


def test_a_clock_that_jumps_back_and_equal_stamps_change_nothing(
    tmp_path: Path, metadata: StepMetadata, blocks: list[AngleBlock]
) -> None:
    jumped = dataclasses.replace(blocks[2], time_ns=blocks[2].time_ns[::-1] - 10**12)
    frozen = dataclasses.replace(blocks[4], time_ns=np.full(4, int(blocks[0].time_ns[0])))
    with StepBagWriter(tmp_path / "step", metadata) as writer:
        for each in (blocks[0], jumped, frozen):
            writer.block(each)
    assert_same_step(list(read_step(tmp_path / "step")[1]), [blocks[0], jumped, frozen])
    with Reader(tmp_path / "step") as reader:
        times = [time_ns for _, time_ns, _ in reader.messages()]
    assert times == sorted(times)


def test_a_bag_resorted_by_log_time_still_reads_equal(
    make_bag: MakeBag, metadata: StepMetadata, blocks: list[AngleBlock], tmp_path: Path
) -> None:
    source = make_bag("step").path
    with Reader(source) as reader, BagFolder(tmp_path / "sorted", metadata.to_custom_data()) as folder:
        for connection, time_ns, data in reader.messages():
            channel = folder.topic(connection.topic, connection.msgtype)
            folder.file.message(channel, time_ns, data)
            folder.file.flush()
    assert_same_step(list(read_step(tmp_path / "sorted")[1]), blocks)


def test_records_that_another_writer_keeps_for_itself_are_passed_over(
    make_bag: MakeBag, blocks: list[AngleBlock]
) -> None:
    path = make_bag("step").path
    file = next(path.glob("*.mcap"))
    data = file.read_bytes()
    after_header = 8 + 9 + int.from_bytes(data[9:17], "little")
    file.write_bytes(data[:after_header] + b"\x81" + (5).to_bytes(8, "little") + b"hello" + data[after_header:])
    assert_same_step(list(read_step(path)[1]), blocks)


def test_a_missing_topic_is_named(make_bag: MakeBag, metadata: StepMetadata, tmp_path: Path) -> None:
    source = make_bag("step").path
    token = topic_tokens(metadata.duts)["SN_1"]
    with Reader(source) as reader, BagFolder(tmp_path / "less", metadata.to_custom_data()) as folder:
        for connection, time_ns, data in reader.messages():
            if connection.topic != f"/{token}/return1/distance":
                folder.file.message(folder.topic(connection.topic, connection.msgtype), time_ns, data)
    with pytest.raises(DataError, match=rf"less: topic /{token}/return1/distance of DUT 'SN_1' is missing"):
        list(read_step(tmp_path / "less")[1])


def test_a_dut_of_which_no_topic_is_there_is_named_once(
    make_bag: MakeBag, metadata: StepMetadata, tmp_path: Path
) -> None:
    source = make_bag("step").path
    token = topic_tokens(metadata.duts)["SN_1"]
    with Reader(source) as reader, BagFolder(tmp_path / "less", metadata.to_custom_data()) as folder:
        for connection, time_ns, data in reader.messages():
            if not connection.topic.startswith(f"/{token}/"):
                folder.file.message(folder.topic(connection.topic, connection.msgtype), time_ns, data)
    with pytest.raises(DataError, match=r"less: every topic of DUT 'SN_1' is missing$"):
        list(read_step(tmp_path / "less")[1])


def test_a_frame_whose_images_are_not_all_there_is_left_out_and_counted(
    make_bag: MakeBag, metadata: StepMetadata, blocks: list[AngleBlock], tmp_path: Path
) -> None:
    source = make_bag("step").path
    topics = DutTopics(topic_tokens(metadata.duts)["SN-1"])
    lost_ns = int(blocks[2].time_ns[1])
    with Reader(source) as reader, BagFolder(tmp_path / "holes", metadata.to_custom_data()) as folder:
        for connection, time_ns, data in reader.messages():
            if connection.topic != topics.intensity(1) or time_ns != lost_ns:
                folder.file.message(folder.topic(connection.topic, connection.msgtype), time_ns, data)
    bag = StepBag(tmp_path / "holes")
    found = [each for each in bag.blocks() if each.dut == "SN-1"]
    assert bag.short == [("SN-1", 1, 4, 3)]
    kept = [0, 2, 3]
    np.testing.assert_array_equal(found[1].time_ns, blocks[2].time_ns[kept])
    np.testing.assert_array_equal(found[1].distance_m, blocks[2].distance_m[kept])
    np.testing.assert_array_equal(found[1].intensity_counts, blocks[2].intensity_counts[kept])


def test_a_bag_of_the_library_with_metadata_in_yaml_only_is_read(
    make_bag: MakeBag, metadata: StepMetadata, blocks: list[AngleBlock], tmp_path: Path
) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    source = make_bag("step").path
    with Reader(source) as reader, Writer(tmp_path / "lib", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for key, value in metadata.to_custom_data().items():
            writer.set_custom_data(key, value)
        made = {}
        for connection, time_ns, data in reader.messages():
            if connection.topic not in made:
                made[connection.topic] = writer.add_connection(
                    connection.topic, connection.msgtype, typestore=messages.typestore()
                )
            writer.write(made[connection.topic], time_ns, data)
    assert_same_step(list(read_step(tmp_path / "lib")[1]), blocks)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"row_valid": np.ones((4, 7), dtype=np.bool_)}, "do not fit"),
        ({"distance_m": np.zeros((4, 2, 8, 16))}, "float32"),
        ({"time_ns": np.zeros(3, dtype=np.int64)}, r"expected \(3, 2, H, W\)"),
        ({"operating": {"frames": 1.0}}, "cannot be the name of a signal"),
        ({"dut": "other"}, "not one of this step's"),
    ],
)
def test_a_block_that_does_not_fit_is_refused(
    change: dict[str, object], said: str, tmp_path: Path, metadata: StepMetadata, blocks: list[AngleBlock]
) -> None:
    with pytest.raises(DataError, match=said), StepBagWriter(tmp_path / "step", metadata) as writer:
        writer.block(dataclasses.replace(blocks[0], **change))


def test_metadata_of_something_else_is_named(tmp_path: Path, metadata: StepMetadata) -> None:
    with BagFolder(tmp_path / "x", {"hello": "world"}) as folder:
        folder.topic("/a", messages.IMAGE)
    with pytest.raises(DataError, match="metadata key 'schema' is missing"):
        StepBag(tmp_path / "x")
    data = metadata.to_custom_data() | {"cycle": "many"}
    with pytest.raises(DataError, match="metadata cannot be read"):
        StepMetadata.from_custom_data(data, "x")


@pytest.mark.parametrize("name", ["nowhere", "file"])
def test_what_is_no_bag_is_said_to_be_none(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(DataError, match="is no whole bag"):
        read_step(tmp_path / name)
