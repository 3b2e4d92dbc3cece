"""Shares of few frames that are lost: their counts have heavier tails than normal errors of the same size."""

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import kurtosis

from arl_fixtures.reconcile.stated import frames_averaged, surprise_shared
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View


@pytest.mark.parametrize(("share", "frames"), [(0.98, 50), (0.95, 100), (0.7, 200)])
def test_what_few_rows_have_in_common_tells_less_by_the_tails_of_their_counts(share, frames):
    drawn = np.random.default_rng(2).binomial(frames, share, 400_000) / frames
    view = View(columns_of(pa.table({
        "n_frames": np.full(40, frames), "sim_valid_fraction": np.full(40, share), "valid_fraction": drawn[:40],
        "sim_intensity_counts": np.full(40, 500.0), "intensity_counts": np.full(40, 500.0),
    })))  # fmt: skip
    shared = {c.name: surprise_shared(view, c, np.arange(40)) for c in view.columns.channels}
    assert shared["valid_fraction"] == pytest.approx(1.0 + kurtosis(drawn) + 6.0 / frames, abs=0.1)
    assert shared["intensity_counts"] == 1.0


@pytest.mark.parametrize("of_returns", [True, False], ids=["of returns", "of all frames"])
def test_means_and_scatters_are_of_the_frames_that_had_a_return_where_rows_show_it(of_returns):
    rng, n, frames = np.random.default_rng(5), 3000, 6
    returns = np.maximum(rng.binomial(frames, 0.8, n), 1)
    single = 3.0 * rng.standard_normal((n, frames)) + 200.0
    seen = np.arange(frames) < (returns if of_returns else np.full(n, frames))[:, None]
    mean = np.where(seen, single, 0.0).sum(axis=1) / seen.sum(axis=1)
    table = columns_of(pa.table({
        "n_frames": np.full(n, float(frames)), "valid_fraction": returns / frames,
        "sim_valid_fraction": np.full(n, 0.8), "intensity_counts": mean, "sim_intensity_counts": np.full(n, 200.0),
        "sim_intensity_counts_std": np.full(n, 3.0), "ambient_counts": mean, "sim_ambient_counts": np.full(n, 200.0),
        "sim_ambient_counts_std": np.full(n, 3.0),
    }))  # fmt: skip
    view = View(table)
    light, ambient = (next(c for c in table.channels if c.name == f"{x}_counts") for x in ("intensity", "ambient"))
    assert np.array_equal(frames_averaged(view, light), returns if of_returns else np.full(n, frames))
    assert np.all(frames_averaged(view, ambient) == frames)
