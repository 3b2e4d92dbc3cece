"""What two simulations of the same scene differ by, beyond what a user calibrates.

Before a user looks for missing physics the simulation's light has got a gain and a pedestal, and its range an offset
and perhaps a scale, fitted to the recording. A simulation is still the nominal bench after that: the four are fitted
so that most rows agree (least absolute deviations, by iteratively reweighted least squares), and what is left counts.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray

_ROUNDS = 12
_SHARPEST = 1e-4
"""Deviation below which rows count alike: relative for light, metres for range."""
_FEWEST = 8
_MOST_PEDESTAL = 0.5
"""Of the median light."""
_MOST_OFFSET_M, _MOST_STRETCH = 0.05, 0.02
_LEAST_SPAN_M = 0.05
"""Of the ranges, for a scale to be told from an offset."""


def uneven(light: FloatArray, expected: FloatArray) -> FloatArray:
    """Logarithm of light over what is expected after gain and pedestal; NaN where not known.

    Args:
        light: simulated, counts, (n,); expected: of the nominal scene, in any unit, (n,).
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        good = np.isfinite(light) & np.isfinite(expected) & (expected > 0.0) & (light > 0.0)
    if good.sum() < _FEWEST:
        return np.full(light.size, np.nan)
    scale = float(np.median(light[good]) / np.median(expected[good]))
    known, likely = light[good], expected[good] * scale
    gain, pedestal = _line(np.ones(known.size), 1.0 / likely, known / likely)
    if abs(pedestal) > _MOST_PEDESTAL * float(np.median(known)) or gain <= 0.0:
        gain, pedestal = float(np.median(known / likely)), 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.log((light - pedestal) / (gain * scale * expected))
    return np.asarray(np.where(good, found, np.nan))


def apart(range_m: FloatArray, expected_m: FloatArray) -> FloatArray:
    """Range less what is expected after offset and scale, metres; NaN where not known.

    An offset beyond 50 mm or a scale beyond 2 % is no calibration and is not taken off.
    """
    good = np.isfinite(range_m) & np.isfinite(expected_m)
    if good.sum() < _FEWEST:
        return np.full(range_m.size, np.nan)
    difference = range_m - expected_m
    middle = float(np.median(expected_m[good]))
    off, stretch = float(np.median(difference[good])), 0.0
    if np.ptp(np.quantile(expected_m[good], (0.1, 0.9))) > _LEAST_SPAN_M:
        line = _line(np.ones(int(good.sum())), expected_m[good] - middle, difference[good])
        if abs(line[1]) < _MOST_STRETCH:
            off, stretch = line
    if abs(off) > _MOST_OFFSET_M:
        return np.asarray(difference)
    return np.asarray(difference - off - stretch * (expected_m - middle))


def _line(first: FloatArray, second: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Factors of two columns with the least absolute deviations from values."""
    unit = float(np.max(np.abs(second))) or 1.0
    design = np.stack([first, second / unit], axis=1)
    weight: FloatArray = np.ones(values.size)
    found: FloatArray = np.zeros(2)
    for _ in range(_ROUNDS):
        normal = design.T @ (design * weight[:, None]) + 1e-12 * np.eye(2)
        found = np.asarray(np.linalg.solve(normal, design.T @ (weight * values)), dtype=np.float64)
        weight = np.asarray(1.0 / np.maximum(np.abs(values - design @ found), _SHARPEST))
    return float(found[0]), float(found[1]) / unit
