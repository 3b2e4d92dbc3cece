"""Operating data follow the nominal model of bench and sensor."""

import numpy as np
import pytest

from arl_fixtures.twin.operating import OperatingSettings, operating_data

NOMINAL = OperatingSettings()


def test_nominal_values_at_85_degrees():
    data = operating_data(NOMINAL, 85.0)
    assert data["fpga_temperature_c"] == 99.0
    assert data["tof_temperature_c"] == 94.0
    assert data["laser_temperature_c"] == pytest.approx(25 + 0.04 * 60)
    assert data["tec_current_a"] == pytest.approx(1.8)
    assert data["tec_voltage_p_v"] == pytest.approx(2.5 + 0.6 * 1.8)
    assert data["tec_voltage_n_v"] == pytest.approx(2.5 - 0.6 * 1.8)
    assert data["laser_current_a"] == 90.0
    assert data["laser_voltage_v"] == pytest.approx(24.0 - 0.6)
    assert data["pump_time_us"] == 180.0
    assert data["rail_12v0_v"] == pytest.approx(12 * (1 - 20e-6 * 60))


def test_tec_current_is_clipped_both_ways():
    assert operating_data(NOMINAL, 150.0)["tec_current_a"] == 2.5
    assert operating_data(NOMINAL, -100.0)["tec_current_a"] == -2.5


def test_noise_is_a_tenth_of_a_percent_or_a_tenth_of_a_kelvin():
    rng = np.random.default_rng(1)
    rows = [operating_data(NOMINAL, 60.0, rng) for _ in range(1500)]
    for name, nominal in operating_data(NOMINAL, 60.0).items():
        values = np.array([row[name] for row in rows])
        expected = 0.1 if name.endswith("_c") else 0.001 * abs(nominal)
        assert values.std() == pytest.approx(expected, rel=0.1), name
        assert values.mean() == pytest.approx(nominal, abs=5 * expected / np.sqrt(len(rows))), name
