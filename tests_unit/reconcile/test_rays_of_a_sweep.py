"""A table without rays, whose sweep tells them: what needs a ray's height takes it from there."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.table import columns_of


def test_a_leak_into_pixels_that_are_not_in_the_table_is_asked_for():
    rng = np.random.default_rng(1)
    stops = np.arange(-20.0, 20.1, 0.7)
    u, v, stop = (a.ravel() for a in np.meshgrid(np.arange(0, 20, 2), np.arange(6), stops, indexing="ij"))
    near = np.abs(np.sin(2.2 * np.radians(2.5 * (u - 9.5) + stop))) > 0.6
    range_m = np.where(near, 1.3, 2.4) / np.cos(np.radians(2.2 * (v - 2.5)))
    light = 4000.0 * np.where(near, 0.5, 0.2) / range_m**2
    sigma = 1.0 + 0.01 * light
    table = {
        "pixel_u": u, "pixel_v": v, "stage_angle_deg": stop, "step": np.zeros(u.size, dtype=int),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": light + sigma * rng.normal(size=u.size), "sim_distance_m": range_m,
        "sim_distance_m_std": np.full(u.size, 0.003), "distance_m": range_m + 0.003 * rng.normal(size=u.size),
    }  # fmt: skip
    search = Search(columns_of(pa.table(table)), [library()["detector.crosstalk"]])
    assert "elevation_deg" in search.columns.derived
    assert not search.failed
