"""A setting that was changed in blocks, one after the other: what follows it also follows the order of the steps."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def afterpulsing(seed, probability):
    """Photon counters of which every count may release another: hold-off by hold-off, four bias voltages by turns."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(100), 48)
    holdoff = np.array([15.0, 25.0, 40.0, 80.0, 150.0])[step // 20]
    bias = np.array([2.0, 3.0, 4.0, 5.0])[step % 4]
    light = 6000.0 * np.array([0.03, 0.1, 0.3, 1.0])[(step // 4) % 4]
    chance = probability * (bias / 5.0) ** 2 * np.exp(-holdoff / 35.0)
    seen, released = light.copy(), light.copy()
    for _ in range(6):  # counts that counts release, and those that these do
        released = released * chance
        seen += released
    sigma = np.sqrt(light)
    shared = 0.003 * rng.normal(size=100)[step]
    return columns_of(pa.table({
        "step": step, "holdoff_ns": holdoff, "excess_bias_v": bias,
        "housing_temperature_c": 20.0 + 0.3 * rng.normal(size=100)[step],
        "humidity": 35.0 + 3.0 * rng.normal(size=100)[step],
        "pixel_u": np.tile(np.arange(48) % 8, 100), "pixel_v": np.tile(np.arange(48) // 8, 100),
        "n_frames": np.full(len(step), 10), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.003 * light,
        "intensity_counts": seen * (1.0 + shared) + sigma / np.sqrt(10.0) * rng.normal(size=len(step)),
    }))  # fmt: skip


def test_what_a_setting_does_is_no_ageing_with_the_steps():
    (found,) = diagnose(afterpulsing(31, 0.02))[0].findings
    assert found.effect == "unknown"
    assert {"holdoff_ns", "excess_bias_v"} & set(found.drivers)
