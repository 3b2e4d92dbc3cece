"""From expectations to tables: noise, shared scatter, sample scatter, holes and columns of an observation table."""

import numpy as np

from benchmarks.concealed.case import (
    Case,
    Concealment,
    calibrated,
    describe,
    held_mask,
    reach,
    shared_scale,
)
from benchmarks.concealed.effect import Effect
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.lookalikes import lookalikes
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor

WILD_SHARE = 0.002


def _deviates(rng: np.random.Generator, size: int, tails: str) -> np.ndarray:
    if tails == "heavy":
        return rng.standard_t(4, size=size) / np.sqrt(2.0)
    z = rng.normal(size=size)
    if tails == "wild":
        far = rng.choice([-1.0, 1.0], size=size) * rng.uniform(6.0, 40.0, size=size)
        return np.where(rng.random(size) < WILD_SHARE, far, z)
    return np.where(rng.random(size) < 0.05, 5.0 * z, z) if tails == "outliers" else z


def _group_draw(rng: np.random.Generator, labels: np.ndarray) -> np.ndarray:
    _, where = np.unique(labels, return_inverse=True)
    return rng.normal(size=int(where.max()) + 1)[where]


def _per_sweep(values: np.ndarray, sweep: np.ndarray) -> np.ndarray:
    """One value per sweep, given to all its rows."""
    _, first, where = np.unique(sweep, return_index=True, return_inverse=True)
    return values[first][where]


def _frame_common(channel: str, mean: np.ndarray, effects: list[tuple[Effect, float]]) -> np.ndarray:
    """One-frame scatter that all rows of a sweep share, because they are read from the same frames."""
    shared = np.zeros(mean.size)
    for effect, amount in effects:
        if effect.kind == "scatter" and effect.common_scale is not None and channel in effect.channels:
            shared = np.hypot(shared, effect.common_scale(mean, amount))
    return shared


def _measure(
    rng: np.random.Generator,
    sensor: Sensor,
    sim: Expected,
    truth: Expected,
    effects: list[tuple[Effect, float]],
    conceal: Concealment,
    held: np.ndarray,
) -> dict[str, np.ndarray]:
    """Measured channels with every kind of noise."""
    size = sensor.n_frames.size
    scale = shared_scale(sensor, sim, conceal)
    out = {}
    for channel in sensor.channels:
        mean, std = truth.mean[channel], truth.std[channel]
        jitter = _frame_common(channel, mean, effects)
        own = np.sqrt(np.maximum(std**2 - jitter**2, 0.0))
        noise = np.where(held, rng.normal(size=size), _deviates(rng, size, conceal.tails))
        value = mean + (noise * own + jitter * _group_draw(rng, sensor.sweep)) / np.sqrt(sensor.n_frames)
        if scale[channel] is not None:
            value += scale[channel] * _group_draw(rng, sensor.group)
        for effect, amount in effects:
            if effect.kind == "common" and channel in effect.channels and effect.common_scale is not None:
                labels = sensor.sweep if effect.nature == "sweep" else sensor.group
                value += effect.common_scale(mean, amount) * _group_draw(rng, labels)
        blind = truth.valid <= 0
        out[channel] = np.where(blind, np.nan, value)
        if conceal.with_std:
            free = np.maximum(sensor.n_frames - 1, 1)
            together = _per_sweep(rng.chisquare(free) / free, sensor.sweep)
            sample = np.sqrt(own**2 * rng.chisquare(free) / free + jitter**2 * together)
            out[f"{channel}_std"] = np.where(blind | (sensor.n_frames < 2), np.nan, sample)
    return out


def _columns(sensor: Sensor, sim: Expected, conceal: Concealment) -> dict[str, np.ndarray]:
    columns = {name: value for name, value in sensor.columns.items() if name not in conceal.dropped}
    scale = shared_scale(sensor, sim, conceal)
    for channel in sensor.channels:
        columns[f"sim_{channel}"] = sim.mean[channel]
        columns[f"sim_{channel}_std"] = sim.std[channel]
        if conceal.repeat == "declared" and scale[channel] is not None:
            columns[f"sim_{channel}_repeat_std"] = np.asarray(scale[channel])
    columns["n_frames"] = sensor.n_frames
    return columns


def build(
    rng: np.random.Generator,
    sensor: Sensor,
    effects: list[Effect],
    wanted: list[float],
    conceal: Concealment,
    rivals: tuple[Recipe, ...] = (),
) -> Case:
    """A case with `effects` at the visibilities `wanted` (none for a null case).

    `rivals` are the recipes among which the oracle looks for what this table cannot tell from each effect.
    """
    kind, held = held_mask(rng, sensor, effects)
    seen = ~held & (rng.random(held.size) >= conceal.holes)
    drawn, told = [], []
    for effect, goal in zip(effects, wanted, strict=True):
        amount, _ = reach(sensor, effect, goal, conceal, seen)
        drawn.append((effect, amount))
        told.append(describe(sensor, effect, amount, conceal, seen))
        alike = lookalikes(np.random.default_rng(17), sensor, effect, amount, conceal, seen, rivals)
        told[-1]["equivalents"] = sorted({*told[-1]["equivalents"], *alike})
    nominal = sensor.answer([])
    truth = sensor.answer(drawn)
    sim = calibrated(sensor, nominal, truth, conceal.calibration, seen)
    measured = _measure(rng, sensor, sim, truth, drawn, conceal, held)
    columns = _columns(sensor, sim, conceal)
    if any(e.kind == "dead" for e in effects) or (sensor.writes_valid and rng.random() < 0.2):
        # a share of frames without a return: the simulation knows which returns are too weak
        columns |= {"sim_valid_fraction": sim.valid, "sim_valid_fraction_std": np.full(held.size, 0.02)}
        measured["valid_fraction"] = truth.valid
    order = rng.permutation(np.flatnonzero(seen)) if rng.random() < 0.5 else np.flatnonzero(seen)
    there = np.flatnonzero(held)
    whole = columns | measured
    oracle = {name: truth.mean[name][there] for name in sensor.channels}
    if conceal.with_std:
        oracle |= {f"{name}_std": truth.std[name][there] for name in sensor.channels}
    case = Case(
        table={n: v[order] for n, v in whole.items()},
        heldout={n: v[there] for n, v in whole.items()},
        oracle=oracle,
    )
    case.truth = {
        "sensor": sensor.name,
        "effects": told,
        "heldout": kind,
        "rows": int(order.size),
        "concealment": {
            "repeat": conceal.repeat,
            "calibration": conceal.calibration,
            "tails": conceal.tails,
            "holes": conceal.holes,
            "with_std": conceal.with_std,
        },
    }
    return case
