"""Concealed effects on the single-point sensor."""

import numpy as np

from benchmarks.concealed.effect import DIE, DISTANCE, INTENSITY, Effect, Parameter, sign, wide
from benchmarks.concealed.hooks import Hooks
from benchmarks.concealed.point_sensor import BRIGHT, FAR, PointDesign, PointRows, goniometer, rail
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.spad import first_photon
from benchmarks.concealed.waveform import LIGHT_M_NS, draw_receiver, stamp_ns


def _walk(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    receiver = draw_receiver(rng)
    grid = np.geomspace(4.0, 9000.0, 400)
    curve = stamp_ns(receiver, grid)

    def apply(hooks: Hooks, amount: float) -> None:
        def late(rows: PointRows, distance: np.ndarray, light: np.ndarray) -> np.ndarray:
            stamps = np.interp(light, grid, curve) - np.interp(1000.0, grid, curve)
            return distance + amount * 0.5 * LIGHT_M_NS * stamps

        hooks.add("timing", late)

    return Effect(
        effect="timing.range_walk",
        apply=apply,
        channels=(DISTANCE,),
        drivers=BRIGHT,
        start=0.02,
        limit=3.0,
        unseen=("steps", "distances"),
    )


def _clock(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    way = sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("timing", lambda rows, d, light: d * (1 + way * amount))

    return Effect(
        effect="timing.clock_scale",
        apply=apply,
        channels=(DISTANCE,),
        drivers=FAR,
        start=1e-4,
        limit=0.03,
        unseen=("steps", "distances"),
        parameters=lambda a: (Parameter(pattern="scale|stretch|clock|ppm|eps", value=way * a, unit=""),),
    )


def _delay_line(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    period = wide(rng, 0.3, 1.5)
    cells = rng.normal(size=24)
    integral = np.cumsum(cells - cells.mean())
    # the line's carry chain adds one slow sag over the period to the cells' own scatter
    integral = integral / np.abs(integral).max() * 0.3 + np.sin(2 * np.pi * np.arange(24) / 24 + rng.uniform(0, 6.28))

    def apply(hooks: Hooks, amount: float) -> None:
        def bend(rows: PointRows, distance: np.ndarray, light: np.ndarray) -> np.ndarray:
            phase = np.mod(distance / period, 1.0) * 24
            return distance + amount * np.interp(phase, np.arange(25), np.append(integral, integral[0]))

        hooks.add("timing", bend)

    return Effect(
        effect="timing.tdc_nonlinearity",
        apply=apply,
        channels=(DISTANCE,),
        drivers=FAR,
        start=5e-4,
        limit=0.05,
        unseen=("steps",),
        needs=("true_range_m",),
        parameters=lambda a: (Parameter(pattern="period", value=period, unit="m"),),
    )


def _temperature(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    way = sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("timing", lambda rows, d, light: d + way * amount * (rows.die_c - 32.0))

    return Effect(
        effect="timing.temperature_offset",
        apply=apply,
        channels=(DISTANCE,),
        start=1e-5,
        limit=2e-3,
        drivers=(*DIE, "ambient_temperature_c", "step", "time_s"),
        unseen=("distances", "steps"),
        parameters=lambda a: (Parameter(pattern=".*", value=way * a, unit="m/K"),),
    )


def _floor_bounce(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    height = wide(rng, 0.15, 0.5)

    def apply(hooks: Hooks, amount: float) -> None:
        def longer(rows: PointRows, distance: np.ndarray, light: np.ndarray) -> np.ndarray:
            detour = np.sqrt(rows.range_m**2 + 4 * height**2)
            grazing = amount * rows.range_m**2 / detour**2 * np.exp(-2.0 * height / rows.range_m)
            return distance + grazing / (1 + grazing) * 0.5 * (detour - rows.range_m)

        hooks.add("path", longer)

    return Effect(
        effect="air.multipath",
        apply=apply,
        channels=(DISTANCE,),
        drivers=FAR,
        start=0.02,
        limit=1.5,
        unseen=("steps", "distances"),
        needs=("true_range_m",),
    )


def _compression(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    sharp = wide(rng, 1.0, 3.0)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("electronics", lambda rows, i: i / (1 + (amount * i / design.full_counts) ** sharp) ** (1 / sharp))

    return Effect(
        effect="detector.compression",
        apply=apply,
        channels=(INTENSITY,),
        drivers=BRIGHT,
        start=0.05,
        limit=3.0,
        unseen=("steps", "distances"),
    )


def _dark(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    doubling_k = wide(rng, 7.0, 12.0)

    def apply(hooks: Hooks, amount: float) -> None:
        def dark(rows: PointRows) -> np.ndarray:
            return amount * 2.0 ** ((rows.die_c - 85.0) / doubling_k)

        hooks.add("electronics", lambda rows, i: i + dark(rows))
        hooks.add("counts_std", lambda rows, s: np.sqrt(s * s + 0.4 * dark(rows)))

    return Effect(
        effect="detector.dark_offset",
        apply=apply,
        channels=(INTENSITY,),
        start=1.0,
        limit=300.0,
        drivers=(*DIE, "ambient_temperature_c", "step", "time_s"),
        unseen=("distances",),
        parameters=lambda a: (Parameter(pattern="doubling|double", value=doubling_k, unit="K"),),
    )


def _gain(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    way, bend = sign(rng), rng.uniform(-0.2, 0.2)

    def apply(hooks: Hooks, amount: float) -> None:
        def gain(rows: PointRows, i: np.ndarray) -> np.ndarray:
            heat = rows.die_c - 32.0
            return i * np.exp(way * amount * heat * (1 + bend * heat / 50.0))

        hooks.add("electronics", gain)

    return Effect(
        effect="detector.gain_temperature",
        apply=apply,
        channels=(INTENSITY,),
        start=3e-4,
        limit=0.01,
        drivers=(*DIE, "ambient_temperature_c", "step", "time_s"),
        unseen=("distances", "steps"),
        equivalents=("laser.thermal_rolloff",),
    )


def _lobe(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    rough = rng.uniform(0.3, 0.9)

    def apply(hooks: Hooks, amount: float) -> None:
        def facets(rows: PointRows, light: np.ndarray) -> np.ndarray:
            # V-cavities seen from the light: shadow-free backscatter stays flatter than the cosine
            angle = np.radians(rows.incidence_deg)
            rise = 1 + rough * np.sin(angle) * np.tan(np.minimum(angle, 1.35))
            return light * (1 + amount * (rise - 1))

        hooks.add("light", facets)

    return Effect(
        effect="target.non_lambertian",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("incidence_deg",),
        start=0.02,
        limit=1.5,
        needs=("incidence_deg",),
        unseen=("steps", "angles"),
    )


def _paint(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    pick, way = str(rng.choice(design.paints)), sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("light", lambda rows, light: light * np.where(rows.paint == pick, 1 + way * amount, 1.0))

    return Effect(
        effect="target.reflectance_error",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("surface", "reflectance"),
        start=0.004,
        limit=0.5,
        where={"surface": [pick]},
        needs=("surface",),
        unseen=("steps", "distances"),
        parameters=lambda a: (Parameter(pattern="error|reflect|rel|delta|rho|e", value=way * a, unit=""),),
    )


def _first_photon(rng: np.random.Generator, rows: PointRows, design: PointDesign) -> Effect:
    width_ns = wide(rng, 1.0, 4.0)

    def apply(hooks: Hooks, amount: float) -> None:
        def flux(light: np.ndarray) -> np.ndarray:
            return np.maximum(amount * light / design.full_counts, 1e-9)

        hooks.add("electronics", lambda rows, i: i * -np.expm1(-flux(i)) / flux(i))
        hooks.add("timing", lambda rows, d, light: d + first_photon(flux(light), width_ns))

    return Effect(
        effect="detector.pile_up",
        unless_seen=((DISTANCE, "detector.compression"), (INTENSITY, "timing.range_walk")),
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=BRIGHT,
        start=0.02,
        limit=4.0,
        unseen=("steps", "distances"),
    )


RECIPES = tuple(
    Recipe(effect, design, maker, "point")
    for effect, design, maker in (
        ("timing.range_walk", rail, _walk),
        ("timing.clock_scale", rail, _clock),
        ("timing.tdc_nonlinearity", lambda r: rail(r, distances=160, temperatures=4, far_m=4.0), _delay_line),
        ("timing.temperature_offset", rail, _temperature),
        ("air.multipath", lambda r: rail(r, distances=120, temperatures=4), _floor_bounce),
        ("detector.compression", rail, _compression),
        ("detector.dark_offset", lambda r: rail(r, temperatures=12), _dark),
        ("detector.gain_temperature", rail, _gain),
        ("target.non_lambertian", goniometer, _lobe),
        ("target.reflectance_error", rail, _paint),
        ("detector.pile_up", rail, _first_photon),
    )
)
