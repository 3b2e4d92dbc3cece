"""A camera-like table with an intensity channel only: flat fields at several levels and temperatures, no distance."""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.effect import INTENSITY, Effect, Parameter, sign, wide
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.hooks import Hooks, answering
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor

PLACE = ("pixel_u", "pixel_v", "azimuth_deg", "elevation_deg")
HEAT = ("sensor_temperature_c", "ambient_temperature_c", "step", "time_s")
LEVEL = ("illuminance_lx", "exposure_s", "sim_intensity_counts", "sim_intensity_counts_std", "step")
WIDE, HIGH = 96, 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Rows of the table: pixel, field angles, level, exposure, temperature, step."""

    u: np.ndarray
    v: np.ndarray
    azimuth_deg: np.ndarray
    elevation_deg: np.ndarray
    level_lx: np.ndarray
    exposure_s: np.ndarray
    sensor_c: np.ndarray
    step: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraDesign:
    """Pixels (P, 2), levels, exposures and temperatures; each combination is a step."""

    pixels: np.ndarray
    levels_lx: tuple[float, ...]
    exposures_s: tuple[float, ...]
    sensor_c: tuple[float, ...]
    n_frames: int


def flat_fields(
    rng: np.random.Generator, *, pixels: int = 300, temperatures: int = 4, levels: int = 4
) -> CameraDesign:
    """Pixels strewn over the image before an integrating sphere."""
    flat = rng.choice(WIDE * HIGH, size=pixels, replace=False)
    return CameraDesign(
        pixels=np.stack([flat % WIDE, flat // WIDE], axis=1),
        levels_lx=tuple(np.geomspace(40.0, 900.0, levels)),
        exposures_s=(0.005, 0.01),
        sensor_c=tuple(np.linspace(-5, 65, temperatures)),
        n_frames=int(rng.choice([4, 16])),
    )


def _model(rows: Field, hooks: Hooks) -> Expected:
    light = rows.level_lx * rows.exposure_s * 320.0
    light = hooks.run("optics", rows, light)
    counts = hooks.run("read_out", rows, light)
    std = np.sqrt(9.0 + 0.3 * np.maximum(counts, 0.0) + (0.002 * counts) ** 2)
    std = hooks.run("scatter", rows, std)
    return Expected({INTENSITY: counts}, {INTENSITY: std}, np.ones(light.size))


def camera(rng: np.random.Generator, design: CameraDesign) -> Sensor:
    """The camera on all combinations of its design."""
    t, e, b, p = (
        x.ravel()
        for x in np.meshgrid(
            np.array(design.sensor_c),
            np.array(design.exposures_s),
            np.array(design.levels_lx),
            np.arange(len(design.pixels)),
            indexing="ij",
        )
    )
    u, v = design.pixels[p].T
    azimuth = np.degrees(np.arctan((u - (WIDE - 1) / 2) / 60.0))
    elevation = -np.degrees(np.arctan((v - (HIGH - 1) / 2) / 60.0))
    _, step = np.unique(t * 1e6 + e * 1e5 + b, return_inverse=True)
    rows = Field(
        u=u, v=v, azimuth_deg=azimuth, elevation_deg=elevation, level_lx=b, exposure_s=e, sensor_c=t, step=step
    )
    heard = rng.normal(0, 0.1, size=int(step.max()) + 1)[step]
    columns = {
        "step": step,
        "pixel_u": u,
        "pixel_v": v,
        "azimuth_deg": azimuth,
        "elevation_deg": elevation,
        "illuminance_lx": b,
        "exposure_s": e,
        "sensor_temperature_c": t + heard,
        "ambient_temperature_c": np.round(t - 6.0 + rng.normal(0, 0.3, size=int(step.max()) + 1)[step], 1),
        "time_s": 40.0 * step,
    }
    return Sensor(
        name="camera",
        columns=columns,
        answer=answering(_model, rows),
        channels=(INTENSITY,),
        n_frames=np.full(u.size, design.n_frames),
        group=step,
        sweep=step,
        repeat={INTENSITY: (0.002, 0.0)},
        gain_nuisance=(INTENSITY,),
        blocks={"steps": step},
        rows=rows,
        design=design,
        pixel=v * 1000 + u,
        decoys=("ambient_temperature_c",),
        optional=("azimuth_deg", "elevation_deg", "time_s"),
    )


def _stop(rng: np.random.Generator, rows: Field, design: CameraDesign) -> Effect:
    power = wide(rng, 2.5, 5.0)

    def apply(hooks: Hooks, amount: float) -> None:
        def fall(rows: Field, light: np.ndarray) -> np.ndarray:
            field = np.cos(np.radians(rows.azimuth_deg)) * np.cos(np.radians(rows.elevation_deg))
            return light * (1 - min(amount, 1.0) * (1 - field**power))

        hooks.add("optics", fall)

    return Effect(
        effect="optics.vignetting",
        apply=apply,
        channels=(INTENSITY,),
        drivers=PLACE,
        start=0.01,
        limit=1.0,
        needs=PLACE,
        unseen=("steps",),
        equivalents=("beam.profile_change",),
    )


def _fixed_pattern(rng: np.random.Generator, rows: Field, design: CameraDesign) -> Effect:
    gains = rng.normal(size=(HIGH, WIDE))

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("read_out", lambda rows, i: i * (1 + amount * gains[rows.v, rows.u]))

    return Effect(
        effect="detector.pixel_response",
        apply=apply,
        channels=(INTENSITY,),
        drivers=PLACE,
        start=0.003,
        limit=0.3,
        needs=PLACE,
        unseen=("steps",),
    )


def _columns(rng: np.random.Generator, rows: Field, design: CameraDesign) -> Effect:
    period, phase = float(rng.choice([2, 3, 4, 6, 8])), rng.uniform(0.3, 1.2)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add(
            "read_out", lambda rows, i: i + 300 * amount * np.sign(np.sin(2 * np.pi * (rows.u + phase) / period))
        )

    return Effect(
        effect="readout.column_pattern",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("pixel_u", "azimuth_deg"),
        start=0.002,
        limit=0.2,
        needs=PLACE,
        unseen=("steps",),
        parameters=lambda a: (Parameter(pattern="period", value=period, unit="px"),),
    )


def _dark(rng: np.random.Generator, rows: Field, design: CameraDesign) -> Effect:
    doubling_k = wide(rng, 6.0, 10.0)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("read_out", lambda rows, i: i + amount * 2.0 ** ((rows.sensor_c - 65.0) / doubling_k))

    return Effect(
        effect="detector.dark_offset",
        apply=apply,
        channels=(INTENSITY,),
        drivers=HEAT,
        start=1.0,
        limit=400.0,
        needs=HEAT[:1],
        unseen=("steps",),
        parameters=lambda a: (Parameter(pattern="doubling|double", value=doubling_k, unit="K"),),
    )


def _saturation(rng: np.random.Generator, rows: Field, design: CameraDesign) -> Effect:
    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("read_out", lambda rows, i: 3000.0 / amount * -np.expm1(-i * amount / 3000.0))

    return Effect(
        effect="detector.compression",
        apply=apply,
        channels=(INTENSITY,),
        drivers=LEVEL,
        start=0.02,
        limit=3.0,
        unseen=("steps",),
    )


def _dust(rng: np.random.Generator, rows: Field, design: CameraDesign) -> Effect:
    u0, v0 = rng.uniform(20, 76), rng.uniform(12, 52)
    radius = wide(rng, 5.0, 14.0)

    def inside(rows: Field) -> np.ndarray:
        return np.hypot(rows.u - u0, 1.3 * (rows.v - v0)) < radius

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("optics", lambda rows, light: light * np.where(inside(rows), 1 - min(amount, 0.98), 1.0))

    hit = inside(rows)
    where = {
        "pixel_u": [int(rows.u[hit].min(initial=WIDE)), int(rows.u[hit].max(initial=0))],
        "pixel_v": [int(rows.v[hit].min(initial=HIGH)), int(rows.v[hit].max(initial=0))],
    }
    return Effect(
        effect="optics.window_contamination",
        apply=apply,
        channels=(INTENSITY,),
        drivers=PLACE,
        start=0.02,
        limit=0.95,
        where=where,
        needs=PLACE,
        unseen=("steps",),
    )


def _rowwise(rng: np.random.Generator, rows: Field, design: CameraDesign) -> Effect:
    """Outside the library: the rolling read-out integrates a flickering lamp."""
    beat, way = wide(rng, 20.0, 50.0), sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add(
            "optics",
            lambda rows, light: (
                light
                * (
                    1
                    + way
                    * amount
                    * np.sin(2 * np.pi * (rows.v / beat + rows.step * 0.382))
                    * (rows.exposure_s < 0.007)
                )
            ),
        )

    return Effect(
        effect="unknown",
        nature="flicker under a rolling shutter",
        apply=apply,
        channels=(INTENSITY,),
        start=0.005,
        limit=0.3,
        drivers=("pixel_v", "elevation_deg", "step", "time_s", "exposure_s"),
        unseen=("steps",),
        needs=("pixel_v", "time_s"),
    )


RECIPES = tuple(
    Recipe(effect, design, maker, "camera")
    for effect, design, maker in (
        ("optics.vignetting", flat_fields, _stop),
        ("detector.pixel_response", flat_fields, _fixed_pattern),
        ("readout.column_pattern", flat_fields, _columns),
        ("detector.dark_offset", lambda r: flat_fields(r, temperatures=8, pixels=150), _dark),
        ("detector.compression", lambda r: flat_fields(r, levels=8, pixels=150), _saturation),
        ("optics.window_contamination", lambda r: flat_fields(r, pixels=600, temperatures=2), _dust),
    )
)
UNKNOWN = (Recipe("unknown", flat_fields, _rowwise, "camera"),)
