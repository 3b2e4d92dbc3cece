"""What is beside a sensor has temperatures of its own: a bench that grows is no clock, a setpoint no thermometer."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def bars_on_a_bench(seed, thermometer, per_kelvin=6e-6):
    """Retro-reflectors stand on a block whose length follows its temperature; the unit's laser counts wavelengths."""
    rng = np.random.default_rng(seed)
    step, place, _ = (a.ravel() for a in np.meshgrid(np.arange(14), np.arange(20), np.arange(6), indexing="ij"))
    block = 20.0 + np.cumsum(rng.normal(0.0, 1.2, 14))
    nominal = np.linspace(0.6, 30.0, 20)[place]
    true = nominal * (1.0 + per_kelvin * (block[step] - 20.0))
    return columns_of(pa.table({
        "step": step.astype(float), "true_range_m": nominal,
        thermometer: block[step] + rng.normal(0.0, 0.1, step.size),
        "pressure_pa": 97000.0 + rng.normal(0.0, 60.0, 14)[step], "n_frames": np.full(step.size, 9.0),
        "sim_distance_m": nominal, "sim_distance_m_std": np.full(step.size, 6e-4),
        "sim_distance_m_repeat_std": np.full(step.size, 1e-4),
        "distance_m": true + 1e-4 * rng.normal(size=14)[step] + 2e-4 * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("thermometer", ["granite_temperature_c", "rail_temperature_c"])
def test_a_block_that_grows_is_no_effect_of_the_sensor(thermometer):
    (found,) = diagnose(bars_on_a_bench(3, thermometer))[0].findings
    assert found.effect == "unknown"
    assert thermometer in found.drivers


def test_the_same_by_the_sensors_own_thermometer_is():
    found = diagnose(bars_on_a_bench(3, "housing_temperature_c"))[0].findings
    assert found[0].effect == "timing.temperature_offset"


@pytest.mark.parametrize("seed", [1, 2])
def test_of_two_temperatures_that_say_as_much_the_logged_one_drives(seed):
    rng = np.random.default_rng(seed)
    cycle, step, stop = (a.ravel() for a in np.meshgrid(np.arange(2), np.arange(13), np.arange(36), indexing="ij"))
    soak = np.array([-20.0, 0.0, 20.0, 40.0, 55.0, 70.0, 80.0, 70.0, 55.0, 40.0, 20.0, 0.0, -20.0])
    laser = (0.25 * soak + 22.0 + rng.normal(0.0, 0.4, (2, 13)))[cycle, step]
    light = np.array([250.0, 520.0, 900.0, 1400.0])[stop % 4]
    sigma = np.sqrt(40.0 + 0.8 * light)
    kept = (1.0 - 0.0006 * np.clip(laser - 30.0, 0.0, None)) * (1.0 + 0.0012 * rng.normal(size=(2, 13))[cycle, step])
    table = columns_of(pa.table({
        "cycle": cycle.astype(float), "step": step.astype(float), "set_temperature_c": soak[step],
        "time_s": 30000.0 * cycle + 1800.0 * step + 8.0 * stop, "stage_angle_deg": 10.0 * stop,
        "laser_temperature_c": laser + rng.normal(0.0, 0.05, laser.size), "n_frames": np.full(step.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.0012 * light,
        "intensity_counts": light * kept + sigma / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip
    (found,) = diagnose(table)[0].findings
    assert (found.effect, found.drivers) == ("laser.thermal_rolloff", ["laser_temperature_c"])
