"""A device that a comparison has not seen gets the constant that all devices need beside a finding."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile


@pytest.fixture
def left_on_unseen(tmp_path, make_table, save, walk, knows_only):
    """Mean square that a prediction leaves on a third device, as a share of what a given per-device offset makes."""

    def run(offsets_m: dict[str, float], seen: tuple[str, ...] = ("S0", "S1"), steps: int = 6) -> tuple[float, float]:
        knows_only("timing.range_walk", "timing.temperature_offset")

        def change(columns, rng):
            walk(columns, rng)
            columns["distance_m"] = columns["distance_m"] + np.array([offsets_m[d] for d in columns["dut"]])

        columns = make_table(81, change, duts=3, steps=steps)
        still = make_table(81, change, duts=3, steps=steps, shared=0.0)
        third, known = columns["dut"] == "S2", np.isin(columns["dut"], seen)
        reconcile(save(tmp_path / "t.parquet", {n: v[known] for n, v in columns.items()}), tmp_path / "out")
        simulated = {n: v[third] for n, v in columns.items() if n not in {"distance_m", "intensity_counts"}}
        predict(tmp_path / "out", save(tmp_path / "new.parquet", simulated), tmp_path / "said.parquet")
        said = pq.read_table(tmp_path / "said.parquet")["corrected_distance_m"].to_numpy()
        true, weight = still["distance_m"][third], columns["sim_distance_m_std"][third] ** -2
        off = said - true
        before = columns["sim_distance_m"][third] - true
        return float(np.average(off, weights=weight)), float(np.average(before, weights=weight))

    return run


def test_what_all_devices_need_is_foretold_of_another(left_on_unseen):
    after, before = left_on_unseen({"S0": 0.0, "S1": 0.0, "S2": 0.0})
    assert abs(after) < 0.15 * abs(before)


def test_devices_that_differ_foretell_nothing_of_another(left_on_unseen):
    after, _ = left_on_unseen({"S0": 0.02, "S1": -0.03, "S2": 0.0})
    assert abs(after) < 0.006


def test_the_zero_of_a_walk_is_taken_over_from_a_single_device(left_on_unseen):
    after, before = left_on_unseen({"S0": 0.0, "S1": 0.0, "S2": 0.0}, seen=("S0",))
    assert abs(after) < 0.15 * abs(before)


def test_more_than_the_walk_itself_is_that_device_s_own(left_on_unseen):
    after, _ = left_on_unseen({"S0": 0.3, "S1": 0.0, "S2": 0.0}, seen=("S0",))
    assert abs(after) < 0.03
