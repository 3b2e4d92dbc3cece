"""Of the columns of an unknown cause that comes first without which least would be said of it."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import reconcile
from arl_fixtures.reconcile.law_drivers import strongest_first


def road(seed, rains, ranges):
    """Echoes counted through rain: drops of the law of Marshall and Palmer, each of which takes twice its shadow."""
    rng = np.random.default_rng(seed)
    drive, target, pulse = (a.ravel() for a in np.meshgrid(range(40), range(25), range(3), indexing="ij"))
    rain = rng.choice(rains, 40)[drive]
    far = rng.uniform(*ranges, 25)[target]
    size_mm, rate = np.linspace(0.1, 6.0, 200), np.maximum(rain, 1e-3)[:, None]
    drops = 8000.0 * np.exp(-4.1 * rate**-0.21 * size_mm)  # per mm and m^3
    shadow = np.trapezoid(drops * np.pi / 4.0 * (size_mm * 1e-3) ** 2, size_mm, axis=1) * 2.0
    own = 2500.0 * (40.0 / far) ** 2
    counts = rng.poisson(own * np.exp(-2.0 * shadow * far * (rain > 0.0)), (20, len(far))).mean(axis=0)
    return {
        "step": drive.astype(float), "time_s": 60.0 * drive + pulse, "rain_mm_h": rain, "true_range_m": far,
        "n_frames": np.full(len(far), 20.0), "sim_amplitude_counts": own, "amplitude_counts": counts,
        "sim_amplitude_counts_std": np.sqrt(own),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("rains", "ranges", "first"),
    [([0.0, 2.0, 8.0, 25.0], (30.0, 42.0), "rain_mm_h"), ([7.0, 8.0, 9.0], (15.0, 60.0), "true_range_m")],
    ids=["rain or none", "near or far"],
)
def test_of_a_product_of_two_columns_the_one_that_varies_more_comes_first(tmp_path, rains, ranges, first):
    pq.write_table(pa.table(road(3, rains, ranges)), tmp_path / "t.parquet")
    found = reconcile(tmp_path / "t.parquet", tmp_path / "d")
    assert [finding.effect for finding in found.findings] == ["unknown"]
    assert found.findings[0].drivers[0] == first


def test_columns_of_which_too_few_rows_tell_stay_as_they_were():
    rng = np.random.default_rng(1)
    features = {name: rng.normal(size=60) for name in "abc"}
    names = ["c", "a", "b"]
    assert strongest_first(names, features, features["a"] + 0.1 * features["c"], np.ones(60)) == names
