"""The rows of a large table that are searched stand for all of it."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.grouping import Groups, find_groups
from arl_fixtures.reconcile.sampling import draw_rows
from arl_fixtures.reconcile.table import columns_of


def sweep(steps: int, angles: int, pixels: int) -> tuple[Columns, Groups]:
    """Two DUTs, every pixel at every angle of every step, rows in no order."""
    dut, step, angle, pixel = (
        a.ravel() for a in np.meshgrid(*map(np.arange, (2, steps, angles, pixels)), indexing="ij")
    )
    order = np.random.default_rng(3).permutation(len(dut))
    table = {
        "dut": np.array(["a", "b"])[dut], "step": step, "stage_angle_deg": 2.0 * angle, "pixel_u": pixel % 32,
        "pixel_v": pixel // 32, "distance_m": 1.0 + 0.1 * pixel, "sim_distance_m": 1.0 + 0.1 * pixel,
    }  # fmt: skip
    columns = columns_of(pa.table({name: values[order] for name, values in table.items()}))
    return columns, find_groups(columns)


def test_many_steps_of_few_pixels_keep_all_pixels_and_angles():
    columns, groups = sweep(60, 10, 14)
    rows = draw_rows(columns, groups, 3_000)
    assert 2_000 < len(rows) < 4_000
    assert set(columns.numbers["pixel_u"][rows]) == set(range(14))
    assert len(np.unique(columns.numbers["stage_angle_deg"][rows])) == 10
    assert len(np.unique(groups.step[rows])) > 0.9 * 120


def test_the_rows_of_a_step_are_a_grid_and_its_pixels_come_back_in_others():
    columns, groups = sweep(40, 9, 512)
    rows = draw_rows(columns, groups, 12_000)
    assert 6_000 < len(rows) < 24_000
    pixel, angle = columns.group("pixel_u", "pixel_v")[rows], columns.codes_of("stage_angle_deg")[rows]
    for step in np.unique(groups.step[rows])[::7]:
        here = groups.step[rows] == step
        assert len(np.unique(pixel[here])) * len(np.unique(angle[here])) == here.sum()
    back = [len(np.unique(groups.step[rows][pixel == p])) for p in np.unique(pixel)]
    assert np.median(back) >= 6
    assert len(back) > 60


def test_a_smaller_draw_lies_inside_a_larger_one():
    columns, groups = sweep(30, 9, 64)
    large, small = draw_rows(columns, groups, 12_000), draw_rows(columns, groups, 4_000)
    assert 2_000 < len(small) < len(large)
    assert np.isin(small, large).mean() > 0.9


def test_a_small_table_is_searched_whole():
    columns, groups = sweep(5, 3, 8)
    assert np.array_equal(draw_rows(columns, groups, 1_000), np.arange(240))
