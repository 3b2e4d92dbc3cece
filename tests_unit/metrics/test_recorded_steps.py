"""Live and from a bag, a step's values are the same to the last bit."""

from __future__ import annotations

from dataclasses import asdict

import pytest
from simulated_sweep import SimulatedBench

from arl_fixtures.metrics.collect import collect
from arl_fixtures.metrics.nominal import nominal_reference
from arl_fixtures.metrics.registry import measure
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
