"""Eighty columns that have nothing to do with a measurement: among so many products some fit its noise well."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

ROWS, COLUMNS = 500, 80


@pytest.mark.parametrize("seed", [13, 27, 39, 49])
def test_noise_among_many_columns_is_no_law(seed):
    """Of 60 such tables seven had a law, these among them, when columns had no price."""
    rng = np.random.default_rng(seed)
    far, step = rng.choice([1.0, 2.0, 3.5, 5.0], ROWS), np.arange(ROWS) // 50
    made = {
        "true_range_m": far, "step": step, "n_frames": np.full(ROWS, 4), "sim_distance_m": far,
        "sim_distance_m_std": np.full(ROWS, 0.004),
    }  # fmt: skip
    for k in range(COLUMNS):  # a third of them the same in all rows of a step
        made[f"aux_{k:02d}"] = rng.normal(size=ROWS) if k % 3 else rng.normal(size=10)[step]
    made["distance_m"] = far + 0.002 * rng.normal(size=ROWS)
    assert not diagnose(columns_of(pa.table(made)))[0].findings
