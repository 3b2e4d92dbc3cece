"""Which other effects a table cannot tell from the one at work: by the oracle's own measure, not by opinion.

For every other recipe of the sensor the shift that it would cause is drawn on the same rows, whitened and
freed of nuisances like the true one. What is left of the true shift after the best multiple of the other is what any
tool could see of the difference: λ·√(1 − cos²). Below `TOLD_APART` (2 Δ log L < 9) no honest answer prefers one.
"""

from collections.abc import Iterable

import numpy as np

from benchmarks.concealed.case import Concealment, calibrated, nuisance_of, shared_scale
from benchmarks.concealed.effect import Effect
from benchmarks.concealed.flash import Expected
from benchmarks.concealed.likelihood import projected
from benchmarks.concealed.recipe import Recipe
from benchmarks.concealed.sensor import Sensor

TOLD_APART = 3.0
DRAWS = 1
STRONG = 20.0  # beyond, the straight-line shapes compared here no longer stand for the effects


def _shape(sensor: Sensor, conceal: Concealment, truth: Expected, sim: Expected, seen: np.ndarray) -> np.ndarray:
    """Whitened shift of all channels, nuisances removed, one vector."""
    scale = shared_scale(sensor, sim, conceal)
    adjusted = calibrated(sensor, sim, truth, conceal.calibration, seen)
    parts = []
    for channel in sensor.channels:
        shift = np.where(truth.valid > 0, truth.mean[channel] - adjusted.mean[channel], 0.0)[seen]
        sigma = (sim.std[channel] / np.sqrt(sensor.n_frames))[seen]
        shared = scale[channel]
        nuisance = nuisance_of(sensor, channel, sim.mean[channel])
        parts.append(
            projected(
                shift,
                sigma,
                None if shared is None else shared[seen],
                sensor.group[seen],
                None if nuisance is None else nuisance[seen],
            )
        )
    return np.concatenate(parts)


def lookalikes(
    rng: np.random.Generator,
    sensor: Sensor,
    effect: Effect,
    amount: float,
    conceal: Concealment,
    seen: np.ndarray,
    recipes: Iterable[Recipe],
) -> list[str]:
    """Ids that leave less than `TOLD_APART` of the effect's shift unexplained, for effects that shift the mean."""
    if effect.kind != "mean":
        return []  # a change of scatter has no shape in the means
    sim = sensor.answer([])
    true = _shape(sensor, conceal, sensor.answer([(effect, amount)]), sim, seen)
    energy = float(true @ true)
    if energy > STRONG**2:
        return []
    alike = []
    for recipe in recipes:
        if recipe.effect in (effect.effect, *alike) or recipe.sensor != sensor.name:
            continue
        for _ in range(DRAWS):
            try:
                other = recipe.make(rng, sensor.rows, sensor.design)
            except (ValueError, IndexError):  # the design does not show this effect: no ice, no pixel in the patch
                break
            if other.kind != "mean":
                break
            shape = _shape(sensor, conceal, sensor.answer([(other, other.start)]), sim, seen)
            size = float(shape @ shape)
            if size > 1e-6 and energy - float(true @ shape) ** 2 / size < TOLD_APART**2:
                alike.append(recipe.effect)
                break
    return alike
