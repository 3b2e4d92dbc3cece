"""A channel that holds next to no counts but dark ones, and readings that step by less than they err."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [
    library()[name]
    for name in (
        "bench.repeatability", "detector.compression", "detector.dark_offset", "detector.gain_temperature",
        "readout.column_pattern", "readout.noise_excess", "timing.clock_scale", "timing.temperature_offset",
    )
]  # fmt: skip


def counters(seed):
    """20 zones before four targets, 14 steps up to 94 degrees: dark counts, and a fan that shakes ranges."""
    rng = np.random.default_rng(seed)
    step, place, zone = (a.ravel() for a in np.meshgrid(np.arange(14), np.arange(4), np.arange(20), indexing="ij"))
    hot = np.array([-10.0, 9.0, 28.0, 48.0, 68.5, 83.5, 93.0])[step % 7] + rng.normal(size=14)[step]
    grey, far = np.array([0.05, 0.18, 0.5, 0.88])[place], np.array([0.3, 1.1, 2.2, 3.4])[place]
    fan = rng.random(14)[step] < 0.5
    light = 0.033 + 0.094 * grey
    # thermal generation across half a band gap, counted over a gate of many pulses
    dark = 0.47 * np.exp(0.50 / 8.617e-5 * (1.0 / 367.0 - 1.0 / (273.15 + hot)))
    scatter = 0.0015 + 0.011 * (far / 3.4) ** 2 / np.sqrt(grey / 0.05)
    jitter = np.hypot(scatter, np.where(fan, 0.0022, 0.0))
    frames = rng.normal(size=(12, step.size)) * jitter
    own = 0.001 * rng.normal(size=14)[step]
    return columns_of(pa.table({
        "dut": np.full(step.size, "V1"), "step": step, "time_s": 600.0 * step + 60.0,
        "set_temperature_c": np.round(hot / 5.0) * 5.0 - 8.0, "tof_temperature_c": hot, "fan_on": fan,
        "pixel_u": zone % 5 + 1, "pixel_v": zone // 5 + 1, "true_range_m": far, "reflectance": grey,
        "n_frames": np.full(step.size, 12), "sim_ambient_counts": light, "sim_ambient_counts_std": np.ones(step.size),
        "sim_ambient_counts_repeat_std": 0.005 * light,
        "ambient_counts": (light + dark) * (1.0 + 0.005 * rng.normal(size=14)[step])
        + rng.normal(size=(12, step.size)).mean(axis=0),
        "sim_distance_m": far, "sim_distance_m_std": scatter, "sim_distance_m_repeat_std": np.full(step.size, 0.001),
        "distance_m": far + frames.mean(axis=0) + own, "distance_m_std": frames.std(axis=0, ddof=1),
    }))  # fmt: skip


def test_dark_counts_may_be_more_than_all_the_light_and_scatter_no_range_by_their_gain():
    found = diagnose(counters(7), effects=KNOWN)[0].findings
    assert {f.effect for f in found} == {"detector.dark_offset", "readout.noise_excess"}
    (dark,) = [f for f in found if f.effect == "detector.dark_offset"]
    (doubling,) = [p for p in dark.parameters if p.name == "doubling"]
    cool, hot = (np.log(2.0) * 8.617e-5 * t**2 / 0.50 for t in (321.0, 367.0))  # of that rate where it is seen
    assert cool < doubling.value < hot


def logged(seed, shared_k):
    """Two thermometers of one reading a row; one of them repeats from step to step by less than its channel says."""
    rng = np.random.default_rng(seed)
    step, k = (a.ravel() for a in np.meshgrid(np.arange(32), np.arange(25), indexing="ij"))
    goal = np.array([-40.0, -10.0, 20.0, 50.0, 85.0, 50.0, 20.0, -10.0])[step % 8]
    plate = goal + 8.0 * np.exp(-k / 6.0) * np.where(step % 8 < 5, -1.0, 1.0)
    shared = shared_k * rng.normal(size=32)[step]
    return columns_of(pa.table({
        "dut": np.array(["H1", "H2"])[step // 16], "cycle": 1 + step // 8 % 2, "step": step % 8,
        "time_s": 1200.0 * (step % 8) + 40.0 * k, "set_temperature_c": goal,
        "sim_housing_temperature_c": plate - 0.4, "sim_housing_temperature_c_std": np.full(step.size, 0.11),
        "housing_temperature_c": plate - 0.4 + shared + 0.11 * rng.normal(size=step.size),
    }))  # fmt: skip


def test_single_readings_whose_steps_differ_by_about_their_noise_are_no_finding():
    assert not diagnose(logged(3, 0.14), effects=KNOWN)[0].findings


def test_steps_that_differ_by_far_more_than_a_reading_are_one():
    (found,) = diagnose(logged(3, 0.6), effects=KNOWN)[0].findings
    assert found.effect == "bench.repeatability"
