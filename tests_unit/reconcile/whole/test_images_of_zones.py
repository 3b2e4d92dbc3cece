"""A ranger of sixteen zones on a stage: each zone has a zero of its own, yet all of them look at once."""

import numpy as np
import pyarrow as pa
import pytest
from scipy.integrate import solve_ivp

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.grouping import find_groups
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

SETPOINTS_C = (-10.0, 14.0, 38.0, 62.0, 70.0, 50.0, 26.0, 2.0, -10.0)
DWELL_S, ANGLES, ZONES = 900.0, 12, 16
KNOWN = [library()[n] for n in ("timing.thermal_lag", "timing.temperature_offset", "bench.repeatability")]


def housing_c(cycle_s):
    """The chamber's setpoint through the wall of the housing."""
    step = np.minimum(cycle_s // DWELL_S, len(SETPOINTS_C) - 1).astype(int)
    before = np.array((SETPOINTS_C[-1], *SETPOINTS_C))[step]
    here = np.array(SETPOINTS_C)[step]
    return here + (before - here) * np.exp(-(cycle_s - step * DWELL_S) / 300.0)


def ranged(seed, slope_m_per_k, of_images_m):
    """Two cycles, each stop swept over; the clock's crystal follows the housing within twelve minutes."""
    rng = np.random.default_rng(seed)
    axes = np.meshgrid(np.arange(2), np.arange(len(SETPOINTS_C)), np.arange(ANGLES), np.arange(ZONES), indexing="ij")
    cycle, step, angle, zone = (a.ravel() for a in axes)
    moment = step * DWELL_S + 60.0 + 70.0 * angle
    grid = np.linspace(0.0, DWELL_S * len(SETPOINTS_C), 4001)
    crystal = solve_ivp(
        lambda t, y: (housing_c(np.array([t])) - y) / 720.0, (0.0, grid[-1]), [-10.0], t_eval=grid, max_step=30.0
    ).y[0]
    warm, image = housing_c(moment), (cycle * len(SETPOINTS_C) + step) * ANGLES + angle
    true_m = 17.0 + 0.4 * (zone % 4) + 0.05 * (zone // 4) + 0.1 * angle
    sim = true_m + slope_m_per_k * (warm - 25.0)
    off = 0.006 * rng.normal(size=(2, len(SETPOINTS_C)))[cycle, step] + of_images_m * rng.normal(size=432)[image]
    seen = true_m + slope_m_per_k * (np.interp(moment, grid, crystal) - 25.0) + off
    return columns_of(pa.table({
        "cycle": cycle, "step": step, "time_s": moment, "stage_angle_deg": 2.0 * angle - 11.0,
        "housing_temperature_c": warm, "zone": zone, "pixel_u": zone % 4, "pixel_v": zone // 4,
        "n_frames": np.full(zone.size, 100), "sim_distance_m": sim, "sim_distance_m_std": np.full(zone.size, 0.012),
        "sim_distance_m_repeat_std": np.full(zone.size, 0.006),
        "distance_m": seen + 0.0012 * rng.normal(size=zone.size),
    }))  # fmt: skip


def test_all_zones_are_of_one_image():
    groups = find_groups(ranged(0, 0.0, 0.0))
    assert groups.frame is not None
    assert int(groups.frame.max()) + 1 == 2 * len(SETPOINTS_C) * ANGLES
    assert set(np.bincount(groups.frame)) == {ZONES}


def test_a_lag_is_told_beside_images_that_scatter_and_so_is_their_scatter():
    found = {f.effect: f for f in diagnose(ranged(3, 0.0009, 0.003), effects=KNOWN)[0].findings}
    assert found.keys() == {"timing.thermal_lag", "bench.repeatability"}
    scatter = next(p for p in found["bench.repeatability"].parameters if p.name == "scatter")
    assert scatter.low < 0.003 < scatter.high
    lag = next(p for p in found["timing.thermal_lag"].parameters if p.name == "time_constant")
    assert lag.value == pytest.approx(720.0, rel=0.5)


def test_images_that_scatter_no_more_than_their_rows_are_none():
    assert diagnose(ranged(4, 0.0, 0.0), effects=KNOWN)[0].findings == []
