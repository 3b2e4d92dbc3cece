"""A laser diode's light against current, by the stationary rate equations of carriers and photons.

With carriers n and current j in units of the threshold: light s = j − n by energy balance, s (1 − n) = β n by gain
balance, hence n² − n (1 + j + β) + j = 0: one quadratic per current, with a soft knee where spontaneous light enters.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.effect import Effect, sign, wide
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.hooks import Hooks, answering
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor

LIGHT = "photodiode_a"
HEAT = ("heatsink_temperature_c", "laser_temperature_c", "step")


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveRows:
    """Arrays of equal length: drive current, heat sink, cycle and step."""

    current_a: np.ndarray
    sink_c: np.ndarray
    cycle: np.ndarray
    step: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveDesign:
    """Currents, heat sink temperatures and cycles, all combined."""

    current_a: np.ndarray
    sink_c: tuple[float, ...]
    cycles: tuple[int, ...] = (1,)
    threshold_a: float = 0.35


def curves(rng: np.random.Generator, *, old: bool = False) -> CurveDesign:
    """Sweeps of the current at several temperatures, or at several ages."""
    return CurveDesign(
        current_a=np.linspace(0.0, 2.0, int(rng.choice([120, 200]))),
        sink_c=tuple(np.linspace(15.0, 65.0, 3 if old else 8)),
        cycles=(1, 200, 500, 900, 1500) if old else (1,),
        threshold_a=float(rng.uniform(0.2, 0.5)),
    )


def photons(current: np.ndarray, threshold: np.ndarray, spontaneous: float = 2e-3) -> np.ndarray:
    """Photon number of the stationary laser, same unit as the current."""
    j = current / threshold
    b = 1.0 + j + spontaneous
    n = 0.5 * (b - np.sqrt(np.maximum(b * b - 4.0 * j, 0.0)))
    return threshold * np.maximum(j - n, 0.0)


def laser(rng: np.random.Generator, design: CurveDesign) -> Sensor:
    """The curves as a table."""
    c, t, j = (
        x.ravel()
        for x in np.meshgrid(np.array(design.cycles), np.array(design.sink_c), design.current_a, indexing="ij")
    )
    _, step = np.unique(c * 1000.0 + t, return_inverse=True)
    rows = CurveRows(current_a=j, sink_c=t, cycle=c, step=step)

    def model(rows: CurveRows, hooks: Hooks) -> Expected:
        threshold = hooks.run("threshold", rows, np.full(j.size, design.threshold_a))
        slope = hooks.run("slope", rows, np.full(j.size, 8e-4))
        light = hooks.run("receiver", rows, slope * photons(rows.current_a, threshold))
        return Expected({LIGHT: light}, {LIGHT: np.hypot(1.5e-6, 2e-3 * np.abs(light))}, np.ones(j.size))

    columns = {
        "drive_current_a": j,
        "heatsink_temperature_c": np.round(t + rng.normal(0, 0.05, j.size), 2),
        "cycle": c,
        "step": step,
        "ambient_temperature_c": np.round(23 + rng.normal(0, 0.2, j.size), 1),
    }
    if len(design.cycles) == 1:
        del columns["cycle"]
    blocks = {"steps": step, "currents": np.digitize(j, np.linspace(0, 2, 21))}
    if len(design.cycles) > 1:
        blocks["cycle"] = c
    return Sensor(
        name="laser",
        columns=columns,
        answer=answering(model, rows),
        channels=(LIGHT,),
        n_frames=np.full(j.size, int(rng.choice([1, 4]))),
        group=step,
        sweep=np.arange(j.size),
        repeat={LIGHT: (float(rng.uniform(0.0005, 0.002)), 0.0)},
        gain_nuisance=(LIGHT,),
        blocks=blocks,
        rows=rows,
        design=design,
        decoys=("ambient_temperature_c",),
    )


def _rolloff(rng: np.random.Generator, rows: CurveRows, design: CurveDesign) -> Effect:
    fall, self_heat = rng.uniform(0.0, 0.6), rng.uniform(0.0, 6.0)

    def apply(hooks: Hooks, amount: float) -> None:
        def heat(rows: CurveRows) -> np.ndarray:
            return rows.sink_c - 25.0 + self_heat * rows.current_a

        hooks.add("threshold", lambda rows, j: j * np.exp(amount * heat(rows)))
        hooks.add("slope", lambda rows, s: s * np.exp(-fall * amount * heat(rows)))

    return Effect(
        effect="laser.thermal_rolloff",
        apply=apply,
        channels=(LIGHT,),
        drivers=(*HEAT, "drive_current_a"),
        start=1e-3,
        limit=0.03,
        unseen=("steps", "currents"),
        calibrations=("none",),
    )


def _decay(rng: np.random.Generator, rows: CurveRows, design: CurveDesign) -> Effect:
    power = wide(rng, 0.5, 1.2)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("slope", lambda rows, s: s * np.exp(-amount * (rows.cycle / max(design.cycles)) ** power))

    return Effect(
        effect="laser.power_decay",
        apply=apply,
        channels=(LIGHT,),
        drivers=("cycle", "step"),
        start=5e-3,
        limit=1.0,
        needs=("cycle",),
        unseen=("currents", "steps"),
        calibrations=("none",),
    )


def _leakage(rng: np.random.Generator, rows: CurveRows, design: CurveDesign) -> Effect:
    doubling_k = wide(rng, 7.0, 12.0)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("receiver", lambda rows, i: i + amount * 2.0 ** ((rows.sink_c - 65.0) / doubling_k))

    return Effect(
        effect="detector.dark_offset",
        apply=apply,
        channels=(LIGHT,),
        drivers=HEAT,
        start=1e-6,
        limit=1e-4,
        unseen=("currents",),
        calibrations=("none",),
    )


def _flattening(rng: np.random.Generator, rows: CurveRows, design: CurveDesign) -> Effect:
    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add("receiver", lambda rows, i: 1.4e-3 / amount * np.tanh(i * amount / 1.4e-3))

    return Effect(
        effect="detector.compression",
        apply=apply,
        channels=(LIGHT,),
        start=0.1,
        limit=2.0,
        drivers=("drive_current_a", f"sim_{LIGHT}", f"sim_{LIGHT}_std"),
        unseen=("steps", "currents"),
        calibrations=("none",),
    )


def _kink(rng: np.random.Generator, rows: CurveRows, design: CurveDesign) -> Effect:
    centre, width, way = rng.uniform(0.9, 1.6), rng.uniform(0.05, 0.15), sign(rng)

    def apply(hooks: Hooks, amount: float) -> None:
        hooks.add(
            "receiver", lambda rows, i: i * (1 + way * amount * np.exp(-(((rows.current_a - centre) / width) ** 2)))
        )

    return Effect(
        effect="unknown",
        nature="lateral mode kink",
        apply=apply,
        channels=(LIGHT,),
        start=0.01,
        limit=0.3,
        drivers=("drive_current_a", f"sim_{LIGHT}", f"sim_{LIGHT}_std"),
        unseen=("steps",),
        calibrations=("none",),
    )


RECIPES = (
    Recipe("laser.thermal_rolloff", curves, _rolloff, "laser"),
    Recipe("laser.power_decay", lambda r: curves(r, old=True), _decay, "laser"),
    Recipe("detector.dark_offset", curves, _leakage, "laser"),
    Recipe("detector.compression", curves, _flattening, "laser"),
)
UNKNOWN = (Recipe("unknown", curves, _kink, "laser"),)
