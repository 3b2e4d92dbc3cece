"""Lasers that age at temperatures of their own, heat themselves by the duty cycle, or jitter near their threshold."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

BOLTZMANN_EV = 8.617e-5


@pytest.mark.parametrize("driven", [[1.7], [1.6, 1.75, 1.85]])
def test_defects_that_steal_current_at_three_temperatures_are_a_decay(driven):
    """Defects grow in step with their number, by Arrhenius' law; the light lacks what they steal."""
    rng = np.random.default_rng(8)
    unit, hour, which = (a.ravel() for a in np.meshgrid(np.arange(9), np.arange(30), np.arange(len(driven))))
    plate = np.array([40.0, 60.0, 80.0])[unit // 3]
    defects = np.ones(unit.size)
    for _ in range(200):  # of 150 hours each at the end
        rate = 4e-6 * np.exp(-0.45 / BOLTZMANN_EV * (1.0 / (plate + 273.15) - 1.0 / 353.15))
        defects = defects + rate * defects * hour * 150.0 / 200.0
    current = np.array(driven)[which]
    light = 0.12 * (current - 0.55 - 0.35 * (defects - 1.0))
    simulated = 0.12 * (current - 0.55)
    std = np.full(unit.size, 4e-4)
    made = columns_of(pa.table({
        "dut": np.char.add("D", unit.astype(str)), "operating_hours": hour * 150.0, "plate_temperature_c": plate,
        "drive_current_a": current, "n_frames": np.ones(unit.size), "sim_photodiode_a": simulated,
        "sim_photodiode_a_std": std, "photodiode_a": light + std * rng.normal(size=unit.size),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "laser.power_decay"
    assert {"operating_hours", "plate_temperature_c"} <= set(found.drivers)
    energy = next(p for p in found.parameters if p.name == "activation_energy")
    assert energy.value == pytest.approx(0.45, abs=0.06)


def test_a_laser_heats_itself_for_as_long_as_it_is_on():
    rng = np.random.default_rng(9)
    current, sink, duty = (
        a.ravel() for a in np.meshgrid(np.linspace(0.2, 2.4, 23), [15.0, 30.0, 45.0], [0.02, 0.3, 1.0])
    )
    light, junction = np.zeros(current.size), sink.copy()
    for _ in range(300):  # of heat and light in balance
        threshold = 0.3 * np.exp((junction - 25.0) / 150.0)
        light = 0.8 * np.exp(-(junction - 25.0) / 900.0) * np.maximum(current - threshold, 0.0)
        junction = 0.5 * junction + 0.5 * (sink + 9.0 * duty * (current * (1.4 + 0.15 * current) - light))
    cold = 0.8 * np.maximum(current - 0.3, 0.0)
    std = np.hypot(0.003, 0.01 * cold)
    made = columns_of(pa.table({
        "laser_current_a": current, "heatsink_temperature_c": sink, "duty_cycle": duty,
        "sim_optical_power_w": cold, "sim_optical_power_w_std": std,
        "optical_power_w": light + std * rng.normal(size=current.size),
    }))  # fmt: skip
    (found,) = diagnose(made)[0].findings
    assert found.effect == "laser.thermal_rolloff"
    assert "duty_cycle" in found.expression


def test_pulses_that_scatter_near_the_threshold_are_the_laser_s():
    """Every frame has one pulse energy for all pixels; near its threshold a laser hardly knows how much."""
    rng = np.random.default_rng(10)
    record, pixel = (a.ravel() for a in np.meshgrid(np.arange(60), np.arange(16), indexing="ij"))
    current = rng.permutation(np.linspace(1.15, 3.0, 60))[record]
    light = np.linspace(200.0, 3000.0, 16)[pixel] * (current - 1.0)
    std = np.sqrt(25.0 + 0.3 * light)
    jitter = 0.008 / (current - 0.9)
    energy = 1.0 + jitter[:, None] * ((rng.gamma(4.0, 1.0, (60, 24)) - 4.0) / 2.0)[record]
    frames = light[:, None] * energy + std[:, None] * rng.normal(size=(record.size, 24))
    made = columns_of(pa.table({
        "frame_set": record, "pixel_u": pixel, "laser_current_a": current, "n_frames": np.full(record.size, 24.0),
        "time_s": 7.0 * record, "sim_intensity_counts": light, "sim_intensity_counts_std": std,
        "intensity_counts": frames.mean(axis=1), "intensity_counts_std": frames.std(axis=1, ddof=1),
    }))  # fmt: skip
    first = diagnose(made)[0].findings[0]
    assert first.effect == "laser.pulse_energy_jitter"
    assert first.drivers[0] == "laser_current_a"
