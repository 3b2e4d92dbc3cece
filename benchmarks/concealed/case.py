"""One case: a sensor, effects brought to a wanted visibility, concealment, noise, held-out blocks, and its truth."""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from benchmarks.concealed.effect import Effect
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.likelihood import (
    common_scatter_information,
    mean_information,
    mean_information_unknown_repeat,
    scatter_information,
)
from benchmarks.concealed.sensor import Sensor

BANDS = {"faint": (4.5, 8.0), "moderate": (8.0, 20.0), "strong": (20.0, 300.0)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Concealment:
    """What hides an effect, or looks like one.

    `repeat` is "declared" (in the table), "undeclared" (there, not in the table) or "none"; `calibration` what was
    refitted on the corrupted data: "none", "global" or "pixel"; `tails` the rows' noise: "normal", "heavy" (Student
    t, 4 degrees of freedom, unit variance), "outliers" (5 % of the rows scatter five times as much) or "wild" (two
    rows in a thousand are off by 6 to 40 standard errors).
    """

    repeat: str = "declared"
    calibration: str = "none"
    tails: str = "normal"
    holes: float = 0.0
    with_std: bool = False
    dropped: tuple[str, ...] = ()


@dataclass(slots=True, kw_only=True)
class Case:
    """Tables ready to write: `table`, `heldout` with measured columns, `oracle` with the truth on the same rows."""

    table: dict[str, np.ndarray]
    heldout: dict[str, np.ndarray]
    oracle: dict[str, np.ndarray]
    truth: dict[str, Any] = field(default_factory=dict)


def shared_scale(sensor: Sensor, sim: Expected, conceal: Concealment) -> dict[str, np.ndarray | None]:
    """Per channel the scatter that a group shares, row by row."""
    if conceal.repeat == "none":
        return dict.fromkeys(sensor.channels)
    scale: dict[str, np.ndarray | None] = {}
    for channel in sensor.channels:
        share, absolute = sensor.repeat[channel]
        scale[channel] = share * np.abs(sim.mean[channel]) + absolute if share or absolute else None
    return scale


def nuisance_of(sensor: Sensor, channel: str, sim: np.ndarray) -> np.ndarray | None:
    """What a user would calibrate away in a channel, as columns (N, 1): gain or offset; None where neither."""
    if channel in sensor.plain:
        return None
    return (sim if channel in sensor.gain_nuisance else np.ones(sim.size))[:, None]


def calibrated(sensor: Sensor, sim: Expected, truth: Expected, kind: str, fit: np.ndarray) -> Expected:
    """The simulation after its user fitted it to the corrupted data: overall, or also pixel by pixel."""
    if kind == "none":
        return sim
    mean = {}
    for channel, value in sim.mean.items():
        real = truth.mean[channel]
        ok = fit & np.isfinite(real)
        labels = np.zeros(value.size, dtype=int)
        if kind == "pixel" and sensor.pixel is not None:
            _, labels = np.unique(sensor.pixel, return_inverse=True)
        weight = 1.0 / sim.std[channel] ** 2 * ok
        clean = np.where(ok, real, 0.0)
        if channel in sensor.gain_nuisance:
            top = np.bincount(labels, weights=weight * value * clean)
            bottom = np.bincount(labels, weights=weight * value * value)
            factor = np.where(bottom > 0, top / np.maximum(bottom, 1e-300), 1.0)
            mean[channel] = value * factor[labels]
        else:
            top = np.bincount(labels, weights=weight * (clean - value))
            bottom = np.bincount(labels, weights=weight)
            mean[channel] = value + np.where(bottom > 0, top / np.maximum(bottom, 1e-300), 0.0)[labels]
    return Expected(mean, sim.std, sim.valid)


def _free_scale(sensor: Sensor, channel: str, sim: Expected, scale: np.ndarray | None) -> tuple[np.ndarray, float]:
    """Shape of a group's shared scatter that the table does not declare, and its true size in that shape."""
    if scale is not None:
        return scale, 1.0
    mean = sim.mean[channel]
    return (np.abs(mean) if channel in sensor.gain_nuisance else np.ones(mean.size)), 0.0


def visibility_by_channel(
    sensor: Sensor, effect: Effect, amount: float, conceal: Concealment, seen: np.ndarray
) -> dict[str, float]:
    """The oracle's lambda² of one effect at an amount, per channel, on the rows that the tool will see."""
    sim = sensor.answer([])
    scale = shared_scale(sensor, sim, conceal)
    if effect.kind == "dead":
        return {effect.channels[0]: 100.0 * amount}
    found: dict[str, float] = {}
    truth = sensor.answer([(effect, amount)])
    adjusted = calibrated(sensor, sim, truth, conceal.calibration, seen)
    for channel in sensor.channels:
        if effect.kind == "common":
            if channel not in effect.channels or effect.common_scale is None:
                continue
            sigma = sim.std[channel] / np.sqrt(sensor.n_frames)
            extra = effect.common_scale(sim.mean[channel], amount)
            group = sensor.sweep if effect.nature == "sweep" else sensor.group
            known = scale[channel] if effect.nature != "sweep" else None
            cut = None if known is None else known[seen]
            found[channel] = common_scatter_information(extra[seen], sigma[seen], cut, group[seen])
            continue
        std = truth.std[channel]
        frames = sensor.n_frames if conceal.with_std else np.ones(sensor.n_frames.size)
        if effect.kind == "scatter":
            found[channel] = scatter_information(std[seen], sim.std[channel][seen], frames[seen])
            continue
        shift = np.where(seen, truth.mean[channel] - adjusted.mean[channel], np.nan)
        sigma = np.where(seen, sim.std[channel] / np.sqrt(sensor.n_frames), np.nan)
        nuisance = nuisance_of(sensor, channel, sim.mean[channel])
        if conceal.repeat == "declared" and scale[channel] is not None:
            found[channel] = mean_information(shift, sigma, scale[channel], sensor.group, nuisance)
        else:
            shape, true = _free_scale(sensor, channel, sim, scale[channel])
            found[channel] = mean_information_unknown_repeat(shift, sigma, shape, true, sensor.group, nuisance)
        if conceal.with_std:
            found[channel] += scatter_information(std[seen], sim.std[channel][seen], frames[seen] - 1.0)
    return found


def visibility(sensor: Sensor, effect: Effect, amount: float, conceal: Concealment, seen: np.ndarray) -> float:
    """The oracle's lambda of one effect at an amount, all channels together."""
    return float(np.sqrt(sum(visibility_by_channel(sensor, effect, amount, conceal, seen).values())))


def reach(
    sensor: Sensor, effect: Effect, wanted: float, conceal: Concealment, seen: np.ndarray
) -> tuple[float, float]:
    """Amount at which the oracle sees `wanted`, and the lambda reached: secant on log-log in a shrinking bracket."""
    power = 1.0 if effect.kind in ("mean", "dead") else 2.0
    x, low, high = float(np.log(effect.start)), -np.inf, float(np.log(effect.limit))
    best, previous = (effect.start, 0.0), None
    for _ in range(14):
        got = float(np.log(max(visibility(sensor, effect, float(np.exp(x)), conceal, seen), 1e-6) / wanted))
        if previous is None or abs(got) < abs(np.log(max(best[1], 1e-6) / wanted)):
            best = (float(np.exp(x)), wanted * float(np.exp(got)))
        if abs(got) < 0.04:
            break
        low, high = (x, high) if got < 0 else (low, x)
        if previous is not None and abs(x - previous[0]) > 1e-6:
            power = float(np.clip((got - previous[1]) / (x - previous[0]), 0.4, 4.0))
        previous = (x, got)
        step = float(np.clip(got / power, -4.0, 4.0))
        following = x - step
        if not low < following < high:
            following = 0.5 * (low + high) if np.isfinite(low) and np.isfinite(high) else high if got < 0 else low
        if abs(following - x) < 1e-4:
            break
        x = following
    return best


def held_mask(rng: np.random.Generator, sensor: Sensor, effects: list[Effect]) -> tuple[str, np.ndarray]:
    """Rows of an unseen condition: whole steps, angles, a cycle or a DUT, as far as the effects allow."""
    kinds = [k for k in sensor.blocks if all(k in e.unseen for e in effects)]
    usable = [k for k in kinds if np.unique(sensor.blocks[k]).size > 2 or k == "dut"]
    if not usable:
        return "rows", rng.random(sensor.n_frames.size) < 0.1
    kind = str(rng.choice(usable))
    labels = np.unique(sensor.blocks[kind])
    if kind in ("cycle", "dut"):
        chosen = labels[-1:]
    else:
        count = max(1, round(labels.size * 0.2))
        inner = labels[1:-1] if labels.size > 3 else labels
        chosen = rng.choice(inner, size=min(count, inner.size), replace=False)
    return kind, np.isin(sensor.blocks[kind], chosen)


def band_of(value: float) -> str:
    """Name of the visibility band."""
    return "hidden" if value < 4.5 else "faint" if value < 8 else "moderate" if value < 20 else "strong"


def describe(sensor: Sensor, effect: Effect, amount: float, conceal: Concealment, seen: np.ndarray) -> dict[str, Any]:
    """The sealed truth about one effect."""
    parts = visibility_by_channel(sensor, effect, amount, conceal, seen)
    value = float(np.sqrt(sum(parts.values())))
    where = effect.where and {
        k: [sensor.labels.get(x, x) if isinstance(x, str) else x for x in v] for k, v in effect.where.items()
    }
    looks_like = list(effect.equivalents)
    looks_like += [other for channel, other in effect.unless_seen if parts.get(channel, 0.0) < BANDS["faint"][0] ** 2]
    return {
        "effect": effect.effect,
        "nature": effect.nature,
        "channels": list(effect.channels),
        "drivers": list(effect.drivers),
        "where": where,
        "amount": amount,
        "lambda": value,
        "band": band_of(value),
        "lambda_by_channel": {c: float(np.sqrt(v)) for c, v in parts.items()},
        "parameters": [asdict(p) for p in effect.parameters(amount)],
        "equivalents": looks_like,
        "kind": effect.kind,
    }
