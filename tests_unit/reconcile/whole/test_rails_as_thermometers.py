"""A core supply that sinks by a permille in the heat tells the temperature; it does not set a detector's gain."""

import numpy as np
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from tests_unit.reconcile.whole.test_seldom_names import columns_of, grid


def campaign(seed, lever):
    """Gain of a diode that falls in the heat; a 5 V rail that wanders by percents acts by `lever`."""
    rng = np.random.default_rng(seed)
    dut, cycle, step, stop = grid(np.arange(2), np.arange(3), np.arange(9), np.arange(40))
    soak = np.array([-30.0, -5.0, 20.0, 45.0, 70.0, 45.0, 20.0, -5.0, -30.0])
    hot = soak + rng.normal(0.0, 0.7, (2, 3, 9))
    wander = np.clip(0.02 + 0.008 * np.cumsum(rng.normal(size=(2, 3, 9)).reshape(2, -1), axis=1), 0.0, 0.05)
    die, supply = hot[dut, cycle, step] + 9.0, wander.reshape(2, 3, 9)[dut, cycle, step]
    light = np.array([200.0, 450.0, 900.0, 1500.0])[stop % 4]
    noise = np.sqrt(100.0 + 0.5 * light)
    barrier = 1.0 / (1.0 + np.exp((die - 390.0) / 90.0))  # carriers that escape by heat
    shared = 0.004 * rng.normal(size=(2, 3, 9))[dut, cycle, step]
    seen = light * barrier / np.median(barrier) * (1.0 + lever * (supply - np.median(supply))) * (1.0 + shared)
    rails = {
        name: volts * (1.0 - 2.2e-5 * (die - 34.0) + 6e-4 * rng.normal(size=die.size))
        for name, volts in (("rail_1v0_v", 1.0), ("rail_1v8_v", 1.8), ("rail_3v3_v", 3.3), ("rail_12v0_v", 12.0))
    }
    columns = columns_of(
        {
            "cycle": cycle, "step": step, "set_temperature_c": soak[step],
            "time_s": 1800.0 * step + 20.0 * stop, "tof_temperature_c": die + rng.normal(0.0, 0.1, die.size),
            "fpga_temperature_c": die + 5.0 + rng.normal(0.0, 0.2, die.size),
            "rail_5v0_v": 5.0 * (1.0 + supply) + rng.normal(0.0, 0.003, die.size), **rails,
            "stage_angle_deg": 9.0 * stop, "n_frames": np.full(die.size, 16.0), "sim_amplitude_counts": light,
            "sim_amplitude_counts_std": noise, "amplitude_counts": seen + rng.normal(0.0, noise / 4.0),
        },
    )  # fmt: skip
    columns.categories["dut"] = (dut.astype(np.int64), ("U1", "U2"))
    return columns


@pytest.mark.parametrize("seed", [1, 2])
def test_a_gain_that_falls_in_the_heat_is_no_lever_of_a_core_supply(seed):
    found = diagnose(campaign(seed, 0.7))[0].findings
    assert any("detector.gain_temperature" in {f.effect, *f.equivalent_to} for f in found)
    assert [f.drivers for f in found if f.effect == "electronics.rail_coupling"] in ([], [["rail_5v0_v"]])
