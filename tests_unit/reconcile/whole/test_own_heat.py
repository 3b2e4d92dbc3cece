"""A laser that warms itself: its junction's balance of heat is solved, the simulation holds it at the heat sink's."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

RIVALS = [
    library()[name]
    for name in (
        "laser.thermal_rolloff", "laser.power_decay", "detector.compression", "detector.gain_temperature",
        "detector.dark_offset", "bench.repeatability",
    )
]  # fmt: skip


def diode(current, sink, resistance, threshold, slope):
    """Power and voltage of a diode whose junction lies `resistance` K/W of its lost power above the heat sink."""
    junction = sink.copy()
    for _ in range(60):
        limit = threshold * np.exp((junction - 25.0) / 95.0)
        power = slope * np.exp(-(junction - 25.0) / 260.0) * 0.01 * np.logaddexp(0.0, (current - limit) / 0.01)
        voltage = 1.6 - 0.0011 * (junction - 25.0) + 0.12 * current
        junction = 0.5 * junction + 0.5 * (sink + resistance * (current * voltage - power))
    return power, voltage


def burn_in(seed, resistance, voltages=True):
    rng = np.random.default_rng(seed)
    device, cycle, level, place = (
        part.ravel() for part in np.meshgrid(np.arange(2), np.arange(4), np.arange(3), np.arange(22), indexing="ij")
    )
    current, sink = 0.1 + 0.12 * place, 20.0 + 20.0 * level + 0.1 * rng.normal(size=place.size)
    threshold, slope = np.array([0.45, 0.49])[device], np.array([0.9, 0.86])[device]
    cold, cold_v = diode(current, sink, 0.0, threshold, slope)
    warm, warm_v = diode(current, sink, resistance, threshold, slope)
    step = rng.normal(size=(4, 3))[cycle, level]
    sigma = np.hypot(0.0015, 0.003 * cold)
    columns = {
        "dut": np.array(["L1", "L2"])[device], "cycle": cycle.astype(float), "step": level.astype(float),
        "set_temperature_c": 20.0 + 20.0 * level, "heatsink_temperature_c": sink, "laser_current_a": current,
        "n_frames": np.full(place.size, 4.0), "sim_optical_power_w": cold, "sim_optical_power_w_std": sigma,
        "sim_optical_power_w_repeat_std": 0.001 * cold,
        "optical_power_w": warm * (1.0 + 0.001 * step) + sigma / 2.0 * rng.normal(size=place.size),
    }  # fmt: skip
    if voltages:
        columns |= {
            "sim_laser_voltage_v": cold_v, "sim_laser_voltage_v_std": np.full(place.size, 0.002),
            "laser_voltage_v": warm_v + 0.001 * rng.normal(size=place.size),
        }  # fmt: skip
    return columns_of(pa.table(columns))


@pytest.mark.parametrize("voltages", [True, False])
def test_a_diode_that_warms_itself_is_a_rolloff_by_its_own_heat(voltages):
    (found,) = diagnose(burn_in(3, 1.5, voltages), effects=RIVALS)[0].findings
    assert found.effect == "laser.thermal_rolloff"
    assert found.drivers == ["laser_current_a"]
    assert ("laser_voltage_v" in found.channels) == voltages
    # 1.5 K/W of 2.6 A · 1.9 V less 1.7 W of light are 5 K: 1/95 of the threshold each
    values = {p.name: p.value for p in found.parameters}
    gone = values["threshold_shift"] / 0.47 + values["loss"]
    assert 0.04 < gone < 0.12


def test_a_diode_at_its_heat_sinks_temperature_is_consistent():
    assert diagnose(burn_in(4, 0.0), effects=RIVALS)[0].verdict == "consistent"
