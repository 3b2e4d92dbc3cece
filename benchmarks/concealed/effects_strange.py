"""More effects that no library lists, on every sensor: interactions, memory, hysteresis, ripples, switched ranges."""

import numpy as np

from benchmarks.concealed.camera import Field, flat_fields
from benchmarks.concealed.designs import ageing, sparse
from benchmarks.concealed.effect import DIE, DISTANCE, FIELD, HISTORY, INTENSITY, Effect, sign, wide
from benchmarks.concealed.flash import Reality, frame_load
from benchmarks.concealed.hooks import Hooks
from benchmarks.concealed.laser_curve import HEAT, LIGHT, CurveRows, curves
from benchmarks.concealed.point_sensor import PointRows, goniometer, rail
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows
from benchmarks.concealed.scene import SURFACES, Hits
from benchmarks.concealed.thermal_plant import HOUSING, THERMAL, PlantRows, profiles
from benchmarks.concealed.zone_sensor import ZoneRows, zones_before_target


def _unknown(nature: str, **given: object) -> Effect:
    return Effect(effect="unknown", nature=nature, **given)  # type: ignore[arg-type]  # keywords as Effect's own


def _polarised_gloss(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    axis_deg = rng.uniform(0, 180)

    def apply(reality: Reality, amount: float) -> None:
        def gloss(rows: Rows, hits: Hits) -> np.ndarray:
            turned = np.cos(2.0 * np.radians(2.0 * rows.angle_deg - axis_deg))[:, None]
            return 1.0 + amount * turned * (1.0 - hits.cos_incidence**2)

        reality.surface.append(gloss)

    return _unknown(
        "polarisation with incidence", apply=apply, channels=(INTENSITY,), start=0.03, limit=0.9,
        drivers=("stage_angle_deg", "incidence_deg", "azimuth_deg", "pixel_u"),
        needs=("stage_angle_deg", "incidence_deg"), unseen=("steps",),
    )  # fmt: skip


def _row_response(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    turns, phase = wide(rng, 0.4, 1.2), rng.uniform(0, 6.28)
    usual = np.sin(2 * np.pi * turns * rows.v / 31.0 + phase).mean()  # what all rows do alike is a gain's drift

    def apply(reality: Reality, amount: float) -> None:
        def warm(rows: Rows, light: np.ndarray) -> np.ndarray:
            across = np.sin(2 * np.pi * turns * rows.v / 31.0 + phase) - usual
            return light * (1.0 + amount * across * (rows.node_c["tof"] - 34.0) / 60.0)

        reality.electronics.append(warm)

    return _unknown(
        "rows respond differently to temperature", apply=apply, channels=(INTENSITY,), start=0.01, limit=0.4,
        drivers=("pixel_v", "elevation_deg", *DIE), needs=(*FIELD, *DIE[:2]), unseen=("steps", "angles"),
    )  # fmt: skip


def _charge_memory(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    load = frame_load(rows)
    before = np.zeros(len(rows))
    for group in np.unique(rows.group):
        here = rows.group == group
        angles, first = np.unique(rows.angle_deg[here], return_index=True)
        of = dict(zip(angles.tolist(), load[here][first].tolist(), strict=True))
        before[here] = [of[a] for a in rows.previous_angle_deg[here]]
    swing, way = (before - load) / load.mean(), sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        reality.timing.append(lambda rows, a, d: way * amount * np.maximum(swing, 0.0))

    return _unknown(
        "timing remembers a brighter frame", apply=apply, channels=(DISTANCE,), start=2e-3, limit=0.1,
        drivers=("stage_angle_deg", "time_s"), needs=("stage_angle_deg",), unseen=("steps",),
    )  # fmt: skip


def _fading_paint(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    index, way = int(rng.integers(1, 4)), sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        def paint(rows: Rows, hits: Hits) -> np.ndarray:
            warm = ((rows.node_c["frame"] - 30.0) / 50.0)[:, None]
            return 1.0 + way * amount * warm * (hits.surface == index)

        reality.surface.append(paint)

    return _unknown(
        "one paint changes with temperature", apply=apply, channels=(INTENSITY,), start=0.01, limit=0.5,
        # the chamber's frame follows the temperature of hours before: history tells it as well as any logger
        drivers=("surface", "reflectance", "intensity_counts", *DIE, *HISTORY), needs=("surface", *DIE[:2]),
        unseen=("steps",), where={"surface": [SURFACES[index]]},
    )  # fmt: skip


def _beat(rng: np.random.Generator, rows: PointRows, design: object) -> Effect:
    period_m, drift = wide(rng, 0.6, 2.5), rng.uniform(0.3, 1.0) * sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        def ripple(rows: PointRows, distance: np.ndarray, light: np.ndarray) -> np.ndarray:
            turns = rows.range_m / period_m + drift * (rows.die_c - 40.0) / 50.0
            return distance + amount * np.sin(2 * np.pi * turns)

        hooks.add("timing", ripple)

    return _unknown(
        "beat of two clocks, drifting", apply=apply, channels=(DISTANCE,), start=5e-4, limit=0.05,
        drivers=("true_range_m", "sim_distance_m", *DIE, "step"), needs=("true_range_m", "tof_temperature_c"),
        unseen=("distances",),
    )  # fmt: skip


def _penetration(rng: np.random.Generator, rows: PointRows, design: object) -> Effect:
    paint = str(rng.choice(["grey_18", "grey_50", "white"]))

    def apply(hooks: Hooks, amount: float) -> None:
        def deep(rows: PointRows, distance: np.ndarray, light: np.ndarray) -> np.ndarray:
            slant = np.sin(np.radians(rows.incidence_deg)) ** 2
            return distance + amount * slant * (rows.paint == paint)

        hooks.add("path", deep)

    return _unknown(
        "light enters one paint at a slant", apply=apply, channels=(DISTANCE,), start=1e-3, limit=0.05,
        drivers=("incidence_deg", "surface", "reflectance", "intensity_counts"), needs=("incidence_deg", "surface"),
        unseen=("steps", "angles"), where={"surface": [paint]},
    )  # fmt: skip


def _parallax(rng: np.random.Generator, rows: ZoneRows, design: object) -> Effect:
    lean = rng.normal(size=2)
    lean = lean / np.hypot(*lean)

    def apply(hooks: Hooks, amount: float) -> None:
        def vignette(rows: ZoneRows, rate: np.ndarray) -> np.ndarray:
            across = lean[0] * (rows.zone % 3 - 1) + lean[1] * (rows.zone // 3 - 1)
            return rate * (1.0 + amount * across * (0.3 / rows.range_m - 0.5))[:, None]

        hooks.add("rate", vignette)

    return _unknown(
        "parallax of emitter and receiver", apply=apply, channels=(INTENSITY,), start=0.01, limit=0.4,
        drivers=("zone", "true_range_m", "distance_m", "intensity_counts"), needs=("zone", "true_range_m"),
        unseen=("steps", "distances"),
    )  # fmt: skip


def _mode_hop(rng: np.random.Generator, rows: CurveRows, design: object) -> Effect:
    start_c, slope, way = rng.uniform(35.0, 55.0), rng.uniform(4.0, 10.0), sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        def hop(rows: CurveRows, light: np.ndarray) -> np.ndarray:
            return light * (1.0 + way * amount * (rows.sink_c + slope * rows.current_a > start_c))

        hooks.add("receiver", hop)

    return _unknown(
        "mode hop at a junction temperature", apply=apply, channels=(LIGHT,), start=0.003, limit=0.1,
        drivers=(*HEAT, "drive_current_a"), unseen=("steps", "currents"), calibrations=("none",),
    )  # fmt: skip


def _reciprocity(rng: np.random.Generator, rows: Field, design: object) -> Effect:
    centre, width = rng.uniform(10.0, 80.0), wide(rng, 8.0, 20.0)

    def apply(hooks: Hooks, amount: float) -> None:
        def bleeding(rows: Field, counts: np.ndarray) -> np.ndarray:
            near = np.exp(-(((rows.u - centre) / width) ** 2))
            return counts * (1.0 + amount * near * np.log(rows.level_lx / 200.0))

        hooks.add("read_out", bleeding)

    return _unknown(
        "columns lose light at some levels", apply=apply, channels=(INTENSITY,), start=0.003, limit=0.2,
        drivers=("pixel_u", "azimuth_deg", "illuminance_lx", "intensity_counts", "step"), needs=("pixel_u",),
        unseen=("steps",),
    )  # fmt: skip


def _hysteresis(rng: np.random.Generator, rows: PlantRows, design: object) -> Effect:
    centre_c, width_k = rng.uniform(15.0, 45.0), wide(rng, 8.0, 20.0)
    falling = np.diff(rows.coolant_c, prepend=rows.coolant_c[0]) < 0
    back = np.maximum.accumulate(np.where(np.diff(falling, prepend=False), np.arange(falling.size), 0))
    cooling = falling[back]

    def apply(hooks: Hooks, amount: float) -> None:
        def lag(rows: PlantRows, value: np.ndarray) -> np.ndarray:
            return value + amount * np.exp(-(((value - centre_c) / width_k) ** 2)) * cooling[rows.at]

        hooks.add("housing_reads", lag)

    return _unknown(
        "a sensor reads otherwise while cooling", apply=apply, channels=(HOUSING,), start=0.05, limit=5.0,
        drivers=THERMAL, needs=("ramp", "time_s"), unseen=("steps",), calibrations=("none",),
    )  # fmt: skip


def _etalon(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    fringe_deg, moves = wide(rng, 20.0, 60.0), rng.uniform(0.3, 1.0)

    def apply(reality: Reality, amount: float) -> None:
        def fringes(rows: Rows, azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
            turns = azimuth / fringe_deg + moves * (rows.node_c["tof"] - 34.0) / 60.0
            shape = np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)
            return shape * (1.0 + amount * np.sin(2 * np.pi * turns))

        reality.beam.append(fringes)

    return _unknown(
        "fringes that move with temperature", apply=apply, channels=(INTENSITY,), start=0.01, limit=0.4,
        drivers=("azimuth_deg", "pixel_u", *DIE), needs=(*FIELD, *DIE[:2]), unseen=("angles",),
    )  # fmt: skip


def _worn_sector(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    centre, width = rng.uniform(-20, 20), wide(rng, 4.0, 10.0)

    def apply(reality: Reality, amount: float) -> None:
        def wear(rows: Rows, a: np.ndarray, d: np.ndarray) -> np.ndarray:
            age = rows.cycle / max(design.cycles)
            return amount * age * np.exp(-(((rows.angle_deg - centre) / width) ** 2))

        reality.timing.append(wear)

    return _unknown(
        "a sector of the stage wears", apply=apply, channels=(DISTANCE,), start=1e-3, limit=0.05,
        drivers=("stage_angle_deg", "cycle"), needs=("stage_angle_deg", "cycle"), unseen=("steps",),
    )  # fmt: skip


RECIPES = (
    Recipe("unknown", lambda r: sparse(r, angles=15, steps=8, pixels=40), _polarised_gloss),
    Recipe("unknown", lambda r: sparse(r, pixels=40, angles=7), _row_response),
    Recipe("unknown", lambda r: sparse(r, angles=21, steps=8, shuffled=True), _charge_memory),
    Recipe("unknown", sparse, _fading_paint),
    Recipe("unknown", rail, _beat, "point"),
    Recipe("unknown", goniometer, _penetration, "point"),
    Recipe("unknown", zones_before_target, _parallax, "zones"),
    Recipe("unknown", curves, _mode_hop, "laser"),
    Recipe("unknown", flat_fields, _reciprocity, "camera"),
    Recipe("unknown", profiles, _hysteresis, "plant"),
    Recipe("unknown", lambda r: sparse(r, pixels=48, angles=7), _etalon),
    Recipe("unknown", lambda r: ageing(r, pixels=16, angles=11, steps=8), _worn_sector),
)
