"""What one channel tells for sure is not called by another's name in the next, of what goes with it by chance."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

STEPS, ROWS, FRAMES = 28, 60, 20
MODULATION_HZ, LIGHT_M_PER_S = 20e6, 299_792_458.0


def camera_in_the_sun(seed, warmer_k):
    """A phase camera whose photogates the sun loads: their time constant grows with the current that it draws.

    The sensor's chip is warmer by up to `warmer_k` in the sun, and for other reasons.
    """
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(STEPS), ROWS)
    sun = rng.uniform(0.0, 950.0, STEPS)
    chip_c = 33.0 + warmer_k * sun / 950.0 + rng.normal(0.0, 1.5, STEPS)
    far = rng.uniform(1.5, 6.5, step.size)
    light = 9e3 * rng.choice([0.2, 0.5, 0.8], step.size) / far**2
    transfer_s = 4e-10 + 2.2e-11 * (sun / 950.0)[step]
    turn = 2.0 * np.pi * MODULATION_HZ
    # a gate that follows with one time constant passes 1 / (1 + jωτ), and less of a carrier's charge arrives in time
    passed = 1.0 / (1.0 + 1j * turn * transfer_s)
    nominal = 1.0 / (1.0 + 1j * turn * 4e-10)
    shift_m = -np.angle(passed / nominal) / turn * 0.5 * LIGHT_M_PER_S
    taken = np.abs(passed / nominal) * np.exp(-(transfer_s - 4e-10) / 8e-10)
    sigma, sigma_m = np.sqrt(light + 200.0), 0.6 / np.sqrt(light)
    return columns_of(pa.table({
        "step": step, "time_s": 60.0 * step + np.tile(np.arange(ROWS), STEPS), "irradiance_w_m2": sun[step],
        "tof_temperature_c": chip_c[step], "true_range_m": far, "n_frames": np.full(step.size, FRAMES),
        "sim_distance_m": far, "sim_distance_m_std": sigma_m, "sim_intensity_counts": light,
        "sim_intensity_counts_std": sigma,
        "distance_m": far + shift_m + sigma_m / np.sqrt(FRAMES) * rng.normal(size=step.size),
        "intensity_counts": light * taken + sigma / np.sqrt(FRAMES) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_what_the_sun_does_to_both_channels_is_no_drift_of_the_chip_in_one():
    found = diagnose(camera_in_the_sun(1, 6.0))[0].findings
    assert {f.channels[0] for f in found} == {"intensity_counts", "distance_m"}
    assert all(f.effect == "unknown" and f.drivers[0] == "irradiance_w_m2" for f in found)
