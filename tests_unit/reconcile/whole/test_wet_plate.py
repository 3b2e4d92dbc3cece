"""Water on the plate, marched by an integrator: found in what the plate was recorded to do, whatever its name."""

import numpy as np
import pyarrow as pa
import pytest
from rendered_bench import corrected, left_over, make_columns, variant_of
from scipy.integrate import solve_ivp

from arl_fixtures.reconcile.effects_common import temperature_drivers
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

TIME = np.arange(0.0, 10_800.0, 45.0)


def coolant_at(moment):
    return np.interp(moment, [0, 900, 4500, 6300, 9900, 10_800], [-12, -12, 50, 50, -12, -12])


def bench(water_k, resistance=1.0):
    """Coolant, plate and housing: 180 s to the plate, 300 s and 4 K of its own heat to the housing."""

    def plate_of(heat):
        return np.where(heat < 0.0, heat, np.maximum(heat - water_k, 0.0))

    def balance(moment, state):
        plate = float(plate_of(state[0]))
        own = 4.0 * resistance
        return [(coolant_at(moment) - plate) / 180.0, (plate + own - state[1]) / (300.0 * resistance)]

    start = [-12.0, -12.0 + 4.0 * resistance]
    heat, housing = solve_ivp(balance, (0.0, TIME[-1]), start, t_eval=TIME, rtol=1e-8, atol=1e-8, max_step=10.0).y
    return plate_of(heat), housing


def wet_table(seed, plate, *, fed):
    """Three cycles; with `fed` the simulation of the housing was given the plate as it was recorded."""
    rng = np.random.default_rng(seed)
    (dry, dry_housing), (wet, wet_housing) = bench(0.0), bench(5.0)
    cycles = 3
    columns = {
        "cycle": np.repeat(np.arange(1.0, cycles + 1.0), TIME.size), "time_s": np.tile(TIME, cycles),
        "coolant_temperature_c": np.tile(coolant_at(TIME), cycles),
        f"sim_{plate}": np.tile(dry, cycles), plate: np.tile(wet, cycles),
        "sim_housing_temperature_c": np.tile(wet_housing if fed else dry_housing, cycles),
        "housing_temperature_c": np.tile(wet_housing, cycles),
    }  # fmt: skip
    for name in (plate, "housing_temperature_c"):
        columns[name] = columns[name] + 0.05 * rng.normal(size=columns[name].size)
    return columns_of(pa.table(columns))


@pytest.mark.parametrize(
    ("plate", "fed"),
    [("plate_temperature_c", True), ("temperature_plate_c", False)],
)
def test_water_on_a_plate_is_the_only_finding(plate, fed):
    (found,) = diagnose(wet_table(6, plate, fed=fed))[0].findings
    assert found.effect == "thermal.latent_heat"
    assert found.channels == [plate] if fed else set(found.channels) == {plate, "housing_temperature_c"}
    values = {p.name: p.value for p in found.parameters}
    assert values["latent"] == pytest.approx(5.0, rel=0.06)
    assert values["melting_point"] == pytest.approx(0.0, abs=0.05)


def test_a_contact_is_told_against_a_plate_of_any_name():
    plate, assumed = bench(0.0)
    _, real = bench(0.0, resistance=2.0)
    numbers = {
        "time_s": TIME, "temperature_plate_c": plate, "temperature_plate_set_c": coolant_at(TIME),
        "sim_housing_temperature_c": assumed, "housing_temperature_c": real,
    }  # fmt: skip
    view = View(make_columns(numbers, {}, shuffle=2)[0])
    variant = variant_of(view, "thermal.contact_resistance")
    assert variant.options["plate"] == "temperature_plate_c"
    state = corrected(view, variant, excess=1.0, time_constant=300.0)
    assert left_over(view, state, "housing_temperature_c") < 2e-3


def test_a_plate_of_any_name_drives_a_device_only_where_its_own_temperature_is_unknown():
    numbers = {"time_s": TIME, "chamber_c": coolant_at(TIME), "temperature_plate_c": coolant_at(TIME)}
    assert len(temperature_drivers(View(make_columns(dict(numbers), {})[0]))) == 2
    with_own = {**numbers, "temperature_board_c": coolant_at(TIME) + 3.0}
    assert temperature_drivers(View(make_columns(with_own, {})[0])) == ("temperature_board_c",)


def test_water_behind_a_film_takes_its_heat_slowly():
    """A sheet of water with a mass and a temperature of its own, 250 s from the plate, marched by an integrator."""

    def molten(heat):
        return np.clip(heat, 0.0, 6.0)

    def balance(moment, state):
        plate, heat = state
        sheet = heat - molten(heat)  # K beyond what melts, for a sheet of a tenth of the plate's heat
        flow = (plate - 10.0 * sheet) / 250.0
        return [(coolant_at(moment) - plate) / 180.0 - flow, flow]

    def march(start):
        return solve_ivp(balance, (0.0, TIME[-1]), start, t_eval=TIME, rtol=1e-8, atol=1e-8, max_step=5.0).y[0]

    numbers = {
        "time_s": TIME, "coolant_temperature_c": coolant_at(TIME), "sim_plate_temperature_c": bench(0.0)[0],
        "plate_temperature_c": march([-12.0, -1.2]),
    }  # fmt: skip
    view = View(make_columns(numbers, {}, shuffle=3)[0])
    shares = []
    for through, shapes in ((None, {}), ("film", {"film": 270.0})):
        variant = variant_of(view, "thermal.latent_heat", through=through)
        left = [
            left_over(
                view, corrected(view, variant, latent=latent, time_constant=180.0, melting_point=0.0, **shapes),
                "plate_temperature_c",
            )
            for latent in np.arange(1.0, 9.0)
        ]  # fmt: skip
        shares.append(min(left))
    assert shares[1] < 0.15
    assert shares[1] < 0.5 * shares[0]



SHORT = np.arange(20.0, 5000.0, 20.0)


def shallow(moment):
    """From 20 down to -12 °C and back, 1.2 K a minute: the plate is below zero for 35 minutes."""
    return np.interp(moment, [0.0, 1500.0, 2700.0, 4300.0], [20.0, -12.0, -12.0, 20.0])


def behind_a_film(water_k, film_s, molten):
    """Plate and housing, where water meets the plate through a film and freezes the faster the colder that is."""

    def balance(moment, state):
        plate, housing, molten = state
        passes = (plate > 0.0 and molten < water_k) or (plate < 0.0 and molten > 0.0)
        taken = plate / film_s if passes else 0.0
        return [(shallow(moment) - plate) / 150.0 - taken, (plate + 4.0 - housing) / 190.0, taken]

    start = [20.0, 24.0, molten]
    return solve_ivp(balance, (0.0, SHORT[-1]), start, t_eval=SHORT, rtol=1e-7, max_step=5.0).y[:2]


@pytest.mark.parametrize(("water_k", "film_s"), [(2.4, 830.0), (3.5, 600.0)])
def test_water_behind_a_film_that_takes_minutes_to_freeze_is_named(water_k, film_s):
    """The bench was put together with ice on it, which melts in the first minutes of the first cycle."""
    rng = np.random.default_rng(9)
    dry = np.tile(behind_a_film(0.0, 1e9, 0.0), 4)
    wet = np.hstack([behind_a_film(water_k, film_s, 0.0), *3 * [behind_a_film(water_k, film_s, water_k)]])
    columns = {"cycle": np.repeat(np.arange(4.0), SHORT.size), "time_s": np.tile(SHORT, 4),
               "coolant_temperature_c": np.tile(shallow(SHORT), 4)}  # fmt: skip
    for name, nominal, real in zip(("plate_temperature_c", "housing_temperature_c"), dry, wet, strict=True):
        columns |= {f"sim_{name}": nominal, f"sim_{name}_std": np.full(4 * SHORT.size, 0.08),
                    name: real + 0.08 * rng.normal(size=4 * SHORT.size)}  # fmt: skip
    findings = diagnose(columns_of(pa.table(columns)))[0].findings
    assert [found.effect for found in findings] == ["thermal.latent_heat"]
    assert set(findings[0].channels) == {"plate_temperature_c", "housing_temperature_c"}
