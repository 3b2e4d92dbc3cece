"""Eight steps: a law that several of them bear out is one; a step that is off by itself bears out nothing."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

SIGMA_M, SHARED_M = 1.5e-3, 2.5e-4
STEPS, ROWS = 8, 120


def cable_table(seed, delay_m):
    """A rangefinder with its reference cable in a humid room; `delay_m` gives each step's error from the humidity."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(STEPS), ROWS)
    humidity = rng.permutation(np.linspace(8.0, 92.0, STEPS))
    distance = rng.uniform(0.5, 6.0, step.size)
    shared = rng.normal(0.0, SHARED_M, STEPS) + delay_m(humidity)
    return columns_of(pa.table({
        "step": step, "time_s": step * 900.0 + np.tile(np.arange(ROWS), STEPS),
        "relative_humidity": humidity[step], "housing_temperature_c": rng.uniform(24.0, 26.0, STEPS)[step],
        "true_range_m": distance, "sim_distance_m": distance, "sim_distance_m_std": np.full(step.size, SIGMA_M),
        "sim_distance_m_repeat_std": np.full(step.size, SHARED_M),
        "distance_m": distance + shared[step] + rng.normal(0.0, SIGMA_M, step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [4, 5])
def test_water_in_a_cable_is_unknown_and_follows_the_humidity(seed):
    """Langmuir's isotherm: coverage K p / (1 + K p)."""

    def delay_m(humidity):
        return 4e-3 * humidity / (20.0 + humidity)

    (finding,) = diagnose(cable_table(seed, delay_m))[0].findings
    assert finding.effect == "unknown"
    assert finding.drivers[0] == "relative_humidity"


@pytest.mark.parametrize("seed", [6, 7])
def test_a_single_step_that_is_off_makes_no_law(seed):
    def delay_m(humidity):
        return np.where(humidity == humidity[2], 2e-3, 0.0)

    findings = diagnose(cable_table(seed, delay_m))[0].findings
    assert all(f.effect == "bench.repeatability" for f in findings)
