"""Shares of few frames that are lost: their counts have heavier tails than normal errors of the same size."""

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import kurtosis

from arl_fixtures.reconcile.stated import surprise_shared
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
