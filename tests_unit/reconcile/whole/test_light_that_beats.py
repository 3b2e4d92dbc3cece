"""A lamp of the laboratory flickers with the mains and beats with the exposures: light that comes and goes."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

BRIGHT, KNOWN = 1.0, 0.9
"""Counts of the lamp in the mean, and those that its user found in the dark and put into the simulation."""
MAINS_HZ, FRAME_S, EXPOSURE_S = 50.0, 0.05, 0.002


def lamp(time_s, detune_hz):
    """Light of a lamp over each exposure of ten frames, gone through in steps of a fifth of a millisecond.

    Twice in a mains period a discharge lights up; its mains is off the frames' clock by a few millihertz.
    """
    shots = time_s[:, None, None] + FRAME_S * np.arange(10)[:, None] + np.linspace(0.0, EXPOSURE_S, 11)
    return (1.0 + 0.7 * np.cos(4.0 * np.pi * (MAINS_HZ + detune_hz) * shots)).mean(axis=(1, 2))


@pytest.mark.parametrize("detune_hz", [0.0023, 0.0011])
def test_light_that_beats_is_no_surface(detune_hz):
    rng = np.random.default_rng(5)
    step, stop, pixel = (a.ravel() for a in np.meshgrid(np.arange(8), np.arange(18), np.arange(24), indexing="ij"))
    stops = np.sort(rng.choice(40, 18, replace=False))
    time = 1400.0 * np.arange(8)[:, None] + 21.7 * stops
    board = (pixel + stop) % 3
    light = np.array([70.0, 400.0, 1500.0])[board] * (1.0 + 0.004 * pixel)
    noise = np.sqrt(36.0 + 0.25 * light)
    added = BRIGHT * lamp(time.ravel(), detune_hz)[step * 18 + stop]
    made = columns_of(pa.table({
        "step": step, "time_s": time[step, stop], "stage_angle_deg": 0.9 * stops[stop] - 20.0, "pixel_u": 3 * pixel,
        "surface": np.array(["wall", "grey", "white"])[board], "n_frames": np.full(step.size, 10.0),
        "housing_temperature_c": (-10.0 + 13.0 * np.arange(8))[step],
        "sim_intensity_counts": light + KNOWN, "sim_intensity_counts_std": noise,
        "intensity_counts": light + added + rng.normal(0.0, noise / np.sqrt(10.0)),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "unknown"
    assert found.drivers[0] == "time_s"


@pytest.mark.parametrize("seed", [1, 3])
def test_the_light_of_a_neighbour_is_told_by_the_device_that_sees_it(seed):
    """Three devices before one wall, their clocks free: the flash of one meets the exposures of another for a while.

    It does so every 22 minutes; the images' times are written to ten seconds.
    """
    rng = np.random.default_rng(seed)
    device, step, stop, pixel = (
        a.ravel() for a in np.meshgrid(np.arange(3), np.arange(10), np.arange(8), np.arange(24), indexing="ij")
    )
    times = np.round(rng.uniform(0.0, 1900.0, (3, 10, 8)) + 2000.0 * np.arange(10)[:, None], -1)
    time = times[device, step, stop]
    light = np.array([130.0, 620.0, 1570.0, 2700.0])[(pixel + stop) % 4] * (1.0 + 0.004 * pixel)
    noise = np.sqrt(36.0 + 0.25 * light)
    apart = np.abs(np.mod(time / 1330.0 + 0.2, 1.0) - 0.5)  # of both clocks, in turns
    seen = light * (1.0 + 0.009 * np.maximum(1.0 - apart / 0.16, 0.0) * (device == 1))
    made = columns_of(pa.table({
        "dut": np.array(["A", "B", "C"])[device], "step": step, "time_s": time, "stage_angle_deg": 4.0 * stop - 14.0,
        "pixel_u": 3 * pixel, "n_frames": np.full(step.size, 20.0),
        "housing_temperature_c": (-10.0 + 9.0 * np.arange(10))[step],
        "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "sim_intensity_counts_repeat_std": 1e-3 * light,
        "intensity_counts": seen + rng.normal(0.0, noise / np.sqrt(20.0)),
    }))  # fmt: skip
    (found,) = diagnose(made, effects=[])[0].findings
    assert set(found.drivers) == {"dut", "time_s"}
    first = {axis.column: axis for axis in found.law.terms[0].axes}
    assert first["dut"].label == "B"
    assert first["time_s"].at == pytest.approx(1330.0, rel=0.02)
