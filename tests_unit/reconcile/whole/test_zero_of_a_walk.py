"""A walk is nil at some signal, nobody knows which: the constant beside it is what the rows say, and is foretold."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile


@pytest.mark.parametrize("off_m", [0.0, 1.2e-3])
def test_the_constant_beside_a_walk_is_foretold(make_table, walk, save, knows_only, tmp_path, off_m):
    knows_only("timing.range_walk", "timing.clock_scale")
    table, plain = make_table(8, walk, duts=1, steps=8), make_table(8, duts=1, steps=8)
    weight = table["sim_intensity_counts"]  # the user fitted an offset by the bright rows
    table["sim_distance_m"] = table["sim_distance_m"] + off_m + np.average(
        table["distance_m"] - table["sim_distance_m"], weights=weight
    )
    table["sim_distance_m_repeat_std"] = np.full(weight.size, 1.5e-3)  # from a day on which the bench was worse
    true = table["distance_m"] - plain["distance_m"] + plain["sim_distance_m"]
    held = table["step"] == 3.0
    reconcile(save(tmp_path / "t.parquet", {n: x[~held] for n, x in table.items()}), tmp_path / "out")
    blind = {n: x[held] for n, x in table.items() if n not in {"intensity_counts", "distance_m"}}
    predict(tmp_path / "out", save(tmp_path / "u.parquet", blind), tmp_path / "p.parquet")
    said = pq.read_table(tmp_path / "p.parquet")["corrected_distance_m"].to_numpy()
    error = table["sim_distance_m_std"][held]
    mean = np.average(said - true[held], weights=1.0 / error**2)
    assert abs(mean) < 3.0 * 0.0004 / np.sqrt(7.0)  # what seven steps that scatter by 0.4 mm can tell
    left, before = (np.sum(((true[held] - x) / error) ** 2) for x in (said, table["sim_distance_m"][held]))
    assert 1.0 - left / before > 0.8
