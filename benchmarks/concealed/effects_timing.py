"""Concealed effects of timing on the flash sensor's distance."""

import numpy as np

from benchmarks.concealed.designs import sparse
from benchmarks.concealed.effect import DISTANCE, FIELD, HISTORY, HOT, Effect, Parameter, sign, wide
from benchmarks.concealed.effects_detector import BRIGHT
from benchmarks.concealed.flash import Reality
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.rows import Design, Rows
from benchmarks.concealed.thermal_network import Network
from benchmarks.concealed.waveform import LIGHT_M_NS, draw_receiver, stamp_ns


def _range_walk(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    receiver = draw_receiver(rng)
    reference = float(rng.uniform(800, 2500))

    def apply(reality: Reality, amount: float) -> None:
        def walk(rows: Rows, amplitude: np.ndarray, distance: np.ndarray) -> np.ndarray:
            # pulse, response and charge shorter by `amount`: sampled before, as a tick would be coarse for the result
            late = stamp_ns(receiver, amplitude) - stamp_ns(receiver, np.array([reference]))
            return 0.5 * LIGHT_M_NS * amount * late

        reality.timing.append(walk)

    return Effect(
        effect="timing.range_walk",
        apply=apply,
        channels=(DISTANCE,),
        drivers=BRIGHT,
        start=0.05,
        limit=2.5,
        unseen=("steps", "angles", "dut"),
    )


def _temperature_offset(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    way = sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        reality.timing.append(lambda rows, a, d: way * amount * (rows.node_c["tof"] - 34.0))

    return Effect(
        effect="timing.temperature_offset",
        apply=apply,
        channels=(DISTANCE,),
        drivers=HOT,
        start=1e-5,
        limit=2e-3,
        unseen=("steps", "angles", "dut"),
        needs=HOT[:2],
        parameters=lambda a: (Parameter(pattern=".*", value=way * a, unit="m/K"),),
    )


def _clock_scale(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    way = sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        reality.timing.append(lambda rows, a, d: way * amount * d)

    return Effect(
        effect="timing.clock_scale",
        apply=apply,
        channels=(DISTANCE,),
        start=5e-4,
        limit=0.05,
        drivers=("true_range_m", "sim_distance_m", "surface"),
        unseen=("steps", "angles", "dut"),
        parameters=lambda a: (Parameter(pattern="scale|stretch|clock|ppm|eps", value=way * a, unit=""),),
    )


def _row_skew(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    along, way = str(rng.choice(["v", "u"])), sign(rng)
    bend = rng.uniform(0.0, 0.25)  # an RC line delays with the square of the way

    def apply(reality: Reality, amount: float) -> None:
        def skew(rows: Rows, a: np.ndarray, d: np.ndarray) -> np.ndarray:
            x = (rows.v - 15.5) / 15.5 if along == "v" else (rows.u - 63.5) / 63.5
            return way * amount * (x + bend * (x * x - 1 / 3))

        reality.timing.append(skew)

    drivers = ("pixel_v", "elevation_deg") if along == "v" else ("pixel_u", "azimuth_deg")
    return Effect(
        effect="timing.row_skew",
        apply=apply,
        channels=(DISTANCE,),
        drivers=drivers,
        start=5e-4,
        limit=0.03,
        needs=FIELD,
        unseen=("steps", "angles"),
    )


def _thermal_lag(rng: np.random.Generator, rows: Rows, design: Design) -> Effect:
    way = sign(rng)

    def apply(reality: Reality, amount: float) -> None:
        reality.timing.append(lambda rows, a, d: way * amount * (rows.node_c["slow"] - rows.node_c["housing"]))

    return Effect(
        effect="timing.thermal_lag",
        apply=apply,
        channels=(DISTANCE,),
        drivers=HISTORY,
        start=1e-4,
        limit=5e-3,
        unseen=("angles", "steps"),
        needs=("ramp", "time_s", "step", *HOT[:2]),
        parameters=lambda a: (Parameter(pattern="tau|lag", value=design.network.slow_die_lag_s, unit="s"),),
    )


RECIPES = (
    Recipe("timing.range_walk", sparse, _range_walk),
    Recipe("timing.temperature_offset", sparse, _temperature_offset),
    Recipe("timing.clock_scale", sparse, _clock_scale),
    Recipe("timing.row_skew", lambda r: sparse(r, pixels=40, angles=7), _row_skew),
    Recipe(
        "timing.thermal_lag",
        lambda r: sparse(
            r, steps=30, angles=7, pixels=16, duts=1, network=Network(slow_die_lag_s=wide(r, 240, 1200))
        ),
        _thermal_lag,
    ),
)
