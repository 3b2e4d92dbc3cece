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


def pumped(seed, swing_mm):
    """Two alike thermal cycles of 17 steps; a coolant pump's beat swings the ranges by the cycle's clock."""
    rng = np.random.default_rng(seed)
    cycle, step, spot = (a.ravel() for a in np.meshgrid(np.arange(2), np.arange(17), np.arange(60), indexing="ij"))
    time = 1080.0 + 1400.0 * step + 12.0 * (step % 5)
    plate = np.concatenate([np.linspace(-10.0, 60.0, 9), np.linspace(51.0, -8.0, 8)])
    warm = plate[step] + 12.0 * np.exp(-time / 4000.0) + 0.2 * rng.normal(size=34)[17 * cycle + step]
    far = 2.0 + 0.01 * spot
    bearing = 2.0 * np.pi * time / 6430.0  # the bracket answers the pump, whose speed beats with the mains
    moved = swing_mm * np.sin(bearing)
    return columns_of(pa.table({
        "dut": np.full(time.size, "A"), "cycle": cycle, "step": step, "time_s": time, "pixel_u": spot,
        "set_temperature_c": plate[step], "ramp": np.where(step < 9, 1, -1),
        "housing_temperature_c": warm, "tof_temperature_c": warm + 9.0 + 0.3 * rng.normal(size=34)[17 * cycle + step],
        "n_frames": np.full(time.size, 25.0), "sim_distance_m": far, "sim_distance_m_std": np.full(time.size, 0.023),
        "distance_m": far + 1e-3 * moved + 0.023 / 5.0 * rng.normal(size=time.size),
    }))  # fmt: skip


def test_a_beat_with_the_clock_of_each_cycle_is_no_curve_of_temperatures():
    """As many coefficients as there are steps tell any law of these: several curves of what was set did so."""
    (found,) = diagnose(pumped(1, 12.0))[0].findings
    assert found.effect == "unknown"
    assert found.drivers[0] == "time_s"


def test_steps_that_scatter_are_no_beat():
    rng = np.random.default_rng(9)
    table = pumped(5, 0.0)
    shift = 0.008 * rng.normal(size=34)
    code = (17 * table.numbers["cycle"] + table.numbers["step"]).astype(int)
    table.numbers["distance_m"] = table.numbers["distance_m"] + shift[code]
    assert not diagnose(table)[0].findings
