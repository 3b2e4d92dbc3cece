"""A stop line that runs along one axis of the array delays the pixels far from its driver."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


@pytest.mark.parametrize("along", ["pixel_u", "pixel_v"])
def test_the_axis_that_the_line_runs_along_is_the_first_driver(along):
    rng = np.random.default_rng(8)
    step, v, u = (part.ravel() for part in np.mgrid[0:8, 0:12, 0:12])
    far = (u if along == "pixel_u" else v).astype(float)
    # each tap charges the next through its resistance: a sampled Elmore delay, 0.15 mm of range a picosecond
    delay_ps = np.cumsum(0.5 + 0.01 * np.arange(12)[::-1])[far.astype(int)]
    sim = 1.2 + 0.05 * np.sin(step + 0.3 * u)
    seen = sim + 0.15e-3 * delay_ps + rng.normal(0.0, 2e-4, sim.size)
    table = pa.table({
        "step": step, "pixel_u": u, "pixel_v": v, "sim_distance_m": sim, "distance_m": seen,
        "sim_distance_m_std": np.full(sim.size, 2e-4),
    })  # fmt: skip
    first = diagnose(columns_of(table), effects=[library()["timing.row_skew"]])[0].findings[0]
    assert first.effect == "timing.row_skew"
    assert first.drivers == [along, "pixel_v" if along == "pixel_u" else "pixel_u"]
