from __future__ import annotations

import math

import pytest
from processor_time import processor_s

from arl_fixtures.emulators.faults import Fault, FaultBook
from arl_fixtures.emulators.plant import Plant, PlantSettings
from arl_fixtures.errors import ConfigError
from arl_fixtures.twin.thermal import ThermalSettings

HOUR_S = 3600.0


def driven(target_c: float, **more: object) -> Plant:
    plant = Plant()
    plant.drive_coolant(0.0, **({"target_c": target_c, "controlling": True, "circulating": True} | more))
    return plant


def test_coolant_heats_plate_heats_housings():
    plant = driven(80.0)
    plant.advance(60.0)
    assert plant.coolant_c > plant.plate_c > plant.housing_c[0] > 23.0
    plant.advance(3 * HOUR_S)
    assert plant.plate_c == pytest.approx(80.0, abs=1.5)


def test_only_powered_sensors_heat_themselves():
    plant = driven(23.0)
    plant.switch("dut_2", True, 0.0)
    plant.advance(2 * HOUR_S)
    assert plant.housing_c[1] > plant.housing_c[0] + 0.3
    plant.switch("dut_2", False, plant.now_s)
    plant.advance(4 * HOUR_S)
    assert plant.housing_c[1] == pytest.approx(plant.housing_c[0], abs=0.05)


def test_a_standing_pump_couples_nothing():
    plant = driven(80.0, circulating=False)
    plant.advance(HOUR_S)
    assert plant.coolant_c == pytest.approx(80.0, abs=0.1)
    assert plant.plate_c == pytest.approx(23.0, abs=0.1)
    plant.switch("dut_1", True, plant.now_s)
    plant.advance(2 * HOUR_S)
    assert plant.plate_c > 24.0, "what heats itself is no longer cooled"


def test_without_control_the_bath_drifts_to_ambient_slowly():
    plant = driven(80.0)
    plant.advance(HOUR_S)
    plant.drive_coolant(HOUR_S, target_c=80.0, controlling=False, circulating=True)
    plant.advance(2 * HOUR_S)
    assert 60.0 < plant.coolant_c < 75.0
    plant.advance(12 * HOUR_S)
    assert plant.coolant_c == pytest.approx(23.0, abs=5.0)


def test_the_setpoint_in_effect_obeys_its_ramp():
    plant = driven(53.0, ramp_k_per_min=1.0)
    plant.advance(15 * 60.0)
    assert plant.ramped_setpoint_c == pytest.approx(38.0, abs=0.1)
    assert plant.coolant_c <= plant.ramped_setpoint_c
    plant.advance(HOUR_S)
    assert plant.ramped_setpoint_c == 53.0


def test_the_plant_does_not_depend_on_who_looks_when():
    often, seldom = driven(70.0), driven(70.0)
    for tenths in range(0, 36000, 37):
        often.advance(tenths / 10.0)
    often.advance(HOUR_S)
    seldom.advance(HOUR_S)
    assert often.housing_c == seldom.housing_c
    assert often.coolant_c == seldom.coolant_c


def test_time_never_runs_backwards():
    plant = driven(70.0)
    plant.advance(100.0)
    before = plant.coolant_c
    plant.advance(50.0)
    assert (plant.now_s, plant.coolant_c) == (100.0, before)


def test_power_is_known_for_the_past():
    plant = Plant()
    plant.switch("dut_1", True, 10.0)
    plant.switch("laser_1", True, 12.0)
    plant.switch("dut_1", False, 20.0)
    plant.switch("dut_1", True, 30.0)
    assert [plant.powered(0, at_s) for at_s in (9.9, 10.0, 19.9, 20.0, 30.0)] == [False, True, True, False, True]
    assert [plant.laser_on(0, at_s) for at_s in (11.0, 12.0, 25.0, 31.0)] == [False, True, False, True]
    assert plant.powered_since_s(0) == 30.0
    assert plant.powered_since_s(1) == math.inf
    plant.switch("dut_1", True, 40.0)
    assert plant.powered_since_s(0) == 30.0, "switching on what is on is no power-up"


def test_a_load_that_is_not_there_is_named():
    with pytest.raises(ConfigError, match="no load 'heater' on the emulated bench; loads are dut_1"):
        Plant().switch("heater", True, 0.0)


def test_faults_begin_and_end_in_order_on_the_way():
    told = []
    early, late = (Fault(device="stage", kind="stage_stall", start_s=s, duration_s=10.0) for s in (5.0, 8.0))
    plant = Plant(faults=FaultBook([late, early]))
    plant.attach("stage", lambda fault, begins, at_s: told.append((fault.start_s, begins, at_s, plant.now_s)))
    plant.attach("chiller", lambda *_: pytest.fail("not its fault"))
    plant.advance(100.0)
    assert told == [(5.0, True, 5.0, 5.0), (8.0, True, 8.0, 8.0), (5.0, False, 15.0, 15.0), (8.0, False, 18.0, 18.0)]


def test_a_fault_injected_late_begins_now():
    told = []
    plant = Plant()
    plant.attach("relays", lambda fault, begins, at_s: told.append((begins, at_s)))
    plant.advance(50.0)
    plant.faults.inject(Fault(device="relays", kind="reset", start_s=3.0, duration_s=60.0))
    plant.advance(50.0)
    plant.faults.clear()
    plant.advance(51.0)
    assert told == [(True, 50.0), (False, 50.0)]


def test_a_listener_may_change_the_plant():
    plant = Plant(faults=FaultBook([Fault(device="bench", kind="brown_out", start_s=5.0)]))
    plant.switch("dut_1", True, 0.0)
    order = []
    for name in ("relays", "stage"):
        plant.attach(name, lambda *_, name=name: (plant.switch("dut_1", False, 5.0), order.append(name)))
    plant.advance(10.0)
    assert order == ["relays", "stage"]
    assert plant.powered(0, 4.9)
    assert not plant.powered(0)


def test_one_housing_for_each_sensor():
    plant = Plant(PlantSettings(thermal=ThermalSettings(housing_count=2)))
    assert plant.dut_count == 2
    assert plant.loads == ("dut_1", "dut_2", "laser_1", "laser_2")


def test_six_hours_cost_less_than_two_seconds_of_computing():
    def six_hours():
        plant = driven(85.0)
        for second in range(0, 6 * 3600, 5):
            plant.advance(float(second))

    assert processor_s(six_hours) < 2.0
