"""The thermal network against its differential equations, solved by scipy, and against its balances."""


import numpy as np
import pytest
from processor_time import processor_s
from scipy.integrate import solve_ivp

from arl_fixtures.twin.thermal import ThermalPlant, ThermalSettings

ALL_ON, ALL_OFF = (True, True, True), (False, False, False)


def run(plant: ThermalPlant, until_s: float, setpoint_c: float, powered=ALL_ON, *, every_s=1.0, circulating=True):
    """Advance in calls of `every_s` and return the last state."""
    times = np.arange(0.0, until_s + every_s / 2, every_s)
    for now_s in times:
        plant.advance(float(now_s), setpoint_c, powered, circulating)


def test_agrees_with_the_differential_equations():
    settings = ThermalSettings(transport_delay_s=0.0, substep_s=0.25)
    powered = (True, False, True)
    plant = ThermalPlant(settings, start_s=0.0)

    def rates(_t, state):
        coolant, plate, *housings = state
        coolant_rate = np.clip((60.0 - coolant) / 60.0, -2 / 60, 3 / 60)
        plate_rate = (150 * (coolant - plate) + sum(25 * (h - plate) for h in housings)) / 4500
        housing_rates = [
            (25 * (plate - h) + 0.6 * (23 - h) + 12 * on) / 900 for h, on in zip(housings, powered, strict=True)
        ]
        return [coolant_rate, plate_rate, *housing_rates]

    checks_s = np.array([30.0, 300.0, 700.0, 1500.0])
    exact = solve_ivp(rates, (0, 1500), [23.0] * 5, t_eval=checks_s, max_step=1.0, rtol=1e-8)
    for now_s, state in zip(checks_s, exact.y.T, strict=True):
        plant.advance(float(now_s), 60.0, powered)
        assert (plant.coolant_c, plant.plate_c, *plant.housing_c) == pytest.approx(tuple(state), abs=0.02)


def test_rests_at_ambient_without_power():
    plant = ThermalPlant()
    run(plant, 600, 23.0, ALL_OFF, every_s=60)
    assert (plant.coolant_c, plant.plate_c, *plant.housing_c) == pytest.approx((23.0,) * 5, abs=1e-9)


def test_steady_state_balances_the_heat():
    plant = ThermalPlant()
    run(plant, 7200, 70.0, every_s=600)
    housing_c, plate_c = plant.housing_c[0], plant.plate_c
    assert plant.coolant_c == pytest.approx(70.0, abs=1e-6)
    assert 25 * (housing_c - plate_c) + 0.6 * (housing_c - 23.0) == pytest.approx(12.0, abs=1e-6)
    assert 150 * (plate_c - 70.0) == pytest.approx(3 * 25 * (housing_c - plate_c), abs=1e-6)


@pytest.mark.parametrize(("setpoint_c", "rate_k_per_min"), [(85.0, 3.0), (-30.0, -2.0)])
def test_coolant_rate_is_limited(setpoint_c, rate_k_per_min):
    plant = ThermalPlant(start_s=0.0)
    plant.advance(240.0, setpoint_c, ALL_OFF)
    assert plant.coolant_c == pytest.approx(23.0 + 4 * rate_k_per_min, abs=1e-9)


def test_plate_feels_the_coolant_fifteen_seconds_later():
    plant = ThermalPlant(start_s=0.0)
    plant.advance(15.0, 80.0, ALL_OFF)
    assert plant.plate_c == pytest.approx(23.0, abs=1e-9)
    plant.advance(20.0, 80.0, ALL_OFF)
    assert plant.plate_c > 23.001


def test_standing_pump_isolates_the_plate():
    plant = ThermalPlant(start_s=0.0)
    plant.advance(600.0, 80.0, ALL_OFF, circulating=False)
    assert plant.coolant_c > 45
    assert plant.plate_c == pytest.approx(23.0, abs=1e-9)


def test_only_the_powered_housing_heats_itself():
    plant = ThermalPlant(start_s=0.0)
    plant.advance(300.0, 23.0, (False, True, False))
    assert plant.housing_c[1] > plant.housing_c[0] + 0.4
    assert plant.housing_c[0] == pytest.approx(plant.housing_c[2], abs=1e-9)


def test_result_does_not_depend_on_how_often_it_is_asked():
    seldom, often = ThermalPlant(start_s=0.0), ThermalPlant(start_s=0.0)
    seldom.advance(600.0, 50.0, ALL_ON)
    run(often, 600.0, 50.0, every_s=0.04)
    assert often.housing_c == pytest.approx(seldom.housing_c, abs=1e-9)


def test_going_back_in_time_changes_nothing():
    plant = ThermalPlant(start_s=0.0)
    plant.advance(100.0, 50.0, ALL_ON)
    before = plant.housing_c
    plant.advance(50.0, -20.0, ALL_OFF)
    assert plant.housing_c == before


def test_first_call_marks_the_start_of_a_resumed_session():
    plant = ThermalPlant()
    plant.advance(90_000.0, 80.0, ALL_ON)
    assert plant.coolant_c == 23.0


def test_six_hours_are_cheap():
    assert processor_s(lambda: run(ThermalPlant(start_s=0.0), 6 * 3600, 60.0, every_s=1.0)) < 1.5


def test_wrong_number_of_power_states_is_refused():
    plant = ThermalPlant(start_s=0.0)
    with pytest.raises(ValueError, match="3 housings"):
        plant.advance(10.0, 20.0, (True,))
