"""Thermal plant: operators against nodes of heat marched through time."""

import numpy as np
from operator_tables import table
from rendered_bench import corrected, left_over, variant_of
from scipy.integrate import solve_ivp


def plant(resistance=1.0, water_k=0.0):
    """A housing on a plate: 900 J/K, 25 W/K / resistance to the plate, 12 W of its own; water that melts at 0 °C."""
    time = np.linspace(0.0, 9000.0, 1500)
    plate = np.interp(time, [0.0, 500.0, 4000.0, 6000.0, 9000.0], [-15.0, -15.0, 50.0, 50.0, -15.0])

    def balance(moment, state):
        heat = state[0]  # kelvin of stored heat, water_k of it latent
        node = heat if heat < 0.0 else max(heat - water_k, 0.0)
        return [((np.interp(moment, time, plate) - node) * 25.0 / resistance + 12.0) / 900.0]

    start = plate[0] + 12.0 * resistance / 25.0
    heat = solve_ivp(balance, (0.0, 9000.0), [start], t_eval=time, rtol=1e-8, atol=1e-8, max_step=10.0).y[0]
    return time, plate, np.where(heat < 0.0, heat, np.maximum(heat - water_k, 0.0))


def test_contact_resistance_settles_warmer_and_follows_later():
    time, plate, assumed = plant()
    _, _, real = plant(resistance=2.5)
    view = table(
        time_s=time, plate_temperature_c=plate, sim_housing_temperature_c=assumed, housing_temperature_c=real
    )
    variant = variant_of(view, "thermal.contact_resistance")
    state = corrected(view, variant, excess=1.5, time_constant=36.0)
    assert left_over(view, state, "housing_temperature_c") < 2e-3


def test_latent_heat_holds_the_temperature_while_water_melts_and_freezes():
    time, plate, dry = plant()
    _, _, wet = plant(water_k=8.0)
    view = table(time_s=time, plate_temperature_c=plate, sim_node_temperature_c=dry, node_temperature_c=wet)
    variant = variant_of(view, "thermal.latent_heat", channel="node_temperature_c")
    state = corrected(view, variant, latent=8.0, time_constant=36.0)
    assert left_over(view, state, "node_temperature_c") < 0.01
    held = np.abs(state["node_temperature_c"]) < 0.05
    assert held.sum() * (time[1] - time[0]) > 200.0


def test_sensor_offset_is_a_thermocouple_off_at_ice_and_off_in_gain():
    truth = np.linspace(-10.0, 85.0, 50)
    view = table(sim_housing_temperature_c=truth, housing_temperature_c=truth * 1.01 + 0.8)
    variant = variant_of(view, "thermal.sensor_offset")
    state = corrected(view, variant, offset=0.8 + 0.25, gain=0.01)  # the offset is told at 25 °C
    assert left_over(view, state, "housing_temperature_c") < 1e-12
