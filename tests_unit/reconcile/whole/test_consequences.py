"""What a plate carries acts back on it: no cause of its own."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[name] for name in ("thermal.contact_resistance", "thermal.sensor_offset", "thermal.latent_heat")]


def marched(coolant, load, contact):
    """Plate and housing second by second, each giving the other what it takes; a bad contact holds the heat up."""
    plate, housing = np.empty(coolant.size), np.empty(coolant.size)
    plate[0] = housing[0] = coolant[0]
    for k in range(1, coolant.size):
        flow = (plate[k - 1] - housing[k - 1]) / contact
        plate[k] = plate[k - 1] + 0.012 * (coolant[k] - plate[k - 1]) - 0.002 * flow
        housing[k] = housing[k - 1] + 0.012 * flow + load[k]
    return plate, housing


def chamber(seed, contact, drag=0.0):
    """Fourteen steps of 20 minutes; `drag`: the plate lags by so many kelvin on ramps for another reason."""
    rng = np.random.default_rng(seed)
    second, step = np.arange(14 * 1200.0), np.arange(14 * 1200) // 1200
    set_c = 80.0 - 12.0 * np.abs(step - 7.0)
    load = rng.uniform(0.005, 0.03, 14)[step]
    coolant = np.empty(second.size)
    coolant[0] = set_c[0]
    for k in range(1, second.size):
        coolant[k] = coolant[k - 1] + np.clip(set_c[k] - coolant[k - 1], -0.04, 0.04)
    at = np.arange(30, second.size, 45)
    simulated, true = marched(coolant, load, 1.0), marched(coolant, load, contact)
    table = {
        "step": step[at], "time_s": second[at], "set_temperature_c": set_c[at], "coolant_temperature_c": coolant[at],
        "n_frames": np.full(at.size, 10.0),
    }  # fmt: skip
    extra = (drag * np.gradient(coolant)[at] / 0.04, 0.0)
    for name, sim, is_, more in zip(("plate", "housing"), simulated, true, extra, strict=True):
        table[f"sim_{name}_temperature_c"] = sim[at]
        table[f"sim_{name}_temperature_c_std"] = np.full(at.size, 0.1)
        table[f"{name}_temperature_c"] = is_[at] + more + 0.1 / np.sqrt(10.0) * rng.normal(size=at.size)
    return columns_of(pa.table(table))


def test_a_plate_answers_to_a_bad_contact_of_what_it_carries():
    (found,) = diagnose(chamber(2, 1.5), effects=KNOWN)[0].findings
    assert (found.effect, found.channels) == ("thermal.contact_resistance", ["housing_temperature_c"])


def test_a_plate_that_is_off_by_more_has_a_cause_of_its_own():
    found = diagnose(chamber(3, 1.5, drag=-1.5), effects=KNOWN)[0].findings
    assert any("plate_temperature_c" in f.channels for f in found)


def windy(seed, loss):
    """Housings on a plate, lasers on them; outside air takes `loss` per second and kelvin that nobody simulated."""
    rng = np.random.default_rng(seed)
    second = np.arange(12 * 1500)
    step = second // 1500
    plate = 20.0 + 35.0 * np.sin(2.0 * np.pi * second / second.size) * np.ones(second.size)

    def run(leak):
        housing, laser = np.empty(second.size), np.empty(second.size)
        housing[0], laser[0] = plate[0], plate[0] + 8.0
        for k in range(1, second.size):
            housing[k] = housing[k - 1] + 0.01 * (plate[k - 1] - housing[k - 1]) - leak * (housing[k - 1] - 22.0)
            laser[k] = laser[k - 1] + 0.02 * (housing[k - 1] + 8.0 - laser[k - 1])
        return housing, laser

    at = np.arange(60, second.size, 90)
    table = {"step": step[at], "time_s": second[at], "plate_temperature_c": plate[at]}
    table["n_frames"] = np.full(at.size, 10.0)
    for name, sim, true in zip(("housing", "laser"), run(0.0), run(loss), strict=True):
        table[f"sim_{name}_temperature_c"] = sim[at]
        table[f"sim_{name}_temperature_c_std"] = np.full(at.size, 0.1)
        table[f"{name}_temperature_c"] = true[at] + 0.1 / np.sqrt(10.0) * rng.normal(size=at.size)
    return columns_of(pa.table(table))


def test_two_thermometers_that_are_off_alike_measure_another_temperature():
    found = diagnose(windy(4, 1e-4), effects=KNOWN)[0].findings
    assert {c for f in found for c in f.channels} == {"housing_temperature_c", "laser_temperature_c"}
    assert {f.effect for f in found} == {"unknown"}


def iced(seed, latent):
    """Three housings on a plate; water in the first one gives and takes `latent` kelvin of its heat at 0 °C."""
    rng = np.random.default_rng(seed)
    second = np.arange(10 * 1200)
    step = second // 1200
    set_c = np.array([25.0, 12.0, 3.0, -6.0, -16.0, -8.0, 2.0, 10.0, 20.0, 28.0])[step]

    def run(water):
        plate, heat = np.empty(second.size), np.empty((second.size, 3))
        plate[0], heat[0] = set_c[0], set_c[0] + np.where(np.arange(3) == 0, water, 0.0)
        for k in range(1, second.size):
            wet = np.clip(heat[k - 1], 0.0, None) - np.clip(heat[k - 1] - water, 0.0, None)  # kelvin that are molten
            seen = heat[k - 1] - np.where(np.arange(3) == 0, wet, 0.0)
            flow = plate[k - 1] - seen
            plate[k] = plate[k - 1] + 0.008 * (set_c[k] - plate[k - 1]) - 0.004 * flow.sum()
            heat[k] = heat[k - 1] + 0.02 * flow
        wet = np.clip(heat, 0.0, None) - np.clip(heat - water, 0.0, None)
        return plate, heat - np.where(np.arange(3) == 0, wet, 0.0)

    at = np.arange(15, second.size, 40)
    simulated, true = run(1e-9), run(latent)
    rows = []
    for unit in range(3):
        row = {"step": step[at], "time_s": second[at], "set_temperature_c": set_c[at]}
        row |= {"dut": np.full(at.size, f"U{unit}"), "n_frames": np.full(at.size, 10.0)}
        for name, sim, is_ in zip(("plate", "housing"), simulated, true, strict=True):
            sim, is_ = (sim[at], is_[at]) if sim.ndim == 1 else (sim[at, unit], is_[at, unit])
            row[f"sim_{name}_temperature_c"], row[f"sim_{name}_temperature_c_std"] = sim, np.full(at.size, 0.05)
            row[f"{name}_temperature_c"] = is_ + 0.05 / np.sqrt(10.0) * rng.normal(size=at.size)
        rows.append(pa.table(row))
    return columns_of(pa.concat_tables(rows))


def test_a_plate_answers_to_ice_in_one_of_the_housings_on_it():
    (found,) = diagnose(iced(5, 2.0), effects=KNOWN)[0].findings
    assert (found.effect, found.channels) == ("thermal.latent_heat", ["housing_temperature_c"])
