"""Steps that scatter by a share of the light, over pixels of very unequal light: no excess of the rows' own noise."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.table import columns_of


def quiet_rows(seed, *, excess=1.0, declared=True, lobes=0.0):
    """Thirty steps, each off by 0.3 % as a whole, of 120 pixels between 80 and 3000 counts known to a thousandth.

    `excess`: by which rows scatter more than stated. `lobes`: loss through a strained window between polarisers, in
    the diagonals of the field, with the square of the temperature's distance from rest (a sum over both axes of it).
    """
    rng = np.random.default_rng(seed)
    pixel, step = (a.ravel() for a in np.meshgrid(np.arange(120), np.arange(30), indexing="ij"))
    light = rng.permutation(np.geomspace(80.0, 3000.0, 120))[pixel]
    azimuth, elevation = 40.0 * np.cos(2.4 * pixel), 12.0 * np.sin(1.7 * pixel)
    warm = -10.0 + 3.2 * step
    sigma = 0.5 + 0.001 * light
    strain = np.sin(np.radians(azimuth)) * np.sin(np.radians(elevation)) * (warm - 25.0) / 60.0
    through = np.cos(3.0 * lobes * strain) ** 2  # Malus, of the retardance
    shared = 0.003 * rng.normal(size=30)[step]
    table = {
        "step": step, "pixel_u": pixel % 12, "pixel_v": pixel // 12, "azimuth_deg": azimuth,
        "elevation_deg": elevation, "housing_temperature_c": warm + 0.05 * rng.normal(size=len(step)),
        "n_frames": np.full(len(step), 10), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": light * through * (1.0 + shared)
        + excess * sigma / np.sqrt(10.0) * rng.normal(size=len(step)),
    }  # fmt: skip
    return columns_of(pa.table(table | ({"sim_intensity_counts_repeat_std": 0.003 * light} if declared else {})))


@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize("excess", [1.0, 1.6])
def test_the_rows_own_scatter_is_told_from_what_steps_share(excess, declared):
    search = Search(quiet_rows(8, excess=excess, declared=declared), [])
    (d,) = search.full.data
    assert d.spread == pytest.approx(excess, rel=0.06)


def test_a_strained_window_is_seen_beside_such_steps():
    (found,) = diagnose(quiet_rows(9, lobes=0.6))[0].findings
    assert found.effect == "unknown"
    assert {"azimuth_deg", "elevation_deg"} & set(found.drivers)
    assert {"housing_temperature_c", "step"} & set(found.drivers)


def test_nothing_is_seen_where_only_steps_scatter():
    assert not diagnose(quiet_rows(10))[0].findings
