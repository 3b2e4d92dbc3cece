"""Frost of separate crystals: once the window is white, more ice takes no more light, and it stays white for long."""

import numpy as np

from arl_fixtures.reconcile.reconcile import diagnose
from tests_unit.reconcile.whole.test_frost_of_unrecorded_moisture import pressure_hpa
from tests_unit.reconcile.whole.test_seldom_names import columns_of, grid


def covered(mass, crystals=400, seed=8):
    """Share of a window under discs that grow where they began; their area goes with the mass of one crystal each."""
    rng = np.random.default_rng(seed)
    sites = rng.uniform(0.0, 1.0, (crystals, 2))
    across, down = np.meshgrid(np.linspace(0.0, 1.0, 120), np.linspace(0.0, 1.0, 120))
    nearest = np.min(np.hypot(across.ravel() - sites[:, :1], down.ravel() - sites[:, 1:]), axis=0)
    return np.array([np.mean(nearest < np.sqrt(m / (np.pi * crystals))) for m in mass])


def clinging(windows_c, hold_s, frost_point_c=-9.0):
    """Ice at the end of each step: slow to go into still air as long as it is frozen, gone at once when it melts."""
    grown, ice = 0.0, []
    for window in windows_c:
        for _ in range(60):
            surplus = pressure_hpa(frost_point_c) - pressure_hpa(window)
            grown += hold_s / 60.0 * (surplus if surplus > 0.0 else 0.1 * surplus)
            grown = max(grown, 0.0) if window < 0.0 else 0.0
        ice.append(grown)
    return np.array(ice)


def test_a_window_that_is_white_takes_no_more_light_with_more_ice():
    rng = np.random.default_rng(6)
    temperatures = np.array([25.0, 60.0, 28.0, 1.0, -8.0, -18.0, -28.0, -38.0, -18.0, -8.0, 1.0, 11.0, 25.0])
    ramps = np.array([1.0] * 2 + [-1.0] * 6 + [1.0] * 5)
    ice = clinging(temperatures - 6.0, 1500.0)
    cycle, step, stop, pixel = grid(np.arange(3), np.arange(13), np.arange(1, 4), np.arange(15))
    row = rng.permutation(np.linspace(0.0, 31.0, 15))[pixel]
    light = 900.0 * np.array([0.2, 0.5, 0.8, 0.5, 0.2])[stop]
    noise = np.sqrt(light + 16.0)
    white = covered(8.0 * ice / ice.max())
    assert white[7] < 1.1 * white[6]  # it hardly whitens in the coldest step
    clear = 1.0 - 0.03 * white[step] * (1.0 + 0.5 * (row - 15.5) / 15.5)
    made = columns_of(
        {
            "cycle": cycle + 1.0, "step": step, "ramp": ramps[step], "set_temperature_c": temperatures[step],
            "housing_temperature_c": temperatures[step] + rng.normal(0.0, 0.2, (3, 13))[cycle, step],
            "time_s": 1500.0 * step + 20.0 * stop + 1400.0, "stage_angle_deg": 10.0 * (stop - 2.0),
            "pixel_u": 8 * pixel, "pixel_v": row, "n_frames": np.full(step.size, 60.0),
            "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
            "sim_intensity_counts_repeat_std": 0.003 * light,
            "intensity_counts": light * clear * (1.0 + 0.003 * rng.normal(size=(3, 13)))[cycle, step]
            + rng.normal(0.0, noise / np.sqrt(60.0)),
        },
    )  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "optics.window_frost"
    (full,) = [p for p in found.parameters if p.name == "full"]
    assert full.value < 0.5 * ice.max()
