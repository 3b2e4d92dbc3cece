"""Live and from a bag, a step's values are the same to the last bit."""

from __future__ import annotations

import math
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from simulated_sweep import SimulatedBench

from arl_fixtures.metrics.collect import collect
from arl_fixtures.metrics.nominal import nominal_reference
from arl_fixtures.metrics.registry import measure
from arl_fixtures.metrics.statistics import SweepStatistics
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.writer import StepBagWriter
from arl_fixtures.twin.settings import DutSettings

METADATA = StepMetadata(
    campaign="test",
    cycle=0,
    step=0,
    step_id="c0000-00-up+25C",
    attempt=1,
    set_temperature_c=25.0,
    ramp=1,
    started_utc_ns=0,
    duts=("SN-3",),
    software_version="0",
    bench_sha256="",
    profile_sha256="",
    limits_sha256="",
)


@pytest.fixture(scope="module")
def bench():
    # every second angle: half the bytes, and still every pixel passes every target
    return SimulatedBench(DutSettings(serial="SN-3"), angles_deg=tuple(-60.0 + 1.8 * k for k in range(67)))


def test_values_from_the_bag_are_those_of_the_sweep(bench, tmp_path):
    blocks = list(bench.blocks(1))
    with StepBagWriter(tmp_path / "bag", METADATA) as bag:
        for block in blocks:
            bag.block(block)
        bag.close()

    def values(source):
        sweep = collect(source, ["SN-3"]).statistics["SN-3"].summary()
        return [asdict(one) for one in measure(bench.step(sweep=sweep, reference=reference))]

    reference = nominal_reference(bench.geometry.at(bench.sweep(2).stage_angle_deg))
    live, recorded = values(blocks), values(StepBag(tmp_path / "bag").blocks())
    assert live == recorded
    assert sum(one["quantity"] is not None for one in live) > 90


def test_a_bag_that_is_cut_is_measured_as_far_as_it_goes(bench, tmp_path):
    with StepBagWriter(tmp_path / "bag", METADATA) as bag:
        for block in bench.blocks(1):
            bag.block(block)
        bag.close()
    (file,) = (tmp_path / "bag").glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    collected = collect(StepBag(tmp_path / "bag").blocks(), ["SN-3"])
    sweep = collected.statistics["SN-3"].summary()
    assert 10 < len(sweep.stage_angle_deg) < 67
    measured = measure(bench.step(sweep=sweep, faults=collected.faults))
    reasons = [one.reason for one in measured if one.metric == "power_level"]
    assert "is cut short" in reasons[0]
    assert "of 67 stage angles recorded" in reasons[0]
    assert any(one.metric == "operating" and one.quantity for one in measured)


SPARSE_DEG = tuple(-60.0 + 3.6 * k for k in range(34))
SILENT = {
    "return1/distance": {"distance", "twin_distance", "dead_pixels"},
    "return1/intensity": {
        "intensity",
        "twin_intensity",
        "dead_pixels",
        "power",
        "focal_length",
        "principal_point",
        "distortion",
        "distance_error_per_decade",
    },
    "return2": set(),
    "row_valid": set(),
    "operating": {"operating"},
}
"""Topics of a DUT and beginnings of the names of metrics that need them."""


@pytest.fixture(scope="module")
def two_duts(tmp_path_factory):
    """A bag of two DUTs as a session writes it, and a bench for each."""
    benches = [SimulatedBench(DutSettings(serial=serial), angles_deg=SPARSE_DEG) for serial in ("SN-3", "SN-4")]
    path = tmp_path_factory.mktemp("two") / "bag"
    with StepBagWriter(path, replace(METADATA, duts=("SN-3", "SN-4"))) as bag:
        for row in zip(*(bench.blocks(k) for k, bench in enumerate(benches)), strict=True):
            bag.stage(int(row[0].time_ns[0]), row[0].stage_angle_deg)
            for block in row:
                bag.block(block)
        bag.close()
    return path, benches


def without(topic: str, bag: Path, copy: Path) -> Path:
    """A copy of a bag without the messages and the channels of some topics."""
    (source,) = bag.glob("*.mcap")
    copy.mkdir()
    shutil.copy(bag / "metadata.yaml", copy)
    with source.open("rb") as file, (copy / source.name).open("wb") as target:
        reader, writer = make_reader(file), Writer(target)
        writer.start(profile="ros2", library="test")
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        known: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if topic in channel.topic:
                continue
            if channel.id not in known:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(known[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    return copy


@pytest.mark.parametrize("topic", SILENT)
def test_a_missing_topic_costs_what_needs_it_and_nothing_else(two_duts, tmp_path, topic):
    path, (one, other) = two_duts
    collected = collect(StepBag(without(f"SN_3/{topic}", path, tmp_path / "bag")).blocks(), ["SN-3", "SN-4"])
    assert f"/dut_SN_3/{topic}" in collected.faults["frames"]
    whole = {each.metric for each in measure(other.step(seed=1)) if each.quantity is not None}
    for bench, needs in ((one, SILENT[topic]), (other, set())):
        sweep = collected.statistics[bench.dut.serial].summary()
        assert len(sweep.stage_angle_deg) == len(SPARSE_DEG)
        found = measure(bench.step(sweep=sweep, faults=collected.faults))
        missing = {each.metric: each.reason for each in found if each.quantity is None and each.attempted}
        assert all(name.startswith(tuple(needs)) for name in missing), missing
        assert {each.metric for each in found if each.quantity is not None} == whole - missing.keys()
        assert all(any(name.startswith(need) for name in missing) for need in needs)


def test_frames_that_are_missing_cost_precision_and_not_the_value(bench):
    statistics = SweepStatistics("SN-3")
    rng = np.random.default_rng(7)
    for block in bench.blocks(6):
        kept = np.sort(rng.permutation(10)[: rng.integers(0, 11)])
        statistics.add(
            replace(
                block,
                time_ns=block.time_ns[kept],
                intensity_counts=block.intensity_counts[kept],
                distance_m=block.distance_m[kept],
                row_valid=block.row_valid[kept],
            )
        )
    found = {each.name: each for each in measure(bench.step(sweep=statistics.summary()))}
    level, error = found["power_level"].quantity, found["distance_error[stripe_50]"].quantity
    assert abs(level.value) < 4 * math.hypot(*(part.u for part in level.contributions if part.kind == "A"))
    assert abs(error.value) < 4 * math.hypot(*(part.u for part in error.contributions if part.kind == "A"))
