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


def current_sweep(seed, currents_ma, kelvin_per_ma, slope, first_nm):
    """The same beam on three boards while the current goes up, one step at each: the diode warms itself."""
    rng = np.random.default_rng(seed)
    step, place, _ = (a.ravel() for a in np.meshgrid(np.arange(len(currents_ma)), np.arange(3), np.arange(12),
                                                       indexing="ij"))  # fmt: skip
    current = np.asarray(currents_ma, dtype=float)
    warm = kelvin_per_ma * (current - current[0])[step]
    light = 40.0 * current[step] / (1.0 + place) ** 1.5
    true = light * (1.0 + slope * (line_nm(warm, first_nm) - PEAK * warm))
    scatter = np.sqrt(40.0 + 0.4 * light)
    table = {
        "step": step, "laser_current_a": 1e-3 * current[step], "reflectance": np.array([0.1, 0.5, 0.9])[place],
        "laser_voltage_v": 1.6 + 0.012 * current[step] + rng.normal(0.0, 6e-3, len(step)),
        "sim_intensity_counts": light, "sim_intensity_counts_std": scatter, "n_frames": np.full(len(step), 20),
        "sim_intensity_counts_repeat_std": 3e-3 * light,
    }  # fmt: skip
    drift = 3e-3 * rng.normal(size=len(current))[step]
    return {**table, "intensity_counts": true + light * drift + scatter / 20**0.5 * rng.normal(size=len(step))}, true


@pytest.mark.parametrize(("seed", "kelvin_per_ma", "slope"), [(4, 1.21, 0.07), (5, -1.5, 0.05), (6, 0.9, -0.08)])
def test_hops_over_currents_of_one_step_each_are_no_scatter_of_steps(
    tmp_path, save, foretell, seed, kelvin_per_ma, slope
):
    left_out = [6, 7, 18, 30]
    seen = np.delete(np.arange(20.0, 61.0), left_out)
    recorded, _ = current_sweep(seed, seen, kelvin_per_ma, slope, 0.3)
    diagnosis = reconcile(save(tmp_path / "table.parquet", recorded), tmp_path / "out")
    assert [(f.effect, f.drivers[0]) for f in diagnosis.findings] == [("unknown", "laser_current_a")]
    unseen, true = current_sweep(seed + 100, np.concatenate([[20.0], 20.0 + np.array(left_out)]), kelvin_per_ma,
                                 slope, 0.3)  # fmt: skip
    foretold = foretell(unseen, "intensity_counts")
    assert share_told(true - unseen["sim_intensity_counts"], true - foretold) > 0.9
