"""What is wrong with a recording makes its metrics INVALID with the reason; the rest is measured all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_sweep import FULL_SWEEP_DEG, SimulatedBench, value_of

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.collect import collect
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.registry import all_metrics, measure, metric_names, remember
from arl_fixtures.metrics.statistics import SweepStatistics
from arl_fixtures.metrics.step import StepData
from arl_fixtures.twin.scene import SceneSettings
from arl_fixtures.twin.settings import DutSettings

DUT = DutSettings(serial="SN-9", dead_pixels=((5, 5),))


@pytest.fixture(scope="module")
def bench():
    return SimulatedBench(DUT)


@pytest.fixture(scope="module")
def sweep(bench):
    return bench.sweep(1)


def missing(measured):
    return {one.name: one.reason for one in measured if one.quantity is None and one.attempted}


def test_nothing_recorded_makes_every_metric_invalid_and_none_fail(bench):
    step = StepData(dut=DUT, conditions=Conditions(set_temperature_c=25.0), sweep=None, geometry=None)
    measured = measure(step)
    assert {one.metric for one in measured} == metric_names()
    assert all(one.quantity is None and one.attempted for one in measured)


def test_of_what_did_not_record_only_that_is_said(bench):
    conditions, faults = Conditions(set_temperature_c=25.0), {"frames": "gone"}
    step = StepData(dut=bench.dut, conditions=conditions, sweep=None, geometry=None, faults=faults)
    assert {each.reason for each in measure(step)} == {"gone"}


def test_two_frames_at_an_angle_are_too_few_and_said_to_be_two(bench):
    few = SimulatedBench(bench.dut, angles_deg=bench.angles_deg[::4], frames=2)
    found = measure(few.step())
    reasons = {each.reason for each in found if each.metric in {"power_level", "distance_error", "focal_length"}}
    assert reasons
    assert all("(at most 2 frames at an angle)" in reason for reason in reasons)
    assert any(each.metric == "dead_pixels" and each.quantity for each in found)


def test_a_bag_cut_short_says_how_much_is_there(bench):
    def cut():
        for k, block in enumerate(bench.blocks(1)):
            if k == 57:
                raise DataError("step.mcap: is cut short")
            yield block

    collected = collect(cut(), [DUT.serial, "SN-10"])
    assert len(collected.statistics["SN-10"]) == 0
    step = bench.step(sweep=collected.statistics[DUT.serial].summary(), faults=collected.faults)
    reasons = missing(measure(step))
    assert "57 of 134 stage angles recorded" in reasons["distance_error[stripe_50]"]
    assert "step.mcap: is cut short" in reasons["distance_error[stripe_50]"]
    assert value_of(measure(step), "operating", "laser_current_a").quantity.value == pytest.approx(90.0)


def test_a_block_of_another_image_size_is_left_out_and_named(bench):
    blocks = [*bench.blocks(1)][:6]
    blocks[2] = replace(
        blocks[2],
        intensity_counts=blocks[2].intensity_counts[..., :64],
        distance_m=blocks[2].distance_m[..., :64],
    )
    collected = collect(blocks, [bench.dut.serial])
    assert collected.statistics[bench.dut.serial].stage_angle_deg.tolist() == [
        block.stage_angle_deg for k, block in enumerate(blocks) if k != 2
    ]
    assert collected.faults == {"frames": "SN-9: image size changed within the sweep to [32, 64]"}


def test_missing_operating_data_leave_the_frames_alone(bench, sweep):
    step = bench.step(
        sweep=replace(sweep, operating={}), faults={"operating": "topic /dut_SN_9/operating is missing"}
    )
    reasons = missing(measure(step))
    assert set(reasons) == {"operating", "operating_scatter"}
    assert reasons["operating"] == "topic /dut_SN_9/operating is missing"


@pytest.mark.parametrize("faults", [{"distance": "topic /dut_SN_9/distance is missing"}, {}])
def test_a_missing_distance_topic_leaves_the_intensity_metrics(bench, sweep, faults):
    nothing = np.full_like(sweep.distance_m, np.nan)
    cut = replace(sweep, distance_m=nothing, distance_variance=nothing, distance_returns=np.zeros_like(sweep.arrived))
    measured = measure(bench.step(sweep=cut, faults=faults))
    gone = {one.metric for one in measured if one.quantity is None and one.attempted}
    assert all(name.startswith(("distance", "twin_distance", "dead_pixels")) for name in gone)
    assert value_of(measured, "power_level").quantity.value == pytest.approx(0.0, abs=0.1)
    assert value_of(measured, "focal_length", "fx").quantity.value == pytest.approx(58.1, abs=0.02)


def test_without_intensities_the_slope_against_them_says_why(bench, sweep):
    why = "topic /dut_SN_9/return1/intensity is missing"
    found = measure(bench.step(sweep=sweep, faults={"intensity": why}))
    assert value_of(found, "distance_error_per_decade").reason == why
    assert value_of(found, "distance_error", "stripe_50").quantity is not None


def test_lost_rows_cost_precision_and_not_the_value(bench):
    statistics = SweepStatistics(DUT.serial)
    rng = np.random.default_rng(3)
    for block in bench.blocks(5):
        valid = rng.random(block.row_valid.shape) > 0.1
        intensity, distance = block.intensity_counts.copy(), block.distance_m.copy()
        intensity[:, 0][~valid], distance[:, 0][~valid] = 0, np.nan
        statistics.add(replace(block, row_valid=valid, intensity_counts=intensity, distance_m=distance))
    measured = measure(bench.step(sweep=statistics.summary()))
    assert missing(measured) == {}
    assert value_of(measured, "dead_pixels").quantity.value == 1
    assert value_of(measured, "power_level").quantity.value == pytest.approx(0.0, abs=0.02)


def test_a_reference_from_another_dut_is_refused_by_name(bench, sweep):
    foreign = replace(remember(bench.step(sweep=sweep)), serial="SN-1")
    reasons = missing(measure(bench.step(sweep=sweep, reference=foreign)))
    assert reasons["power_change"] == "the reference was recorded from DUT SN-1, not SN-9"
    assert "power_level" not in reasons


def test_an_expired_reference_is_refused(bench, sweep):
    old = remember(bench.step(sweep=sweep), valid_until_utc_ns=10)
    reasons = missing(measure(bench.step(sweep=sweep, reference=old)))
    assert "expired" in reasons["focal_length_change[fx]"]
    with pytest.raises(NotMeasurableError, match=r"expired 2\.0 days before"):
        old.check("SN-9", 10 + round(2 * 86_400e9))


def test_a_hidden_target_is_named_and_the_others_are_measured(sweep):
    panels = SceneSettings().panels
    # something stands in front of the 50 % stripe
    hidden = tuple(
        panel.model_copy(update={"radius_m": 0.8}) if panel.name == "stripe_50" else panel for panel in panels
    )
    bench = SimulatedBench(DUT, actual_scene=SceneSettings(panels=hidden))
    measured = measure(bench.step(seed=2))
    reasons = missing(measured)
    assert reasons["distance_error[stripe_50]"].startswith("stripe_50 is hidden or gone")
    assert not any("stripe_18" in name or "stripe_80" in name for name in reasons)
    assert value_of(measured, "power_level").quantity.value == pytest.approx(0.0, abs=0.1)


def test_a_dut_whose_distances_are_all_off_is_not_a_hidden_target(bench, sweep):
    shifted = replace(sweep, distance_m=sweep.distance_m + np.float32(0.08))
    error = value_of(measure(bench.step(sweep=shifted)), "distance_error", "stripe_50").quantity
    assert error.value == pytest.approx(100 * 0.08 / 1.113, abs=0.1)


def test_a_missing_intrinsic_target_makes_the_calibration_invalid(bench):
    panels = tuple(panel for panel in SceneSettings().panels if panel.name != "intrinsic_left")
    gone = SimulatedBench(DUT, actual_scene=SceneSettings(panels=panels))
    reasons = missing(measure(gone.step(seed=3)))
    assert "intrinsic_left: 0 of" in reasons["focal_length"]
    assert not any(name.startswith("power") for name in reasons)


def test_a_frozen_dut_is_invalid_rather_than_full_of_stuck_pixels(bench):
    statistics = SweepStatistics(DUT.serial)
    first = next(iter(bench.blocks(1)))
    frozen = np.repeat(first.intensity_counts[:1], 10, axis=0)
    distance = np.repeat(first.distance_m[:1], 10, axis=0)
    for k, angle_deg in enumerate(FULL_SWEEP_DEG):
        statistics.add(
            replace(first, angle_index=k, stage_angle_deg=angle_deg, intensity_counts=frozen, distance_m=distance)
        )
    reasons = missing(measure(bench.step(sweep=statistics.summary())))
    assert "frozen frame" in reasons["dead_pixels"]


def test_hot_and_stuck_pixels_are_told_from_dead_ones(bench):
    statistics = SweepStatistics(DUT.serial)
    for block in bench.blocks(6):
        intensity = block.intensity_counts.copy()
        intensity[:, 0, 3, 40] = np.minimum(intensity[:, 0, 3, 40].astype(int) + 900, 4095)
        intensity[:, 0, 4, 50] = 512
        statistics.add(replace(block, intensity_counts=intensity))
    measured = measure(bench.step(sweep=statistics.summary()))
    found = {scope: value_of(measured, "dead_pixels_by_kind", scope) for scope in ("dead", "hot", "stuck")}
    assert {scope: one.reason for scope, one in found.items()} == {
        "dead": "(5, 5)",
        "hot": "(40, 3)",
        "stuck": "(50, 4)",
    }
    # a faulty pixel spoils no other metric
    assert value_of(measured, "power_level").quantity.value == pytest.approx(0.0, abs=0.02)


def test_references_survive_the_file_and_refuse_what_is_none(bench, sweep, tmp_path):
    path = tmp_path / "SN-9.npz"
    kept = remember(bench.step(sweep=sweep))
    kept.save(path)
    loaded = Reference.load(path)
    assert (loaded.serial, loaded.identity) == (kept.serial, kept.identity)
    assert loaded.arrays.keys() == kept.arrays.keys()
    for name, array in kept.arrays.items():
        np.testing.assert_array_equal(loaded.arrays[name], array)
    assert [entry.name for entry in tmp_path.iterdir()] == ["SN-9.npz"]
    for content in (b"", b"nonsense", path.read_bytes()[:200]):
        (tmp_path / "bad.npz").write_bytes(content)
        with pytest.raises(DataError, match=r"bad\.npz"):
            Reference.load(tmp_path / "bad.npz")
    with pytest.raises(DataError, match="cannot be read"):
        Reference.load(tmp_path / "none.npz")


def test_every_metric_name_is_measured_under_that_name(bench, sweep):
    step = bench.step(sweep=sweep, reference=remember(bench.step(sweep=sweep)))
    for metric in all_metrics():
        assert {one.metric for one in metric.evaluate(step)} == set(metric.names)
