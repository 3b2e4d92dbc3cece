"""A laser that gets warmer, swept through its currents before targets that send back a twentieth or nearly all."""

import numpy as np
import pytest
from foretold import share_told

from arl_fixtures.reconcile.command import reconcile

CURRENTS_A = np.array([0.06, 0.075, 0.09, 0.105])
THRESHOLD_A, SLOPE_W_PER_A = 0.020, 14.0


def power_w(current_a, case_c, *, ages):
    """Optical power of a diode that heats itself, at rest: junction and light are iterated until they agree."""
    light = SLOPE_W_PER_A * (current_a - THRESHOLD_A)
    if not ages:
        return light
    for _ in range(60):
        junction = case_c + 18.0 * (current_a / 0.105) * (2.0 - light / 1.2)
        threshold = THRESHOLD_A * np.exp((junction - 25.0) / 70.0)
        light = 0.5 * light + 0.5 * SLOPE_W_PER_A * np.maximum(current_a - threshold, 0.0) * np.exp(
            -(junction - 25.0) / 180.0
        )
    return light


def bench(seed, steps, *, named):
    """Steps of temperature, in each of which targets are seen at all currents; `named`: their reflectance is told."""
    rng = np.random.default_rng(seed)
    step = np.repeat(steps, 120)
    n = len(step)
    current, white = rng.choice(CURRENTS_A, n), rng.choice([0.06, 0.2, 0.5, 0.85], n)
    range_m, incidence = rng.choice([1.5, 2.2, 3.0], n), rng.choice([0.0, 20.0], n)
    case = 12.0 + 2.6 * step + 0.2 * rng.normal(size=n)
    geometry = 2.0e4 * white * np.cos(np.radians(incidence)) / range_m**2
    nominal, aged = (geometry * power_w(current, case, ages=ages) for ages in (False, True))
    sigma = 1.0 + 0.006 * nominal
    table = {
        "step": step, "laser_temperature_c": case, "laser_current_a": current, "true_range_m": range_m,
        "incidence_deg": incidence, "n_frames": np.ones(n, dtype=int), "sim_intensity_counts": nominal,
        "sim_intensity_counts_std": sigma, "intensity_counts": aged + sigma * rng.normal(size=n),
        **({"reflectance": white} if named else {}),
    }  # fmt: skip
    return table, nominal, aged


@pytest.mark.parametrize("named", [True, False])
def test_a_threshold_is_told_by_targets_of_any_reflectance(tmp_path, save, foretell, named):
    table, _, _ = bench(3, np.arange(0, 16, 2), named=named)
    diagnosis = reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["laser.thermal_rolloff"]
    unseen, nominal, aged = bench(4, np.arange(1, 15, 2), named=named)
    assert share_told(aged - nominal, aged - foretell(unseen, "intensity_counts")) > 0.98
