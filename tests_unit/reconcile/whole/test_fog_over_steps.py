"""Fog between sensor and targets, which no library holds: what it takes grows with its density and the way through.

The density follows the humidity of the step, so that most of the effect differs from step to step.
"""

import numpy as np
import pyarrow.parquet as pq
import pytest
from foretold import share_told

from arl_fixtures.reconcile.command import predict, reconcile

RANGES, WHITE = np.array([1.5, 2.2, 3.0, 4.5, 6.0, 8.0, 11.0, 15.0]), np.array([0.1, 0.8])
STEPS = 40


def chamber(seed):
    """Columns of a day of humid and dry hours: two boards at eight ranges, four readings each."""
    rng = np.random.default_rng(seed)
    hour = np.linspace(0.0, 30.0, STEPS)
    humid = np.clip(0.80 + 0.15 * np.sin(2.0 * np.pi * hour / 19.0) + 0.02 * rng.normal(size=STEPS), 0.5, 0.985)
    drops = 0.09 * np.maximum((humid - 0.83) / 0.14, 0.0) ** 2  # a mist forms: its extinction, 1/m
    step, far, white, _ = (
        x.ravel() for x in np.meshgrid(np.arange(STEPS), RANGES, WHITE, np.arange(4), indexing="ij")
    )
    light = 3e4 * white / far**2
    noise = np.sqrt(30.0 + 0.6 * light)
    true = light * np.exp(-2.0 * drops[step] * far)
    return {
        "step": step.astype(float), "true_range_m": far, "reflectance": white,
        "relative_humidity": humid[step] + 0.002 * rng.normal(size=step.size),
        "n_frames": np.full(step.size, 40.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "intensity_counts": true + noise / np.sqrt(40.0) * rng.normal(size=step.size),
    }, true  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_steps_are_told_by_their_humidity_and_not_left_to_chance(seed, tmp_path, save):
    columns, true = chamber(seed)
    unseen = np.isin(columns["step"], np.arange(3.0, STEPS, 5.0))
    reconcile(save(tmp_path / "t.parquet", {n: v[~unseen] for n, v in columns.items()}), tmp_path / "out")
    blind = {n: v[unseen] for n, v in columns.items() if n != "intensity_counts"}
    predict(tmp_path / "out", save(tmp_path / "new.parquet", blind), tmp_path / "said.parquet")
    told = pq.read_table(tmp_path / "said.parquet")["corrected_intensity_counts"].to_numpy()
    off, left = (true[unseen] - x for x in (blind["sim_intensity_counts"], told))
    assert share_told(off, left) > 0.8
