"""A thermal plant as a log of temperatures: coolant, plate, three housings, water on the plate, thermocouples."""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.effect import Effect, Parameter, sign, wide
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.hooks import Hooks, answering
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import SERIALS
from benchmarks.concealed.sensor import Sensor

HOUSING, PLATE = "housing_temperature_c", "plate_temperature_c"
LATENT_J_KG = 334e3
THERMAL = (
    HOUSING,
    PLATE,
    "coolant_temperature_c",
    "set_temperature_c",
    "ramp",
    "time_s",
    "sim_" + HOUSING,
    "sim_" + PLATE,
    "step",
)


@dataclass(slots=True, kw_only=True)
class Plant:
    """What the plant is made of; effects change the fields."""

    contact_w_k: np.ndarray
    water_kg: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantRows:
    """The log's rows: positions in the march, and which DUT."""

    at: np.ndarray
    dut: np.ndarray
    coolant_c: np.ndarray
    tick_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantDesign:
    """Profiles of set points (one per cycle), dwell per set point and log interval."""

    profiles: tuple[tuple[float, ...], ...]
    dwell_s: float = 540.0
    log_s: float = 20.0
    ambient_c: float = 23.0


def profiles(rng: np.random.Generator) -> PlantDesign:
    """Two or three cycles with set points of different spacing."""
    cycles = []
    for _ in range(int(rng.choice([2, 3]))):
        step = float(rng.choice([5.0, 7.5, 10.0]))
        up = np.arange(-10.0, 60.0 + rng.uniform(0, 25.0), step)
        cycles.append(tuple(np.concatenate([up, up[-2::-1]])))
    return PlantDesign(profiles=tuple(cycles), dwell_s=float(rng.choice([300.0, 420.0, 540.0])))


def _coolant(design: PlantDesign, tick_s: float) -> tuple[np.ndarray, ...]:
    """Coolant, set point, ramp sign, time in cycle, cycle and step against the march's ticks."""
    coolant, value, parts = [], design.profiles[0][0], []
    for cycle, profile in enumerate(design.profiles):
        for step, goal in enumerate(profile):
            heating = 1.0 if step == 0 or goal > profile[step - 1] else -1.0
            for k in range(int(design.dwell_s / tick_s)):
                value += float(np.clip((goal - value) * tick_s / 60.0, -2.0 / 60 * tick_s, 3.0 / 60 * tick_s))
                coolant.append(value)
                parts.append((goal, heating, (step * design.dwell_s) + k * tick_s, cycle + 1, step))
    return np.array(coolant), *np.array(parts).T


def _march(plant: Plant, coolant: np.ndarray, design: PlantDesign, tick_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Plate (T,) and housings (T, 3); water on the plate is marched as enthalpy, so that it holds 0 °C."""
    plate, ice_j = float(coolant[0]), 0.0
    housing = np.full(3, coolant[0] + 0.4)
    capacity_j = plant.water_kg * LATENT_J_KG
    frozen = plate < 0
    ice_j = capacity_j if frozen else 0.0
    plates, housings = np.empty(coolant.size), np.empty((coolant.size, 3))
    delay = int(15.0 / tick_s)
    for k in range(coolant.size):
        flow = plant.contact_w_k * (plate - housing)
        housing = housing + tick_s * (flow + 0.6 * (design.ambient_c - housing) + 12.0) / 900.0
        following = plate + tick_s * (150.0 * (coolant[max(k - delay, 0)] - plate) - flow.sum()) / 4500.0
        if capacity_j > 0:
            # heat that would carry the plate through 0 °C melts or freezes first
            if following > 0 and ice_j > 0:
                used = min(ice_j, following * 4500.0)
                ice_j, following = ice_j - used, following - used / 4500.0
            elif following < 0 and ice_j < capacity_j:
                used = min(capacity_j - ice_j, -following * 4500.0)
                ice_j, following = ice_j + used, following + used / 4500.0
        plate = following
        plates[k], housings[k] = plate, housing
    return plates, housings


def plant(rng: np.random.Generator, design: PlantDesign) -> Sensor:
    """The log of a plant, one row per DUT and log interval."""
    tick_s = 5.0
    coolant, goal, heating, time_s, cycle, step = _coolant(design, tick_s)
    at = np.arange(0, coolant.size, int(design.log_s / tick_s))
    at = np.repeat(at, 3)
    dut = np.tile(np.arange(3), at.size // 3)
    rows = PlantRows(at=at, dut=dut, coolant_c=coolant, tick_s=tick_s)

    def model(rows: PlantRows, hooks: Hooks) -> Expected:
        real = Plant(contact_w_k=np.full(3, 25.0))
        hooks.run("plant", real, np.zeros(0))
        plates, housings = _march(real, coolant, design, tick_s)
        mean = {
            HOUSING: hooks.run("housing_reads", rows, housings[rows.at, rows.dut]),
            PLATE: hooks.run("plate_reads", rows, plates[rows.at]),
        }
        std = {name: np.full(rows.at.size, 0.104) for name in mean}
        return Expected(mean, std, np.ones(rows.at.size))

    size = at.size
    columns = {
        "dut": np.array(SERIALS)[dut],
        "cycle": cycle[at].astype(int),
        "step": step[at].astype(int),
        "set_temperature_c": goal[at],
        "ramp": heating[at].astype(int),
        "time_s": time_s[at],
        "coolant_temperature_c": np.round(coolant[at] + rng.normal(0, 0.05, size), 2),
        "ambient_temperature_c": np.round(design.ambient_c + rng.normal(0, 0.1, size), 1),
        "tec_current_a": 0.03 * (coolant[at] - 25.0) + rng.normal(0, 2e-3, size),
    }
    return Sensor(
        name="plant",
        columns=columns,
        answer=answering(model, rows),
        channels=(HOUSING, PLATE),
        n_frames=np.ones(size, dtype=int),
        group=cycle[at].astype(int) * 1000 + step[at].astype(int) * 3 + dut,
        sweep=np.arange(size),
        repeat={HOUSING: (0.0, 0.0), PLATE: (0.0, 0.0)},
        gain_nuisance=(),
        plain=(HOUSING, PLATE),
        blocks={"cycle": cycle[at], "steps": step[at]},
        rows=rows,
        design=design,
        decoys=("tec_current_a", "ambient_temperature_c"),
        labels={f"#{k}": name for k, name in enumerate(SERIALS)},
    )


def _latent(rng: np.random.Generator, rows: PlantRows, design: PlantDesign) -> Effect:
    def apply(hooks: Hooks, amount: float) -> None:
        def wet(real: Plant, value: np.ndarray) -> np.ndarray:
            real.water_kg = amount
            return value

        hooks.add("plant", wet)

    return Effect(
        effect="thermal.latent_heat",
        apply=apply,
        channels=(PLATE, HOUSING),
        drivers=THERMAL,
        start=2e-3,
        limit=1.5,
        where={PLATE: [-4.0, 4.0]},
        unseen=("cycle",),
        needs=("time_s", "ramp"),
        calibrations=("none",),
    )


def _offset(rng: np.random.Generator, rows: PlantRows, design: PlantDesign) -> Effect:
    dut, way, share = int(rng.integers(3)), sign(rng), rng.random() < 0.4

    def apply(hooks: Hooks, amount: float) -> None:
        def read(rows: PlantRows, value: np.ndarray) -> np.ndarray:
            wrong = way * amount * ((value - 25.0) / 40.0 if share else 1.0)
            return value + wrong * (rows.dut == dut)

        hooks.add("housing_reads", read)

    return Effect(
        effect="thermal.sensor_offset",
        apply=apply,
        channels=(HOUSING,),
        drivers=("dut", *THERMAL),
        start=0.01,
        limit=6.0,
        where={"dut": [f"#{dut}"]},
        unseen=("cycle", "steps"),
        needs=("dut",),
        calibrations=("none",),
        parameters=lambda a: () if share else (Parameter(pattern="offset", value=way * a, unit="K"),),
    )


def _contact(rng: np.random.Generator, rows: PlantRows, design: PlantDesign) -> Effect:
    dut = int(rng.integers(3))

    def apply(hooks: Hooks, amount: float) -> None:
        def worse(real: Plant, value: np.ndarray) -> np.ndarray:
            real.contact_w_k[dut] = 25.0 / (1.0 + amount)
            return value

        hooks.add("plant", worse)

    return Effect(
        effect="thermal.contact_resistance",
        apply=apply,
        channels=(HOUSING,),
        drivers=("dut", *THERMAL),
        start=0.01,
        limit=6.0,
        where={"dut": [f"#{dut}"]},
        unseen=("cycle", "steps"),
        needs=("dut", "time_s", "ramp"),
        calibrations=("none",),
    )


def _slow_flow(rng: np.random.Generator, rows: PlantRows, design: PlantDesign) -> Effect:
    """Outside the library: heat radiated from a lamp that is switched at set times."""
    period_s = wide(rng, 2000.0, 6000.0)

    def apply(hooks: Hooks, amount: float) -> None:
        def lamp(rows: PlantRows, value: np.ndarray) -> np.ndarray:
            on = np.mod(rows.at * rows.tick_s, period_s) < 0.4 * period_s
            return value + amount * on

        hooks.add("plate_reads", lamp)

    return Effect(
        effect="unknown",
        nature="a lamp that is switched",
        apply=apply,
        channels=(PLATE,),
        start=0.02,
        limit=5.0,
        drivers=("time_s", "step", *THERMAL),
        unseen=("steps",),
        needs=("time_s",),
        calibrations=("none",),
    )


RECIPES = (
    Recipe("thermal.latent_heat", profiles, _latent, "plant"),
    Recipe("thermal.sensor_offset", profiles, _offset, "plant"),
    Recipe("thermal.contact_resistance", profiles, _contact, "plant"),
)
UNKNOWN = (Recipe("unknown", profiles, _slow_flow, "plant"),)
