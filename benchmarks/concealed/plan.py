"""Which cases a batch holds: singles over every recipe and strength, pairs, nulls, effects outside the library."""

from typing import NamedTuple

import numpy as np

from benchmarks.concealed import effects_bench, effects_detector, effects_light, effects_timing
from benchmarks.concealed.assemble import build
from benchmarks.concealed.case import BANDS, Case, Concealment
from benchmarks.concealed.designs import dense_rows, fine_sweep, sparse
from benchmarks.concealed.effect import Effect
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor, flash

LIBRARY: tuple[Recipe, ...] = (
    *effects_light.RECIPES,
    *effects_detector.RECIPES,
    *effects_timing.RECIPES,
    *effects_bench.RECIPES,
)
SENSORS = {"flash": flash}


class Order(NamedTuple):
    """One case to make: its kind, the recipes and the band of each."""

    kind: str
    recipes: tuple[Recipe, ...]
    bands: tuple[str, ...]


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
    return Concealment(
        repeat="declared" if common else str(rng.choice(["declared", "undeclared", "none"], p=[0.6, 0.25, 0.15])),
        calibration=calibration if effects else str(rng.choice(["none", "none", "global", "pixel"])),
        tails=str(rng.choice(["normal", "heavy", "outliers"], p=[0.7, 0.15, 0.15])),
        holes=float(rng.choice([0.0, 0.05, 0.2], p=[0.6, 0.25, 0.15])),
        with_std=with_std,
        dropped=tuple(dropped),
    )


def make(rng: np.random.Generator, order: Order) -> Case:
    """Draw one case."""
    if order.kind == "null":
        design = [
            lambda: sparse(rng),
            lambda: fine_sweep(rng),
            lambda: dense_rows(rng, steps=3),
            lambda: sparse(rng, steps=5, pixels=10, angles=7, duts=1),
            lambda: sparse(rng, cycles=(3, 90, 210), steps=8, pixels=14),
        ][int(rng.integers(5))]()
        sensor = flash(rng, design)
        case = build(rng, sensor, [], [], conceal(rng, sensor, []))
    else:
        first = order.recipes[0]
        design = first.design(rng)
        sensor = SENSORS[first.sensor](rng, design)
        effects = [recipe.make(rng, sensor.rows, design) for recipe in order.recipes]
        wanted = [float(np.exp(rng.uniform(*np.log(BANDS[b])))) for b in order.bands]
        case = build(rng, sensor, effects, wanted, conceal(rng, sensor, effects))
    case.truth["kind"] = order.kind
    return case


def orders(rng: np.random.Generator, count: int) -> list[Order]:
    """A batch: one in six null, the rest singles that walk through the library with rotating strength."""
    batch = []
    walk = rng.permutation(len(LIBRARY))
    bands = tuple(BANDS)
    for k in range(count):
        if k % 6 == 5:
            batch.append(Order("null", (), ()))
            continue
        recipe = LIBRARY[walk[len(batch) % len(LIBRARY)]]
        batch.append(Order("single", (recipe,), (bands[(k + k // 6) % 3],)))
    return batch
