"""Concealed effects of window, filter and lenses on the flash sensor."""

import numpy as np

from benchmarks.concealed.designs import dense_rows, fine_sweep, full_frame, smooth, sparse
from benchmarks.concealed.effect import DISTANCE, FIELD, HISTORY, HOT, INTENSITY, Effect, Parameter, sign, wide
from benchmarks.concealed.flash import Light, Reality, frame_load, illuminate
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows


def _vignetting(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    def apply(reality: Reality, amount: float) -> None:
        def overlap(rows: Rows, light: Light) -> np.ndarray:
            # two circular stops seen at the field angle slide apart: area of the lens they share
            off = np.tan(np.radians(np.hypot(light.azimuth_deg, light.elevation_deg)))
            d = np.minimum(amount * off, 1.95) / 2.0
            return (2.0 / np.pi * (np.arccos(d) - d * np.sqrt(1 - d * d))) ** 2

        reality.transmission.append(overlap)

    return Effect(
        effect="optics.vignetting",
        apply=apply,
        channels=(INTENSITY,),
        drivers=FIELD,
        start=0.05,
        limit=1.2,
        needs=FIELD,
        unseen=("steps", "angles"),
        equivalents=("beam.profile_change",),
    )


def _filter_shift(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    index, width_nm = wide(rng, 1.6, 2.1), wide(rng, 30.0, 100.0)
    order = float(rng.choice([4.0, 8.0]))
    drift_nm_k = rng.uniform(0.02, 0.08)
    line_nm = rng.uniform(0.3, 1.5)
    grid = 1064.0 + np.linspace(-4, 4, 33) * line_nm / 2.355
    line = np.exp(-0.5 * ((grid - 1064.0) / (line_nm / 2.355)) ** 2)
    line /= line.sum()

    def apply(reality: Reality, amount: float) -> None:
        def passed(angle_deg: np.ndarray, heat_k: np.ndarray) -> np.ndarray:
            centre = 1064.0 + amount * 0.3 * width_nm
            sine = np.sin(np.radians(angle_deg)) / index
            moved = centre * (1.0 - amount * (1.0 - np.sqrt(1.0 - sine * sine))) + amount * drift_nm_k * heat_k
            off = (grid[None, :] - moved[:, None]) / (width_nm / 2.0)
            return np.exp(-np.log(2.0) * np.abs(off) ** order) @ line

        def filtered(rows: Rows, light: Light) -> np.ndarray:
            field = np.hypot(light.azimuth_deg, light.elevation_deg)
            heat = rows.node_c["housing"] - 25.0
            return passed(field, heat) / passed(np.zeros(1), np.zeros(1))

        reality.transmission.append(filtered)

    return Effect(
        effect="optics.filter_shift",
        apply=apply,
        channels=(INTENSITY,),
        drivers=(*FIELD, *HOT),
        start=0.3,
        limit=1.6,
        needs=(*FIELD, *HOT[:2]),
        unseen=("steps", "angles"),
        calibrations=("none", "pixel"),
        equivalents=("optics.vignetting", "beam.profile_change"),
    )


def _frost(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    slope = rng.uniform(0.0, 0.8) * sign(rng)
    peak = float(rows.frost_kg_m2.max())

    def apply(reality: Reality, amount: float) -> None:
        def film(rows: Rows, light: Light) -> np.ndarray:
            thick = rows.frost_kg_m2 / peak * (1.0 + slope * (rows.v - 15.5) / 15.5)
            return np.exp(-2.0 * amount * thick)

        reality.transmission.append(film)

    cold = float(rows.node_c["housing"][rows.frost_kg_m2 > 0.05 * peak].max())
    return Effect(
        effect="optics.window_frost",
        apply=apply,
        channels=(INTENSITY,),
        drivers=(*HISTORY, "pixel_v"),
        start=0.05,
        limit=4.0,
        needs=(*HOT[:2], "ramp", "pixel_v", "time_s"),
        unseen=("angles",),
        where={"housing_temperature_c": [-15.0, cold]},
    )


def _contamination(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    dut = int(rng.choice(design.duts))
    centre = design.pixels[rng.integers(len(design.pixels))]
    blobs = [
        (
            centre[0] + rng.normal(0, 5),
            centre[1] + rng.normal(0, 2),
            rng.uniform(4, 14),
            rng.uniform(2, 6),
            rng.uniform(0.4, 1.0),
        )
        for _ in range(int(rng.integers(2, 5)))
    ]

    def cover(rows: Rows) -> np.ndarray:
        clear = np.ones(len(rows))
        for u, v, su, sv, depth in blobs:
            clear *= 1.0 - depth * (((rows.u - u) / su) ** 2 + ((rows.v - v) / sv) ** 2 < 1.0)
        return (1.0 - clear) * (rows.dut == dut)

    def apply(reality: Reality, amount: float) -> None:
        reality.transmission.append(lambda rows, light: (1.0 - min(amount, 1.0) * cover(rows)) ** 2)

    dirty = cover(rows) > 0
    u, v = rows.u[dirty], rows.v[dirty]
    where: dict[str, list[object]] = {
        "pixel_u": [int(u.min()), int(u.max())],
        "pixel_v": [int(v.min()), int(v.max())],
    }
    if len(design.duts) > 1:
        where["dut"] = [f"#{dut}"]
    return Effect(
        effect="optics.window_contamination",
        apply=apply,
        channels=(INTENSITY,),
        drivers=(*FIELD, "dut"),
        start=0.05,
        limit=0.95,
        where=where,
        needs=(*FIELD, "dut"),
        unseen=("steps", "angles"),
    )


def _glare(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    load = frame_load(rows)

    def apply(reality: Reality, amount: float) -> None:
        # what the frame gains over its whole, every pixel loses of its own
        reality.stray.append(lambda rows, amplitude: amount * (load - amplitude))

    return Effect(
        effect="optics.veiling_glare",
        apply=apply,
        channels=(INTENSITY,),
        start=0.005,
        limit=0.5,
        drivers=("stage_angle_deg", "sim_intensity_counts", "reflectance", "surface", "pixel_u"),
        unseen=("steps", "angles"),
        needs=("stage_angle_deg",),
        parameters=lambda a: (Parameter(pattern="share|fraction|strength|glare", value=a, unit=""),),
    )


def _ghost(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    cu, cv = 63.5 + rng.uniform(-2, 2), 15.5 + rng.uniform(-2, 2)

    def apply(reality: Reality, amount: float) -> None:
        def mirrored(rows: Rows, amplitude: np.ndarray) -> np.ndarray:
            u, v = np.clip(2 * cu - rows.u, -2, 129), np.clip(2 * cv - rows.v, -2, 33)
            return amount * illuminate(rows, Reality(), u=u, v=v).counts

        reality.stray.append(mirrored)

    return Effect(
        effect="optics.ghost",
        apply=apply,
        channels=(INTENSITY,),
        start=0.003,
        limit=0.3,
        drivers=("pixel_u", "azimuth_deg", "stage_angle_deg", "pixel_v"),
        unseen=("steps",),
        needs=("stage_angle_deg", *FIELD),
    )


def _focal_drift(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    way = sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        reality.focal.append(lambda rows: 1.0 + way * amount * (rows.node_c["housing"] - 25.0))

    return Effect(
        effect="optics.focal_drift",
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=(*HOT, *FIELD),
        start=2e-5,
        limit=2e-3,
        needs=(*FIELD, *HOT[:2], "stage_angle_deg"),
        unseen=("steps",),
        parameters=lambda a: (Parameter(pattern="focal|coeff|slope|k", value=way * a, unit="1/K"),),
        calibrations=("none", "global", "pixel"),
    )


def _defocus(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    best_c = rng.uniform(15, 35)
    static = rng.random() < 0.4

    def apply(reality: Reality, amount: float) -> None:
        def blur(rows: Rows) -> np.ndarray:
            away = np.ones(len(rows)) if static else np.abs(rows.node_c["housing"] - best_c) / 60.0
            return amount * away

        reality.blur_px.append(blur)

    return Effect(
        effect="optics.defocus",
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        start=0.15,
        limit=3.0,
        drivers=("mixed", "surface", "stage_angle_deg", *FIELD, *HOT),
        needs=(*FIELD, "stage_angle_deg"),
        unseen=("steps",),
        equivalents=("target.edge_mixing",) if static else (),
        unless_seen=((DISTANCE, "detector.crosstalk"),) if static else (),
    )


RECIPES = (
    Recipe("optics.vignetting", lambda r: sparse(r, pixels=60, angles=9, steps=8), _vignetting),
    Recipe("optics.filter_shift", lambda r: sparse(r, pixels=60, angles=7, steps=10), _filter_shift),
    Recipe(
        "optics.window_frost",
        lambda r: sparse(r, steps=30, pixels=20, angles=7, duts=1, dew_point_c=float(r.uniform(-3, 4))),
        _frost,
    ),
    Recipe("optics.window_contamination", lambda r: full_frame(r, stride=2, steps=3), _contamination),
    Recipe("optics.veiling_glare", lambda r: sparse(r, angles=15, steps=8), _glare),
    Recipe("optics.ghost", lambda r: full_frame(r, steps=1, angles=3, stride=1), _ghost),
    Recipe("optics.focal_drift", lambda r: smooth(fine_sweep(r, steps=8, pixels=30), r), _focal_drift),
    Recipe("optics.defocus", lambda r: smooth(dense_rows(r, rows=3, steps=5, angles=7), r), _defocus),
)
