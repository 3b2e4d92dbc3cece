"""Concealed effects that no library lists: what a tool must call unknown, placing it and naming its drivers."""

import numpy as np

from benchmarks.concealed.designs import ageing, dense_rows, sparse
from benchmarks.concealed.effect import DIE, DISTANCE, FIELD, HISTORY, HOT, INTENSITY, Effect, sign, wide
from benchmarks.concealed.flash import Light, Reality, frame_load, illuminate
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows
from benchmarks.concealed.scene import HEIGHT_PX


def _unknown(nature: str, **given: object) -> Effect:
    return Effect(effect="unknown", nature=nature, **given)  # type: ignore[arg-type]  # keywords as Effect's own


def _parity(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    along = rng.random() < 0.7

    def apply(reality: Reality, amount: float) -> None:
        def skew(rows: Rows, a: np.ndarray, d: np.ndarray) -> np.ndarray:
            odd = 2.0 * ((rows.u if along else rows.v) % 2) - 1.0
            return amount * odd * (rows.node_c["tof"] - 34.0) / 60.0

        reality.timing.append(skew)

    drivers = (("pixel_u", "azimuth_deg") if along else ("pixel_v", "elevation_deg")) + DIE
    return _unknown(
        "parity skew x temperature",
        apply=apply,
        channels=(DISTANCE,),
        drivers=drivers,
        start=1e-3,
        limit=0.05,
        needs=(*FIELD, *DIE[:2]),
        unseen=("steps", "angles"),
    )


def _polarisation(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    axis_deg = rng.uniform(0, 180)

    def apply(reality: Reality, amount: float) -> None:
        reality.transmission.append(
            lambda rows, light: 1.0 + amount * np.cos(2.0 * np.radians(3.0 * (rows.angle_deg - axis_deg)))
        )

    return _unknown(
        "polarisation cos 2 theta",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("stage_angle_deg",),
        start=0.01,
        limit=0.5,
        needs=("stage_angle_deg",),
        unseen=("steps",),
    )


def _load_droop(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    load = frame_load(rows)
    load = load / load.mean()

    def apply(reality: Reality, amount: float) -> None:
        reality.electronics.append(lambda rows, i: i * (1.0 - amount * (load**1.5 - 1.0)))

    return _unknown(
        "load droop",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("stage_angle_deg",),
        start=0.02,
        limit=0.5,
        needs=("stage_angle_deg",),
        unseen=("steps",),
    )


def _relaxation(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    channel, way = str(rng.choice([INTENSITY, DISTANCE])), sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        def grow(rows: Rows) -> np.ndarray:
            start = rows.in_step_s - 270.0
            return way * amount * np.sqrt(np.maximum(start, 0.0) / 60.0)

        if channel == INTENSITY:
            reality.electronics.append(lambda rows, i: i * (1 + grow(rows)))
        else:
            reality.timing.append(lambda rows, a, d: 0.3 * grow(rows))

    return _unknown(
        "sqrt(t) relaxation in the step",
        apply=apply,
        channels=(channel,),
        start=0.005,
        limit=0.2,
        drivers=("time_s", "stage_angle_deg"),
        needs=("time_s", "stage_angle_deg"),
        unseen=("steps",),
    )


def _preisach(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    gaps = rng.uniform(4.0, 40.0, size=12)
    _, first, back = np.unique(rows.group, return_index=True, return_inverse=True)
    state = np.full(gaps.size, -10.0)
    course = []
    for k in first:  # every play element follows with its own slack
        heat = rows.node_c["housing"][k]
        state = np.clip(state, heat - gaps / 2, heat + gaps / 2)
        course.append(np.tanh((state - 40.0) / 25.0).mean())
    branch = np.array(course) - np.array([np.tanh((rows.node_c["housing"][k] - 40.0) / 25.0) for k in first])
    lag = branch[back]

    def apply(reality: Reality, amount: float) -> None:
        reality.electronics.append(lambda rows, i: i * (1.0 + amount * lag))

    return _unknown(
        "Preisach hysteresis",
        apply=apply,
        channels=(INTENSITY,),
        drivers=HISTORY,
        start=0.02,
        limit=0.6,
        needs=("ramp", "time_s", "step", *HOT[:2]),
        unseen=("angles",),
    )


def _moire(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    across, turn = wide(rng, 15.0, 50.0), wide(rng, 8.0, 25.0)

    def apply(reality: Reality, amount: float) -> None:
        reality.transmission.append(
            lambda rows, light: 1.0 + amount * np.sin(2 * np.pi * (rows.u / across + rows.angle_deg / turn))
        )

    return _unknown(
        "moire of pixel and stage",
        apply=apply,
        channels=(INTENSITY,),
        start=0.01,
        limit=0.4,
        drivers=("stage_angle_deg", "pixel_u", "azimuth_deg"),
        needs=("stage_angle_deg", *FIELD),
        unseen=("steps",),
    )


def _air_flow(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    def apply(reality: Reality, amount: float) -> None:
        def schlieren(rows: Rows, a: np.ndarray, d: np.ndarray) -> np.ndarray:
            draught = (rows.node_c["frame"] - rows.node_c["housing"]) / 40.0
            return amount * draught * (rows.v - 15.5) / 15.5

        reality.timing.append(schlieren)

    return _unknown(
        "air-flow tilt",
        apply=apply,
        channels=(DISTANCE,),
        drivers=("pixel_v", "elevation_deg", *HISTORY),
        start=2e-3,
        limit=0.1,
        needs=(*FIELD, *HOT[:2], "ramp"),
        unseen=("steps", "angles"),
    )


def _addressing(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    bit = int(rng.choice([2, 4, 8]))
    low = int(rng.integers(0, 12)) * 8

    def apply(reality: Reality, amount: float) -> None:
        def swapped(rows: Rows, amplitude: np.ndarray) -> np.ndarray:
            here = (rows.u >= low) & (rows.u < low + 16)
            other = illuminate(rows, Reality(), u=np.where(here, rows.u ^ bit, rows.u)).counts
            own = illuminate(rows, Reality()).counts
            return min(amount, 1.0) * (other - own)

        reality.stray.append(swapped)

    return _unknown(
        "column addressing",
        apply=apply,
        channels=(INTENSITY,),
        drivers=(*FIELD, "surface", "mixed"),
        start=0.02,
        limit=1.0,
        needs=(*FIELD, "stage_angle_deg"),
        unseen=("steps",),
        where={"pixel_u": [low, low + 15]},
    )


def _table_kinks(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    knots = np.arange(-10.0, 105.0, float(rng.choice([10.0, 15.0, 20.0])))
    values = rng.normal(size=knots.size)
    values -= np.polyval(np.polyfit(knots, values, 1), knots)

    def apply(reality: Reality, amount: float) -> None:
        reality.timing.append(lambda rows, a, d: amount * np.interp(rows.node_c["tof"], knots, values))

    return _unknown(
        "firmware table with kinks",
        apply=apply,
        channels=(DISTANCE,),
        drivers=HOT,
        start=1e-3,
        limit=0.05,
        needs=DIE[:2],
        unseen=("angles", "steps"),
    )


def _cross_light(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    dut, centre, width = int(rng.choice(design.duts)), rng.uniform(-20, 20), wide(rng, 3.0, 9.0)

    def apply(reality: Reality, amount: float) -> None:
        def foreign(rows: Rows, amplitude: np.ndarray) -> np.ndarray:
            return amount * np.exp(-(((rows.angle_deg - centre) / width) ** 2)) * (rows.dut == dut)

        reality.stray.append(foreign)

    return _unknown(
        "light of another DUT",
        apply=apply,
        channels=(INTENSITY,),
        drivers=("stage_angle_deg", "dut"),
        start=3.0,
        limit=400.0,
        needs=("stage_angle_deg", "dut"),
        unseen=("steps",),
        where={"dut": [f"#{dut}"]} if len(design.duts) > 1 else None,
    )


def _gain_switch(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    window = np.sort(rng.uniform(150.0, 1200.0, size=2))

    def apply(reality: Reality, amount: float) -> None:
        reality.electronics.append(lambda rows, i: i * (1.0 + amount * ((i > window[0]) & (i < window[1] + 150.0))))

    return _unknown(
        "gain range switch",
        apply=apply,
        channels=(INTENSITY,),
        start=0.01,
        limit=0.3,
        drivers=("sim_intensity_counts", INTENSITY, "surface", "reflectance", "sim_intensity_counts_std"),
        unseen=("steps",),
    )


def _interference(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    period_s, phase = wide(rng, 1500.0, 6000.0), rng.uniform(0, 6.28)

    def apply(reality: Reality, amount: float) -> None:
        reality.timing.append(lambda rows, a, d: amount * np.sin(2 * np.pi * rows.time_s / period_s + phase))

    return _unknown(
        "slow interference in time",
        apply=apply,
        channels=(DISTANCE,),
        drivers=("time_s", "step"),
        start=1e-3,
        limit=0.05,
        needs=("time_s",),
        unseen=("angles",),
    )


def _block_ageing(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    top = int(rng.integers(6, 24))
    rate = rng.uniform(0.5, 1.5, size=HEIGHT_PX)

    def apply(reality: Reality, amount: float) -> None:
        def fade(rows: Rows, light: Light) -> np.ndarray:
            heat = np.maximum(rows.node_c["tof"] - 60.0, 0.0) / 30.0
            age = rows.cycle / max(design.cycles)
            return 1.0 - np.minimum(amount * age * heat * rate[rows.v] * (rows.v >= top), 0.9)

        reality.transmission.append(fade)

    return _unknown(
        "read-out block fades when hot and old",
        apply=apply,
        channels=(INTENSITY,),
        start=0.02,
        limit=0.9,
        drivers=("pixel_v", "elevation_deg", "cycle", *DIE),
        needs=(*FIELD, "cycle", *DIE[:2]),
        unseen=("angles",),
        where={"pixel_v": [top, 31]},
    )


RECIPES = (
    Recipe("unknown", lambda r: sparse(r, pixels=40, angles=7), _parity),
    Recipe("unknown", lambda r: sparse(r, angles=21, steps=8), _polarisation),
    Recipe("unknown", lambda r: sparse(r, angles=21, steps=8), _load_droop),
    Recipe("unknown", lambda r: sparse(r, angles=21, steps=8, shuffled=True), _relaxation),
    Recipe("unknown", lambda r: sparse(r, steps=39, angles=5, pixels=16, duts=1), _preisach),
    Recipe("unknown", lambda r: sparse(r, angles=21, pixels=40, steps=5), _moire),
    Recipe("unknown", lambda r: sparse(r, pixels=40, angles=7), _air_flow),
    Recipe("unknown", lambda r: dense_rows(r, rows=3, steps=4, angles=9), _addressing),
    Recipe("unknown", lambda r: sparse(r, steps=34, angles=5, duts=1), _table_kinks),
    Recipe("unknown", lambda r: sparse(r, angles=31, steps=6, duts=int(r.choice([2, 3])), pixels=16), _cross_light),
    Recipe("unknown", sparse, _gain_switch),
    Recipe("unknown", lambda r: sparse(r, steps=36, angles=7, duts=1), _interference),
    Recipe("unknown", lambda r: ageing(r, pixels=40, angles=5, steps=8), _block_ageing),
)
