"""A single-point time-of-flight sensor before a target whose distance, paint, inclination and temperature vary."""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.effect import DIE, DISTANCE, INTENSITY, Effect, Parameter, sign, wide
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.hooks import Hooks, answering
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor
from benchmarks.concealed.spad import first_photon
from benchmarks.concealed.waveform import LIGHT_M_NS, draw_receiver, stamp_ns

BRIGHT = (
    "sim_intensity_counts",
    "intensity_counts",
    "reflectance",
    "true_range_m",
    "sim_distance_m",
    "surface",
    "sim_intensity_counts_std",
    "sim_distance_m_std",
    "incidence_deg",
)
FAR = ("true_range_m", "sim_distance_m")
PAINTS = {"black": 0.06, "grey_18": 0.18, "grey_50": 0.50, "white": 0.88}


@dataclass(frozen=True, slots=True, kw_only=True)
class PointRows:
    """Arrays of equal length."""

    range_m: np.ndarray
    reflectance: np.ndarray
    paint: np.ndarray
    incidence_deg: np.ndarray
    chamber_c: np.ndarray
    die_c: np.ndarray
    time_s: np.ndarray
    step: np.ndarray
    sweep: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class PointDesign:
    """Distances, paints, inclinations and temperatures, all combined; `full_counts` at 1 m from white."""

    range_m: np.ndarray
    paints: tuple[str, ...]
    incidence_deg: tuple[float, ...] = (0.0,)
    chamber_c: tuple[float, ...] = (25.0,)
    n_frames: int = 16
    full_counts: float = 2500.0


def rail(rng: np.random.Generator, *, temperatures: int = 8, distances: int = 60, far_m: float = 6.0) -> PointDesign:
    """A target on a rail."""
    return PointDesign(
        range_m=np.sort(rng.uniform(0.3, far_m, size=distances)),
        paints=("grey_18", "grey_50", "white"),
        chamber_c=tuple(np.round(np.linspace(-10, 80, temperatures), 0)),
        n_frames=int(rng.choice([4, 16, 32])),
        full_counts=wide(rng, 1500, 4000),
    )


def goniometer(rng: np.random.Generator) -> PointDesign:
    """A target that turns, at few distances."""
    return PointDesign(
        range_m=np.array([0.8, 1.3, 2.0]),
        paints=("grey_18", "grey_50", "white"),
        incidence_deg=tuple(np.linspace(0, 70, 29)),
        chamber_c=tuple(np.linspace(10, 40, 6)),
        full_counts=2500.0,
    )


def _model(rows: PointRows, hooks: Hooks, full_counts: float) -> Expected:
    cosine = np.cos(np.radians(rows.incidence_deg))
    light = full_counts * rows.reflectance / 0.88 * cosine / np.maximum(rows.range_m, 0.2) ** 2
    light = hooks.run("light", rows, light / (1.0 + 0.02 / rows.range_m**2))
    counts = hooks.run("electronics", rows, light)
    distance = hooks.run("path", rows, rows.range_m.astype(float), light)
    distance = hooks.run("timing", rows, distance, light)
    counts_std = np.sqrt(16.0 + 0.4 * np.maximum(counts, 0) + (0.003 * counts) ** 2)
    distance_std = np.hypot(0.0025, 0.12 * counts_std / np.maximum(counts, 1.0))
    std = {INTENSITY: hooks.run("counts_std", rows, counts_std), DISTANCE: distance_std}
    return Expected({INTENSITY: counts, DISTANCE: distance}, std, (counts >= 8.0).astype(float))


def point(rng: np.random.Generator, design: PointDesign) -> Sensor:
    """The sensor on all combinations of its design."""
    paint = np.arange(len(design.paints))
    t, p, a, r = (
        x.ravel()
        for x in np.meshgrid(
            np.arange(len(design.chamber_c)), paint, np.array(design.incidence_deg), design.range_m, indexing="ij"
        )
    )
    chamber = np.array(design.chamber_c)[t]
    self_heating = rng.uniform(4.0, 12.0)
    rows = PointRows(
        range_m=r,
        reflectance=np.array([PAINTS[name] for name in design.paints])[p],
        paint=np.array(design.paints)[p],
        incidence_deg=a,
        chamber_c=chamber,
        die_c=chamber + self_heating,
        step=t,
        time_s=30.0 * np.arange(r.size),
        sweep=np.arange(r.size),
    )
    columns = {
        "step": rows.step,
        "time_s": rows.time_s,
        "true_range_m": rows.range_m,
        "surface": rows.paint,
        "reflectance": rows.reflectance,
        "incidence_deg": rows.incidence_deg,
        "ambient_temperature_c": np.round(rows.chamber_c + rng.normal(0, 0.15, r.size), 1),
        "tof_temperature_c": np.round(rows.die_c + rng.normal(0, 0.15, r.size), 2),
        "rail_3v3_v": 3.3 * (1 + rng.normal(0, 1e-3, r.size)),
        "laser_current_a": 6.0 * (1 + rng.normal(0, 1e-3, r.size)),
    }
    return Sensor(
        name="point",
        columns=columns,
        answer=answering(lambda s, h: _model(s, h, design.full_counts), rows),
        channels=(INTENSITY, DISTANCE),
        n_frames=np.full(r.size, design.n_frames),
        group=rows.step,
        sweep=rows.sweep,
        repeat={INTENSITY: (0.002, 0.0), DISTANCE: (0.0, float(rng.uniform(1e-4, 6e-4)))},
        gain_nuisance=(INTENSITY,),
        blocks={
            "steps": rows.step,
            "distances": np.digitize(rows.range_m, np.linspace(0.3, 6.0, 15)),
            "angles": rows.incidence_deg,
        },
        rows=rows,
        design=design,
        decoys=("rail_3v3_v", "laser_current_a"),
        optional=("time_s", "incidence_deg"),
        writes_valid=True,
    )


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
