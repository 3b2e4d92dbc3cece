"""The peak of a sampled pulse, found by a parabola through three samples: strong returns are flattened before them.

That bends the interpolation between two samples: the range is off periodically, by more the stronger the return.
"""

import numpy as np
import pytest

from arl_fixtures.reconcile.command import reconcile
from tests_unit.reconcile.foretold import share_told

FULL = 4000.0


def ranged_m(true_m, light, spacing_m, width_m, *, flattened):
    """Place of the top of a parabola through the highest sample and its neighbours."""
    first = np.round(true_m / spacing_m)[:, None] + np.arange(-3, 4)
    pulse = light[:, None] * np.exp(-0.5 * ((first * spacing_m - true_m[:, None]) / width_m) ** 2)
    pulse = FULL * np.tanh(pulse / FULL) if flattened else pulse
    rows, top = np.arange(len(light)), 1 + np.argmax(pulse[:, 1:-1], axis=1)
    before, here, after = pulse[rows, top - 1], pulse[rows, top], pulse[rows, top + 1]
    return spacing_m * (first[rows, top] + 0.5 * (before - after) / (before - 2.0 * here + after))


def rail(seed, ranges_m, spacing_m, width_m):
    """A beam on a rail before three plates: a table, and the range that it would tell without noise."""
    rng = np.random.default_rng(seed)
    stop, plate, _ = (a.ravel() for a in np.meshgrid(np.arange(len(ranges_m)), np.arange(3), np.arange(6)))
    true = np.asarray(ranges_m)[stop]
    light = np.array([0.9, 0.45, 0.12])[plate] * 3000.0 / true**2
    scatter = 0.004 * np.sqrt(1.0 + 200.0 / light)
    told = ranged_m(true, light, spacing_m, width_m, flattened=True)
    simulated = ranged_m(true, light, spacing_m, width_m, flattened=False)
    return {
        "step": stop, "true_range_m": true, "time_s": 40.0 * stop + 2.0 * plate,
        "surface": np.array(["white", "grey", "black"])[plate], "reflectance": np.array([0.9, 0.45, 0.12])[plate],
        "housing_temperature_c": 24.0 + 0.01 * stop + rng.normal(0.0, 0.2, len(stop)),
        "sim_intensity_counts": light, "sim_intensity_counts_std": np.sqrt(20.0 + light),
        "n_frames": np.full(len(stop), 8),
        "intensity_counts": light + np.sqrt((20.0 + light) / 8.0) * rng.normal(size=len(stop)),
        "sim_distance_m": simulated, "sim_distance_m_std": scatter,
        "distance_m": told + scatter / np.sqrt(8.0) * rng.normal(size=len(stop)),
    }, told  # fmt: skip


@pytest.mark.parametrize(("seed", "spacing_m", "width_m"), [(2, 0.15, 0.11), (3, 0.25, 0.2)])
def test_a_wave_that_grows_with_the_light_is_foretold(tmp_path, save, foretell, seed, spacing_m, width_m):
    seen = np.sort(np.random.default_rng(seed).uniform(0.8, 3.0, 80))
    recorded, _ = rail(seed, seen, spacing_m, width_m)
    diagnosis = reconcile(save(tmp_path / "table.parquet", recorded), tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["unknown"]
    assert diagnosis.findings[0].channels == ["distance_m"]
    unseen, true = rail(seed + 9, np.random.default_rng(seed + 9).uniform(0.8, 3.0, 40), spacing_m, width_m)
    foretold = foretell(unseen, "distance_m")
    assert share_told(true - unseen["sim_distance_m"], true - foretold) > 0.8
