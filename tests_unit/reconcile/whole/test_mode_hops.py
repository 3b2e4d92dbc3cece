"""A diode that goes from mode to mode as it warms: light that drifts, and jumps back at every hop.

Between hops the line follows the length of the cavity, 0.07 nm/K; the gain's peak runs ahead with 0.27 nm/K, and the
mode that is nearest to it lases (Agrawal & Dutta, Semiconductor Lasers, 2nd ed., sec. 3.5). A coating's slope turns
the line's place into light.
"""

import numpy as np
import pytest

from arl_fixtures.reconcile.command import reconcile
from tests_unit.reconcile.foretold import share_told

SPACING_NM, CAVITY, PEAK = 1.1, 0.07, 0.27


def line_nm(warm_k, first_nm):
    """Wavelength of the mode next to the gain's peak, less that at rest."""
    number = np.round((first_nm + (PEAK - CAVITY) * warm_k) / SPACING_NM)
    return number * SPACING_NM + CAVITY * warm_k


def rail(seed, setpoints_c, slope, first_nm):
    """A beam on five targets at temperatures of its diode: a table, and what it would measure without noise."""
    rng = np.random.default_rng(seed)
    step, place, _ = (a.ravel() for a in np.meshgrid(np.arange(len(setpoints_c)), np.arange(5), np.arange(16),
                                                       indexing="ij"))  # fmt: skip
    warm = np.asarray(setpoints_c, dtype=float)[step] + rng.normal(0.0, 0.6, len(step))
    light = 2400.0 / (1.0 + place) ** 1.5
    true = light * (1.0 + slope * (line_nm(warm - 25.0, first_nm) - PEAK * (warm - 25.0)))
    scatter = np.sqrt(40.0 + 0.4 * light)
    table = {
        "step": step, "set_temperature_c": np.asarray(setpoints_c, dtype=float)[step], "laser_temperature_c": warm,
        "true_range_m": 1.0 + place, "housing_temperature_c": warm - 2.0 + rng.normal(0.0, 1.5, len(step)),
        "sim_intensity_counts": light, "sim_intensity_counts_std": scatter, "n_frames": np.full(len(step), 40),
        "sim_intensity_counts_repeat_std": 5e-4 * light,
    }  # fmt: skip
    noise = (
        scatter / np.sqrt(40.0) * rng.normal(size=len(step)) + 5e-4 * light * rng.normal(size=len(setpoints_c))[step]
    )
    return {**table, "intensity_counts": true + noise}, true


@pytest.mark.parametrize(("seed", "slope", "first_nm"), [(1, 0.012, 0.1), (2, -0.016, 0.4), (3, 0.02, 0.9)])
def test_hops_are_foretold_where_no_step_was(tmp_path, save, foretell, seed, slope, first_nm):
    seen = np.arange(6.0, 56.0, 2.0) + np.random.default_rng(seed).uniform(-0.8, 0.8, 25)
    recorded, _ = rail(seed, np.delete(seen, [5, 12, 18]), slope, first_nm)
    diagnosis = reconcile(save(tmp_path / "table.parquet", recorded), tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["unknown"]
    unseen, true = rail(seed + 100, seen[[5, 12, 18]], slope, first_nm)
    foretold = foretell(unseen, "intensity_counts")
    assert share_told(true - unseen["sim_intensity_counts"], true - foretold) > 0.95
