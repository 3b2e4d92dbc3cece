"""Frost whose moisture nobody recorded, on a bench that soaks: a mass balance of ice, of its own in every cycle."""

import numpy as np

from arl_fixtures.reconcile.reconcile import diagnose
from tests_unit.reconcile.whole.test_seldom_names import columns_of, grid


def pressure_hpa(temperature_c):
    """Saturation over ice (Magnus form of WMO)."""
    return 6.112 * np.exp(22.46 * temperature_c / (272.62 + temperature_c))


def iced(dew_points_c, temperatures_c, hold_s):
    """Ice on the window at the end of each step, (cycles, steps): it grows below the ice point and goes above."""
    ice = np.zeros((len(dew_points_c), len(temperatures_c)))
    for cycle, dew in enumerate(dew_points_c):
        grown = 0.0
        for step, window in enumerate(temperatures_c):
            for _ in range(60):
                grown = max(grown + hold_s / 60.0 * (pressure_hpa(dew) - pressure_hpa(window)), 0.0)
            ice[cycle, step] = grown
    return ice


def campaign(depth, seed=3):
    rng = np.random.default_rng(seed)
    temperatures = np.array([20.0, 10.0, 0.0, -10.0, -20.0, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0])
    ramps = np.array([-1.0] * 6 + [1.0] * 5)
    ice = iced(np.array([-13.0, -12.0, -14.0, -12.0, -15.0, -13.0]), temperatures, 1200.0)
    cycle, step, stop, pixel = grid(np.arange(6), np.arange(11), np.arange(5), np.arange(8))
    light = 900.0 * np.array([0.2, 0.5, 0.8, 0.5, 0.2])[stop] * (1.0 - 0.02 * (pixel - 3.5) ** 2)
    noise = np.sqrt(light + 16.0)
    clear = np.exp(-depth * (ice / ice.max())[cycle, step])
    return columns_of(
        {
            "cycle": cycle, "step": step, "ramp": ramps[step], "set_temperature_c": temperatures[step],
            "housing_temperature_c": temperatures[step] + rng.normal(0.0, 0.1, step.size),
            "time_s": 1200.0 * step + 20.0 * stop + 1150.0, "stage_angle_deg": 10.0 * (stop - 2.0),
            "pixel_u": pixel, "n_frames": np.full(step.size, 20.0),
            "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
            "sim_intensity_counts_repeat_std": np.full(step.size, 0.3),
            "intensity_counts": light * clear + 0.3 * rng.normal(size=(6, 11))[cycle, step]
            + rng.normal(0.0, noise / np.sqrt(20.0)),
        },
    )  # fmt: skip


def test_frost_keeps_its_name_where_every_cycle_brings_its_own_moisture():
    found = diagnose(campaign(0.08))[0].findings
    assert [finding.effect for finding in found] == ["optics.window_frost"]
