"""A reading that wanders by itself while nothing is changed: whatever law is found must not move it off further."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def wandering(seed):
    """Two hours before a still target; the error forgets half of itself in two minutes, the room's light varies."""
    rng = np.random.default_rng(seed)
    time = 0.5 + 1.2 * np.arange(6000)
    kept = 0.5 ** (1.2 / 120.0)
    wander, light = np.zeros(len(time)), np.zeros(len(time))
    for k in range(1, len(time)):
        wander[k] = kept * wander[k - 1] + np.sqrt(1.0 - kept**2) * rng.normal()
        light[k] = 0.999 * light[k - 1] + 0.045 * rng.normal()
    return {
        "time_s": time, "ambient_lux": 200.0 + 30.0 * light, "n_frames": np.full(len(time), 50),
        "supply_voltage_v": 3.3 + 0.005 * rng.normal(size=len(time)), "sim_distance_m": np.full(len(time), 0.0763),
        "sim_distance_m_std": np.full(len(time), 0.0041),
        "distance_m": 0.0763 + 0.0003 * wander + 0.0006 * rng.normal(size=len(time)),
    }  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_law_of_a_wandering_reading_sends_it_elsewhere(seed):
    table = wandering(seed)
    _, _, decision = diagnose(columns_of(pa.table(table)))
    (d,) = decision.problem.data
    before, after = d.residual(decision.problem.view.fresh_state()), d.residual(decision.final_state())
    assert np.std(after) < 1.02 * np.std(before)
