"""What stands in for steps where a table has none, and what is no driver of its own."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.grouping import find_groups
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import columns_of


def table(**more: np.ndarray) -> pa.Table:
    """600 distances of zones or pixels, with further columns."""
    distance = np.linspace(1.0, 3.0, 600)
    return pa.table({"sim_distance_m": distance, "distance_m": distance + 1e-4, **more})


@pytest.mark.parametrize("name", ["distance_stop", "readout", "visit"])
def test_numbered_stops_are_steps(name):
    stop = np.repeat(np.arange(12), 50)
    groups = find_groups(columns_of(table(**{name: stop, "true_range_m": np.linspace(1.0, 3.0, 600)})))
    assert np.array_equal(groups.step, stop)
    assert groups.block is groups.step


def test_a_step_of_the_bench_is_not_replaced():
    stop, step = np.tile(np.arange(12), 50), np.repeat(np.arange(10), 60)
    assert np.array_equal(find_groups(columns_of(table(stop=stop, step=step))).step, step)


def test_poses_of_a_stage_are_steps_where_there_is_no_other_order():
    angle, pixel = np.repeat(np.arange(6) * 7.0, 100), np.tile(np.arange(100), 6)
    columns = columns_of(
        table(stage_angle_deg=angle, pixel_u=pixel % 10, pixel_v=pixel // 10, elevation_deg=pixel / 9)
    )
    groups = find_groups(columns)
    assert np.array_equal(groups.step, np.repeat(np.arange(6), 100))
    assert groups.angle is None


def test_zones_at_one_place_of_a_rail_share_its_error():
    place = np.repeat(np.linspace(0.1, 0.9, 100), 6)
    groups = find_groups(columns_of(table(zone=np.tile(np.arange(6), 100), true_range_m=place)))
    assert groups.frame is not None
    assert np.array_equal(np.unique(groups.frame, return_inverse=True)[1], np.repeat(np.arange(100), 6))
    assert groups.step.max() < 20


@pytest.mark.parametrize(("near", "far", "told"), [(1.0, 3.0, True), (1.0, 1.005, False)])
def test_a_clock_is_told_from_an_offset_only_where_distances_of_a_unit_differ(near, far, told):
    run = np.repeat(["a", "b"], 300)
    distance = np.tile(np.linspace(near, far, 300), 2) + 5.0 * (run == "b")
    made = pa.table({"run": run, "sim_distance_m": distance, "distance_m": distance + 1e-4})
    variants = list(library()["timing.clock_scale"].variants(Problem(columns_of(made)).view))
    assert bool(variants) is told


@pytest.mark.parametrize("name", ["repetition", "sweep_no", "trial"])
def test_what_is_swept_again_and_again_is_held_out_by_repetitions_not_by_places(name):
    again, place = np.repeat(np.arange(12), 50), np.tile(np.linspace(-0.06, 0.06, 50), 12)
    groups = find_groups(columns_of(table(**{name: again, "edge_offset_m": place})))
    assert np.array_equal(groups.block, again)  # every block holds the edge


@pytest.mark.parametrize("name", ["scan_rate_hz", "return_no", "true_repeat_m"])
def test_a_rate_or_an_echo_number_counts_no_repetitions(name):
    again, place = np.repeat(np.arange(12), 50), np.tile(np.linspace(-0.06, 0.06, 50), 12)
    groups = find_groups(columns_of(table(**{name: again, "edge_offset_m": place})))
    assert not np.array_equal(groups.block, again)
