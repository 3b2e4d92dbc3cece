"""A single-point time-of-flight sensor before a target whose distance, paint, inclination and temperature vary."""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.effect import DISTANCE, INTENSITY, wide
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.hooks import Hooks, answering
from benchmarks.concealed.sensor import Sensor

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
