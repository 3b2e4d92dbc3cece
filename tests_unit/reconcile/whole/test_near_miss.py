"""A laser that loses its light slowly at first, seen faintly: a law alone says that it does, and no name is sure."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

STEPS = 24


def soaks(seed, loss_per_kelvin):
    """Steps in no order; from 31 °C on the laser loses light, and many other columns were recorded."""
    rng = np.random.default_rng(seed)
    step, stop, u = (a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(8), np.arange(5), indexing="ij"))
    soak = rng.permutation(np.linspace(-20.0, 80.0, STEPS))
    die = soak + rng.normal(0.0, 2.0, STEPS) + 8.0
    laser = 0.2 * soak + 22.0 + rng.normal(0.0, 1.5, STEPS)
    light = np.array([250.0, 520.0, 900.0, 1400.0])[(stop + u) % 4] * (1.0 + 0.02 * u)
    sigma = np.sqrt(40.0 + 0.8 * light)
    kept = 1.0 - loss_per_kelvin * np.clip(laser - 31.0, 0.0, None)[step]
    shared = 1.0 + 0.001 * rng.normal(size=STEPS)[step]
    read = lambda true, error: true[step] + rng.normal(0.0, error, step.size)  # noqa: E731
    return columns_of(pa.table({
        "step": step.astype(float), "time_s": 1800.0 * step + 20.0 * stop, "laser_temperature_c": read(laser, 0.05),
        "tof_temperature_c": read(die, 0.1), "fpga_temperature_c": read(die + 5.0, 0.2),
        "relative_humidity": read(40.0 + 10.0 * rng.normal(size=STEPS), 0.3),
        "rail_1v8_v": 1.8 * (1.0 - 2e-5 * read(die, 20.0)), "rail_12v0_v": 12.0 * (1.0 - 2e-5 * read(die, 20.0)),
        "pixel_u": 8.0 * u, "stage_angle_deg": 5.0 * stop, "n_frames": np.full(step.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.001 * light,
        "intensity_counts": light * kept * shared + sigma / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_an_effect_of_the_library_that_came_near_stands_for_the_law():
    (found,) = diagnose(soaks(28, 0.0006))[0].findings
    assert "laser.thermal_rolloff" in {found.effect, *found.equivalent_to}
    assert found.drivers == ["laser_temperature_c"]
    assert found.channels == ["intensity_counts"]


def test_without_the_effect_nothing_is_named():
    assert diagnose(soaks(28, 0.0))[0].findings == []
