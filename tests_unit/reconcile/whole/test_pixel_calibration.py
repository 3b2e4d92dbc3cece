"""Pixels calibrated on the aged recording hide the mean of what ages: the change must keep its name."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.pixel_calibration import calibrated_by_pixel
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

CYCLES, ANGLES, COLUMNS, ROWS = 6, 4, 14, 6


def aged_table(seed, *, narrowing, by_pixel):
    """A wall seen by a flash sensor whose Gaussian beam of 40° by 12° narrows with every cycle."""
    rng = np.random.default_rng(seed)
    cycle, angle, u, v = (
        a.ravel().astype(float)
        for a in np.meshgrid(*(np.arange(n) for n in (CYCLES, ANGLES, COLUMNS, ROWS)), indexing="ij")
    )
    azimuth, elevation = (u - 6.5) * 5.0, (v - 2.5) * 3.5

    def light(width):
        return np.exp(-((azimuth / (40.0 * width)) ** 2) - (elevation / (12.0 * width)) ** 2)

    reflectance = np.array([0.1, 0.35, 0.6, 0.8])[((u + 3 * angle) % 4).astype(int)]
    simulated = 3000.0 * reflectance * light(1.0)
    sigma = np.hypot(8.0, 0.02 * simulated)
    frames = 10.0
    measured = simulated * light(1.0 - narrowing * cycle) / light(1.0) + sigma / np.sqrt(frames) * rng.normal(
        size=cycle.size
    )
    if by_pixel:
        pixel = (u * ROWS + v).astype(int)
        weight = (simulated / sigma) ** 2
        gain = np.bincount(pixel, weight * measured / simulated) / np.bincount(pixel, weight)
        simulated, sigma = simulated * gain[pixel], sigma * gain[pixel]
    return columns_of(pa.table({
        "cycle": cycle + 1.0, "step": cycle, "stage_angle_deg": 7.0 * angle, "pixel_u": u, "pixel_v": v,
        "azimuth_deg": azimuth, "elevation_deg": elevation, "n_frames": np.full(cycle.size, frames),
        "surface": np.array(["a", "b", "c", "d"])[((u + 3 * angle) % 4).astype(int)],
        "intensity_counts": measured, "sim_intensity_counts": simulated, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 1e-3 * simulated,
    }))  # fmt: skip


@pytest.mark.parametrize("by_pixel", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_calibration_of_pixels_is_told_from_a_good_simulation(by_pixel, seed):
    assert calibrated_by_pixel(aged_table(seed, narrowing=0.0, by_pixel=by_pixel), "intensity_counts") == by_pixel


def test_a_beam_that_narrows_is_named_alone_after_pixels_were_calibrated_on_it():
    findings = diagnose(aged_table(3, narrowing=0.006, by_pixel=True))[0].findings
    assert [f.effect for f in findings] == ["beam.profile_change"]
    assert findings[0].drivers[0] == "cycle"


def units_table(seed, *, gains, common):
    """Three devices whose pixels differ; the simulation's pixels bear one table for all of them, or none."""
    rng = np.random.default_rng(seed)
    dut, step, angle, u, v = (
        a.ravel().astype(float) for a in np.meshgrid(*(np.arange(n) for n in (3, 4, 3, 10, 5)), indexing="ij")
    )
    pixel, unit = (u * 5 + v).astype(int), (dut * 50 + u * 5 + v).astype(int)
    simulated = 800.0 + 300.0 * np.cos(0.7 * u + angle)
    sigma = np.hypot(6.0, 0.02 * simulated)
    response = 1.0 + gains * rng.normal(size=150)[unit]
    measured = simulated * response + sigma / np.sqrt(10.0) * rng.normal(size=dut.size)
    if common:
        weight = (simulated / sigma) ** 2
        gain = np.bincount(pixel, weight * measured / simulated) / np.bincount(pixel, weight)
        simulated, sigma = simulated * gain[pixel], sigma * gain[pixel]
    return columns_of(pa.table({
        "dut": np.array(["A", "B", "C"])[dut.astype(int)], "step": step, "stage_angle_deg": 7.0 * angle,
        "pixel_u": u, "pixel_v": v, "n_frames": np.full(dut.size, 10.0), "intensity_counts": measured,
        "sim_intensity_counts": simulated, "sim_intensity_counts_std": sigma,
    }))  # fmt: skip


@pytest.mark.parametrize("gains", [0.0, 0.02])
@pytest.mark.parametrize("common", [True, False])
def test_one_calibration_of_pixels_for_all_devices_is_told_as_well(gains, common):
    assert calibrated_by_pixel(units_table(5, gains=gains, common=common), "intensity_counts") == common


def gain_table(seed, *, lost):
    """Three devices whose avalanche gain drifts; a zero was fitted to each before a part of the rows was lost."""
    rng = np.random.default_rng(seed)
    step, angle, pixel, unit = (
        a.ravel() for a in np.meshgrid(np.arange(6), np.arange(7), np.arange(18), np.arange(3), indexing="ij")
    )
    warm = 17.0 * step - 1.0
    plain = 3000.0 * np.geomspace(0.03, 1.0, 126)[rng.permutation(126)][18 * angle + pixel]
    breakdown, bias = 55.0 + 0.14 * (warm - 34.0), 50.0 + 0.14 * 0.94 * (warm - 34.0)
    true = plain / (1.0 - (bias / breakdown) ** 1.2) * (1.0 - (50.0 / 55.0) ** 1.2)
    sigma = np.sqrt(36.0 + 0.3 * plain)
    measured = true + sigma / np.sqrt(20.0) * rng.normal(size=plain.size)
    for k in range(3):
        mine = unit == k
        measured[mine] -= np.sum(((measured - plain) / sigma**2)[mine]) / np.sum(1.0 / sigma[mine] ** 2)
    shown = rng.random(step.size) >= lost
    table = {
        "dut": np.array(["a", "b", "c"])[unit], "step": step.astype(float), "stage_angle_deg": 9.0 * angle,
        "pixel_u": pixel % 6 * 12.0, "pixel_v": pixel // 6 * 7.0, "tof_temperature_c": warm,
        "n_frames": np.full(step.size, 20.0), "intensity_counts": measured, "sim_intensity_counts": plain,
        "sim_intensity_counts_std": sigma, "sim_intensity_counts_repeat_std": 4e-3 * plain,
    }  # fmt: skip
    return columns_of(pa.table({name: x[shown] for name, x in table.items()}))


@pytest.mark.parametrize("lost", [0.0, 0.01])
def test_a_zero_that_was_fitted_to_more_rows_is_no_pattern_of_pixels(lost):
    findings = diagnose(gain_table(6, lost=lost))[0].findings
    assert [f.effect for f in findings] == ["detector.gain_temperature"]
