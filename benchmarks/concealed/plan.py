"""Which cases a batch holds: singles over every recipe and strength, pairs, nulls, effects outside the library."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.concealed import (
    camera,
    effects_bearing,
    effects_bench,
    effects_detector,
    effects_laser,
    effects_optics,
    effects_point,
    effects_strange,
    effects_timing,
    effects_unknown,
    laser_curve,
    point_sensor,
    thermal_plant,
    zone_sensor,
)
from benchmarks.concealed.assemble import build
from benchmarks.concealed.case import BANDS, Case, Concealment
from benchmarks.concealed.designs import dense_rows, fine_sweep, sparse
from benchmarks.concealed.effect import Effect
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor, flash

LIBRARY: tuple[Recipe, ...] = (
    *effects_laser.RECIPES,
    *effects_optics.RECIPES,
    *effects_detector.RECIPES,
    *effects_timing.RECIPES,
    *effects_bench.RECIPES,
    *thermal_plant.RECIPES,
    *effects_point.RECIPES,
    *zone_sensor.RECIPES,
    *camera.RECIPES,
    *laser_curve.RECIPES,
)
UNKNOWN: tuple[Recipe, ...] = (
    *effects_unknown.RECIPES,
    *effects_strange.RECIPES,
    *effects_bearing.RECIPES,
    *thermal_plant.UNKNOWN,
    *zone_sensor.UNKNOWN,
    *camera.UNKNOWN,
    *laser_curve.UNKNOWN,
)
# every recipe but those that are slow to render; their look-alikes stand in the recipes themselves
SLOW = ("optics.veiling_glare", "optics.ghost", "optics.defocus", "air.multipath", "detector.dead_pixels")
RIVALS = tuple(r for r in LIBRARY if r.effect not in SLOW)
# effects that show on a plain sparse design, so that any two of them can share a table
PAIRABLE = (
    "laser.power_decay",
    "electronics.rail_coupling",
    "beam.profile_shift",
    "detector.gain_temperature",
    "detector.dark_offset",
    "detector.compression",
    "detector.pixel_response",
    "timing.range_walk",
    "timing.temperature_offset",
    "timing.clock_scale",
    "timing.row_skew",
    "timing.thermal_lag",
    "target.reflectance_error",
)
# together they are what a dead time does
ONE_NAME_FOR_BOTH = {"detector.compression", "timing.range_walk"}
OWN_DESIGN = ("laser.power_decay", "electronics.rail_coupling", "timing.thermal_lag", "beam.profile_shift")
SENSORS: dict[str, Callable[[np.random.Generator, Any], Sensor]] = {
    "flash": flash,
    "point": point_sensor.point,
    "zones": zone_sensor.zones,
    "camera": camera.camera,
    "plant": thermal_plant.plant,
    "laser": laser_curve.laser,
}


class Order(NamedTuple):
    """One case to make: its kind, the recipes and the band of each."""

    kind: str
    recipes: tuple[Recipe, ...]
    bands: tuple[str, ...]


BY_DIE = ("timing.temperature_offset", "detector.dark_offset", "timing.thermal_lag")


def conceal(rng: np.random.Generator, sensor: Sensor, effects: list[Effect]) -> Concealment:
    """Concealment that leaves the effects' own columns in place."""
    needed = {column for e in effects for column in e.needs}
    with_std = any(e.kind == "scatter" for e in effects) or rng.random() < 0.25
    allowed = [c for c in ("none", "global", "pixel") if all(c in e.calibrations for e in effects)]
    if sensor.pixel is None and "pixel" in allowed:
        allowed.remove("pixel")
    calibration = str(rng.choice(allowed)) if rng.random() < 0.5 else "none"
    keep = {column for e in effects for column in e.drivers[:2]} | needed
    dropped = [c for c in sensor.decoys if c not in keep and rng.random() < 0.35]
    dropped += [c for c in sensor.optional if c not in needed and rng.random() < 0.12]
    common = any(e.kind == "common" for e in effects)
    wrong = any(e.effect in BY_DIE for e in effects) and rng.random() < 0.25
    if wrong:  # the effect follows the die, but only the housing was logged
        dropped += ["tof_temperature_c", "fpga_temperature_c"]
    return Concealment(
        repeat="declared" if common else str(rng.choice(["declared", "undeclared", "none"], p=[0.6, 0.25, 0.15])),
        calibration=calibration if effects else str(rng.choice(["none", "none", "global", "pixel"])),
        tails=str(rng.choice(["normal", "heavy", "outliers", "wild"], p=[0.5, 0.15, 0.15, 0.2])),
        holes=float(rng.choice([0.0, 0.05, 0.2], p=[0.6, 0.25, 0.15])),
        with_std=with_std,
        dropped=tuple(dropped),
    )


NULL_DESIGNS = (
    sparse,
    fine_sweep,
    lambda rng: dense_rows(rng, steps=3),
    lambda rng: sparse(rng, steps=5, pixels=10, angles=7, duts=1),
    lambda rng: sparse(rng, cycles=(3, 90, 210), steps=8, pixels=14),
    lambda rng: sparse(rng, pixels=60, steps=30, angles=9),
)


FOREIGN = (
    ("point", point_sensor.rail),
    ("zones", zone_sensor.zones_before_target),
    ("camera", camera.flat_fields),
    ("plant", thermal_plant.profiles),
    ("laser", laser_curve.curves),
)


def _null(rng: np.random.Generator) -> Case:
    if rng.random() < 0.35:
        name, design = FOREIGN[int(rng.integers(len(FOREIGN)))]
        sensor = SENSORS[name](rng, design(rng))
    else:
        sensor = flash(rng, NULL_DESIGNS[int(rng.integers(len(NULL_DESIGNS)))](rng))
    return build(rng, sensor, [], [], conceal(rng, sensor, []))


def _try(rng: np.random.Generator, order: Order, rivals: tuple[Recipe, ...]) -> Case:
    first = order.recipes[0]
    design = first.design(rng)
    sensor = SENSORS[first.sensor](rng, design)
    effects = [recipe.make(rng, sensor.rows, design) for recipe in order.recipes]
    if order.kind == "pair" and "masked" in order.bands:
        weak = float(np.exp(rng.uniform(np.log(6.0), np.log(12.0))))
        wanted = [10.0 * weak, weak]
    else:
        wanted = [float(np.exp(rng.uniform(*np.log(BANDS[b])))) for b in order.bands]
    return build(rng, sensor, effects, wanted, conceal(rng, sensor, effects), rivals)


def make(rng: np.random.Generator, order: Order, rivals: tuple[Recipe, ...] = RIVALS) -> Case:
    """Draw one case; what cannot be brought to its band in a design is drawn again in another."""
    if order.kind == "null":
        case = _null(rng)
    else:
        for _ in range(6):
            case = _try(rng, order, rivals)
            if all(_hit(told, band) for told, band in zip(case.truth["effects"], order.bands, strict=True)):
                break
    case.truth["kind"] = order.kind
    return case


def _hit(told: dict[str, Any], band: str) -> bool:
    return told["lambda"] > 5.0 if band == "masked" else told["band"] == band


def pairs(rng: np.random.Generator, count: int) -> list[Order]:
    """Two effects of different recipes that one design shows: the first recipe's design serves both."""
    free = [r for r in LIBRARY if r.sensor == "flash" and r.effect in PAIRABLE]
    batch = []
    for _ in range(count):
        while True:
            one, two = (free[i] for i in rng.choice(len(free), size=2, replace=False))
            masked = len(batch) % 3 == 2  # what masks shares the channel with what it hides
            alike = one.effect.startswith("timing.") == two.effect.startswith("timing.")
            if {one.effect, two.effect} == ONE_NAME_FOR_BOTH:
                continue
            if not (one.effect in OWN_DESIGN and two.effect in OWN_DESIGN) and (alike or not masked):
                break
        # the one that needs its own design brings it
        first, second = (two, one) if two.effect in OWN_DESIGN else (one, two)
        bands = ("masked", "masked") if masked else ("moderate", "moderate")
        batch.append(Order("pair", (first, second), bands))
    return batch


def orders(rng: np.random.Generator, count: int) -> list[Order]:
    """A batch: one in six null, one in eight a pair, one in six outside the library, the rest singles in turn."""
    walk = iter(np.tile(rng.permutation(len(LIBRARY)), 1 + count // len(LIBRARY)))
    strange = iter(np.tile(rng.permutation(len(UNKNOWN)), 1 + count // len(UNKNOWN)))
    couples = iter(pairs(rng, 1 + count // 8))
    bands, batch = tuple(BANDS), []
    for k in range(count):
        band = bands[(k + k // 6) % 3]
        if k % 6 == 5:
            batch.append(Order("null", (), ()))
        elif k % 6 == 3:
            batch.append(Order("unknown", (UNKNOWN[next(strange)],), (band,)))
        elif k % 8 == 4:
            batch.append(next(couples))
        else:
            batch.append(Order("single", (LIBRARY[next(walk)],), (band,)))
    return batch


def stated(rng: np.random.Generator, scale: int = 1) -> list[Order]:
    """The stated sample, `scale` times: every id once, strengths in turn; 14 null, 10 pairs, 14 unknown."""
    batch: list[Order] = []
    bands = tuple(BANDS)
    ids = sorted({recipe.effect for recipe in LIBRARY})
    for turn in range(scale):
        for k, name in enumerate(ids):
            choices = [recipe for recipe in LIBRARY if recipe.effect == name]
            batch.append(Order("single", (choices[int(rng.integers(len(choices)))],), (bands[(k + turn) % 3],)))
        batch += [Order("null", (), ())] * 14
        batch += pairs(rng, 10)
        strange = rng.permutation(len(UNKNOWN))[:14]
        batch += [Order("unknown", (UNKNOWN[i],), (bands[(k + turn) % 3],)) for k, i in enumerate(strange)]
    return [batch[i] for i in rng.permutation(len(batch))]
