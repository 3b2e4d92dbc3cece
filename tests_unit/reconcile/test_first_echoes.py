"""Whether pixels at borders range the first echo, by what lies beside them: at the next stops, or the next pixels."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.effects_first_echo import held_at_first_echoes
from arl_fixtures.reconcile.grouping import typical_gaps
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

NEAR_M, FAR_M, BRIGHT, DARK = 3.0, 6.0, 100.0, 20.0


def stripes(pixels, first):
    """Boards four degrees wide before a wall, seen by pixels of one degree at stops two degrees apart.

    What sees both ranges the nearer one if `first`, else their mean by light.
    """
    stage, u = (x.ravel() for x in np.meshgrid(np.arange(-20.0, 20.1, 2.0), np.asarray(pixels, dtype=float)))
    rays = (stage + u)[:, None] + (np.arange(50) + 0.5) / 50.0 - 0.5
    board = (rays + 0.2) % 8.0 < 4.0
    light, far = np.where(board, BRIGHT, DARK), np.where(board, NEAR_M, FAR_M)
    seen = light.mean(axis=1)
    mean = far.min(axis=1) if first else (light * far).mean(axis=1) / seen
    return columns_of(pa.table({
        "step": np.zeros(u.size), "stage_angle_deg": stage, "pixel_u": u, "pixel_v": np.zeros(u.size),
        "azimuth_deg": u,
        "sim_intensity_counts": seen, "intensity_counts": seen, "sim_distance_m": mean, "distance_m": mean,
    }))  # fmt: skip


@pytest.mark.parametrize("pixels", [[0, 9, 18, 27], range(24)], ids=["thinned", "whole"])
@pytest.mark.parametrize("first", [True, False])
def test_ranges_stay_where_first_echoes_are_ranged(pixels, first):
    columns = stripes(pixels, first)
    columns.sweep_gap_deg, columns.frame_gap_s = typical_gaps(columns)
    view = View(columns)
    jump = {"distance_m": np.full(view.n, 0.5), "intensity_counts": np.full(view.n, 1.1)}
    held = held_at_first_echoes(view, jump, 0.1)
    assert np.all(held["intensity_counts"] == 1.1)
    assert np.all(held["distance_m"] == (0.0 if first else 0.5))
