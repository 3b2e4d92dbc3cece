"""Concealed effects of detector and read-out on the flash sensor."""

import numpy as np

from benchmarks.concealed.designs import ageing, dense_rows, full_frame, sparse
from benchmarks.concealed.effect import DIE, DISTANCE, FIELD, HOT, INTENSITY, Effect, Parameter, sign, wide
from benchmarks.concealed.flash import Reality, illuminate
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows
from benchmarks.concealed.scene import HEIGHT_PX, WIDTH_PX
from benchmarks.concealed.spad import first_photon

BRIGHT = (
    "sim_intensity_counts",
    "intensity_counts",
    "reflectance",
    "surface",
    "sim_intensity_counts_std",
    "sim_distance_m_std",
)


def _gain_temperature(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    avalanche, power, way = rng.random() < 0.6, rng.uniform(0.6, 1.4), sign(rng)
    over = rng.uniform(0.90, 0.97)

    def apply(reality: Reality, amount: float) -> None:
        def gain(rows: Rows, intensity: np.ndarray) -> np.ndarray:
            heat = rows.node_c["tof"] - 34.0
            if not avalanche:
                return intensity * np.exp(way * amount * heat)
            # multiplication M = 1/(1 − (V/Vb)^n), the breakdown voltage follows the die's temperature
            shift = amount * heat * (1 - over**power) / (power * over**power)
            return intensity * (1 - over**power) / (1 - np.minimum((over / (1 + shift)) ** power, 0.995))

        reality.electronics.append(gain)

    free = design.laser_program_k > 0
    return Effect(
        effect="detector.gain_temperature",
        apply=apply,
        channels=(INTENSITY,),
        drivers=DIE if free else HOT,
        start=3e-4,
        limit=8e-3,
        needs=("tof_temperature_c", "laser_temperature_c"),
        unseen=("steps", "angles", "dut"),
        equivalents=() if free else ("laser.thermal_rolloff",),
        parameters=lambda a: (
            () if avalanche else (Parameter(pattern="k|slope|coef|gain", value=way * a, unit="1/K"),)
        ),
    )


def _pile_up(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    width_ns = wide(rng, 1.5, 5.0)

    def apply(reality: Reality, amount: float) -> None:
        def counts(rows: Rows, intensity: np.ndarray) -> np.ndarray:
            flux = amount * intensity / 4000.0
            return intensity * np.where(flux > 1e-9, -np.expm1(-flux) / np.maximum(flux, 1e-9), 1.0)

        def early(rows: Rows, amplitude: np.ndarray, distance: np.ndarray) -> np.ndarray:
            return first_photon(amount * amplitude / 4000.0, width_ns)

        reality.electronics.append(counts)
        reality.timing.append(early)

    return Effect(
        effect="detector.pile_up",
        unless_seen=((DISTANCE, "detector.compression"), (INTENSITY, "timing.range_walk")),
        apply=apply,
        channels=(INTENSITY, DISTANCE),
        drivers=BRIGHT,
        start=0.02,
        limit=4.0,
        unseen=("steps", "angles", "dut"),
    )


def _dark_offset(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    doubling_k = wide(rng, 7.0, 12.0)

    def dark(rows: Rows, amount: float) -> np.ndarray:
        return amount * 2.0 ** ((rows.node_c["tof"] - 94.0) / doubling_k)

    def apply(reality: Reality, amount: float) -> None:
        def widen(rows: Rows, channel: str, std: np.ndarray, intensity: np.ndarray) -> np.ndarray:
            return np.sqrt(std**2 + 0.25 * dark(rows, amount)) if channel == INTENSITY else std

        reality.electronics.append(lambda rows, intensity: intensity + dark(rows, amount))
        reality.noise.append(widen)

    return Effect(
        effect="detector.dark_offset",
        apply=apply,
        channels=(INTENSITY,),
        drivers=HOT,
        start=2.0,
        limit=200.0,
        needs=HOT[:2],
        unseen=("steps", "angles", "dut"),
        parameters=lambda a: (Parameter(pattern="doubling|double", value=doubling_k, unit="K"),),
    )


def _compression(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    kind, sharp = str(rng.choice(["naka", "tanh", "knee"])), rng.uniform(1.2, 3.0)

    def apply(reality: Reality, amount: float) -> None:
        def flatten(rows: Rows, intensity: np.ndarray) -> np.ndarray:
            x = amount * intensity / 4000.0
            if kind == "tanh":
                return intensity * np.tanh(x) / np.maximum(x, 1e-9)
            if kind == "knee":  # the amplifier's slope falls beyond a soft knee
                return intensity / (1.0 + x**sharp) ** (1.0 / sharp)
            return intensity / (1.0 + x)

        reality.electronics.append(flatten)

    return Effect(
        effect="detector.compression",
        apply=apply,
        channels=(INTENSITY,),
        drivers=BRIGHT,
        start=0.1,
        limit=3.0,
        unseen=("steps", "angles", "dut"),
    )


def _crosstalk(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    along = str(rng.choice(["both", "u"], p=[0.6, 0.4]))
    moves = [(-1, 0), (1, 0)] + ([(0, -1), (0, 1)] if along == "both" else [])

    def apply(reality: Reality, amount: float) -> None:
        def leak(rows: Rows, amplitude: np.ndarray) -> np.ndarray:
            own, total = illuminate(rows, Reality()).counts, np.zeros(len(rows))
            for du, dv in moves:
                u, v = np.clip(rows.u + du, 0, WIDTH_PX - 1), np.clip(rows.v + dv, 0, HEIGHT_PX - 1)
                total += illuminate(rows, Reality(), u=u, v=v).counts - own
            return amount * total

        reality.stray.append(leak)

    return Effect(
        effect="detector.crosstalk",
        apply=apply,
        channels=(INTENSITY,),
        start=0.005,
        limit=0.2,
        drivers=("mixed", "surface", *FIELD, "stage_angle_deg", *BRIGHT[:3]),
        unseen=("steps",),
        needs=(*FIELD, "stage_angle_deg"),
        equivalents=("optics.defocus",),
        parameters=lambda a: (Parameter(pattern="leak|share|crosstalk|fraction|coupl", value=a, unit=""),),
    )


def _pixel_response(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    draws = rng.standard_t(6, size=(3, HEIGHT_PX, WIDTH_PX)) / np.sqrt(1.5)
    drawn = draws[np.array(design.duts)[:, None], design.pixels[:, 1], design.pixels[:, 0]]
    spread = float(np.std(drawn))  # of the pixels that the table has: few heavy-tailed draws scatter otherwise

    def apply(reality: Reality, amount: float) -> None:
        reality.electronics.append(
            lambda rows, i: i * np.maximum(1.0 + amount * draws[rows.dut, rows.v, rows.u], 0.05)
        )

    return Effect(
        effect="detector.pixel_response",
        apply=apply,
        channels=(INTENSITY,),
        drivers=FIELD,
        start=0.004,
        limit=0.3,
        needs=(*FIELD, "dut"),
        unseen=("steps", "angles"),
        parameters=lambda a: (Parameter(pattern="sd|std|sigma|spread|scatter", value=spread * a, unit=""),),
    )


def _dead_pixels(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    order = rng.permutation(len(design.pixels))
    pixels = design.pixels[order]
    birth = rng.uniform(0, 0.9, size=len(pixels)) if len(design.cycles) > 1 else np.zeros(len(pixels))
    dut = int(rng.choice(design.duts))

    def apply(reality: Reality, amount: float) -> None:
        count = max(1, round(amount))
        code = {(int(u), int(v)): float(b) for (u, v), b in zip(pixels[:count], birth[:count], strict=True)}

        def dead(rows: Rows) -> np.ndarray:
            born = np.array([code.get((int(u), int(v)), np.inf) for u, v in zip(rows.u, rows.v, strict=True)])
            return (rows.dut == dut) & (rows.cycle / max(design.cycles) >= born)

        reality.dead.append(dead)

    return Effect(
        effect="detector.dead_pixels",
        apply=apply,
        channels=("valid_fraction", INTENSITY),
        kind="dead",
        drivers=(*FIELD, "cycle"),
        start=1.0,
        limit=len(pixels) / 3,
        needs=(*FIELD, "dut", "cycle"),
        unseen=("steps", "angles"),
        calibrations=("none",),
    )


def _column_pattern(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    along = "u" if len(np.unique(design.pixels[:, 1])) < 12 or rng.random() < 0.6 else "v"
    period = float(rng.choice([2, 4, 8])) if rng.random() < 0.5 else wide(rng, 2.5, 14.0)
    phase, square = rng.uniform(0.2, 1.2), rng.random() < 0.3
    additive = rng.random() < 0.4

    def wave(rows: Rows) -> np.ndarray:
        s = np.sin(2 * np.pi * (rows.u if along == "u" else rows.v) / period + phase)
        return np.sign(s) if square else s

    def apply(reality: Reality, amount: float) -> None:
        reality.electronics.append(
            (lambda rows, i: i + 600.0 * amount * wave(rows))
            if additive
            else (lambda rows, i: i * (1 + amount * wave(rows)))
        )

    drivers = ("pixel_u", "azimuth_deg") if along == "u" else ("pixel_v", "elevation_deg")
    return Effect(
        effect="readout.column_pattern",
        apply=apply,
        channels=(INTENSITY,),
        drivers=drivers,
        start=0.004,
        limit=0.2,
        needs=FIELD,
        unseen=("steps", "angles"),
        parameters=lambda a: (Parameter(pattern="period", value=period, unit="px"),),
    )


def _noise_excess(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    kind = str(rng.choice(["everywhere", "hot", "columns"]))
    edge_c = float(rng.uniform(45, 65))
    channel_hit = str(rng.choice([INTENSITY, DISTANCE]))

    def apply(reality: Reality, amount: float) -> None:
        def widen(rows: Rows, channel: str, std: np.ndarray, intensity: np.ndarray) -> np.ndarray:
            if channel != channel_hit:
                return std
            on = {
                "everywhere": np.ones(len(rows), bool),
                "hot": rows.node_c["housing"] > edge_c,
                "columns": rows.u >= 64,
            }[kind]
            return std * np.where(on, 1.0 + amount, 1.0)

        reality.noise.append(widen)

    where: dict[str, dict[str, list[object]] | None] = {
        "everywhere": None,
        "hot": {"housing_temperature_c": [edge_c, 95.0]},
        "columns": {"pixel_u": [64, 127]},
    }
    drivers = {"everywhere": (), "hot": HOT, "columns": FIELD}[kind]
    return Effect(
        effect="readout.noise_excess",
        apply=apply,
        channels=(f"{channel_hit}_std", channel_hit),
        kind="scatter",
        drivers=drivers,
        where=where[kind],
        start=0.1,
        limit=4.0,
        calibrations=("none",),
        needs=(f"{channel_hit}_std", *HOT[:2], *FIELD),
        unseen=("steps", "angles"),
    )


RECIPES = (
    Recipe(
        "detector.gain_temperature",
        lambda r: sparse(r, laser_program_k=float(r.choice([0.0, 8.0], p=[0.2, 0.8]))),
        _gain_temperature,
    ),
    Recipe("detector.pile_up", sparse, _pile_up),
    Recipe("detector.dark_offset", lambda r: sparse(r, steps=20), _dark_offset),
    Recipe("detector.compression", sparse, _compression),
    Recipe("detector.crosstalk", lambda r: dense_rows(r, rows=5, steps=2, angles=9), _crosstalk),
    Recipe("detector.pixel_response", lambda r: sparse(r, pixels=80, steps=8, angles=5), _pixel_response),
    Recipe("detector.dead_pixels", lambda r: ageing(r, pixels=60, angles=5, steps=3), _dead_pixels),
    Recipe(
        "readout.column_pattern",
        lambda r: dense_rows(r, rows=3, steps=3, angles=7) if r.random() < 0.5 else full_frame(r, stride=1),
        _column_pattern,
    ),
    Recipe("readout.noise_excess", sparse, _noise_excess),
)
