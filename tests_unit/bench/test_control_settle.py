"""The control law on the thermal plant, and the settling rule."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.bench.control import CascadedControl, ControlSettings, ControlState, advance
from arl_fixtures.bench.settle import SettleSettings, SettleWatch
from arl_fixtures.twin.thermal import ThermalPlant


def drive(plant, control, target_c, duration_s, powered=(True, True, True)):
    """Run the loop on the plant; returns mean housing temperatures each 5 s."""
    trace, time_s = [], control.state.time_s
    for _ in range(int(duration_s / 5)):
        setpoint_c = control.next_setpoint_c(target_c, float(np.mean(plant.housing_c)), time_s)
        time_s += 5
        plant.advance(time_s, setpoint_c, powered)
        trace.append(float(np.mean(plant.housing_c)))
    return np.array(trace)


@pytest.mark.parametrize("target_c", [-10.0, 28.0, 85.0])
def test_every_target_is_reached_with_less_than_one_kelvin_of_overshoot(target_c):
    plant = ThermalPlant(start_s=0.0)
    control = CascadedControl(ControlSettings(), setpoint_c=23.0, now_s=0.0)
    trace = drive(plant, control, target_c, 3600)
    direction = np.sign(target_c - 23.0)
    assert np.max(direction * (trace - target_c)) < 1.0
    assert abs(trace[-1] - target_c) < 0.1  # integral action removes the self-heating's offset


def test_the_integrator_does_not_wind_up_at_the_clamp():
    settings = ControlSettings(setpoint_maximum_c=40.0)
    plant = ThermalPlant(start_s=0.0)
    control = CascadedControl(settings, setpoint_c=23.0, now_s=0.0)
    drive(plant, control, 85.0, 7200)  # out of reach for two hours
    trace = drive(plant, control, 30.0, 1800)
    assert np.min(trace) > 29.0  # a wound-up integrator would hold the set-point up, a reversed one would dive
    assert abs(trace[-1] - 30.0) < 0.2


@given(
    setpoint=st.floats(-20, 95), integral=st.floats(-5, 5), target=st.floats(-10, 85), housing=st.floats(-40, 120),
    elapsed=st.floats(0.1, 60),
)
def test_setpoint_never_leaves_clamp_nor_ramp(setpoint, integral, target, housing, elapsed):
    settings = ControlSettings()
    after = advance(settings, ControlState(setpoint, integral, 0.0), target, housing, elapsed)
    assert settings.setpoint_minimum_c <= after.setpoint_c <= settings.setpoint_maximum_c
    assert abs(after.setpoint_c - setpoint) <= settings.setpoint_ramp_k_per_min * elapsed / 60 + 1e-9


def watch(**settings):
    return SettleWatch(SettleSettings(**settings), 25.0, start_s=0.0, start_mean_c=20.0)


def test_one_housing_outside_restarts_the_hold():
    w = watch(hold_s=60)
    assert w.see(0, {"T2": 25.1, "T3": 24.9}) is None
    assert w.see(50, {"T2": 25.1, "T3": 24.4}) is None
    assert w.see(60, {"T2": 25.1, "T3": 24.9}) is None
    assert w.see(119, {"T2": 25.1, "T3": 24.9}) is None
    report = w.see(120, {"T2": 25.1, "T3": 24.9})
    assert report is not None
    assert report.settled


def test_time_limit_names_the_sensor_and_how_far():
    w = watch(time_limit_s=100)
    report = w.see(100, {"T2": 25.0, "T3": 27.3, "T4": 24.0})
    assert report is not None
    assert not report.settled
    assert "T3" in report.reason
    assert "+2.3 K" in report.reason


def test_an_open_sensor_never_settles():
    w = watch(hold_s=0, time_limit_s=10)
    assert w.see(5, {"T2": 25.0, "T3": None}) is None
    report = w.see(10, {"T2": 25.0, "T3": None})
    assert report is not None
    assert not report.settled
    assert "T3 gives no value" in report.reason
