"""What of a simulated signal is the scene's, beside the smooth profile with which beam and receiver light it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MADE_OF = 0.02
"""Share of a regressor, as a standard deviation, that others leave of it."""
_ROUNDS = 12
_OF_A_LINE = 8
"""Highest power of a profile along one angle alone, where a plainer one does not fit: few numbers, all needed where a
beam falls steeply."""


def sceneries(view: View, rows: IntArray, powers: FloatArray) -> list[tuple[FloatArray, list[FloatArray]]]:
    """Ways to account for the scene in ln(signal): what is known, and regressors with free coefficients.

    What goes with the field of view, as the range to a wall does, a free exponent would take from the profile, which
    is made of `powers`, shape (n, k): it is known.
    """
    table = view.columns
    laws: list[FloatArray] = []
    known = np.zeros(rows.size)
    for name, exponent in (("reflectance", 1.0), ("true_range_m", -2.0), ("incidence_deg", 1.0)):
        if name not in table.numbers:
            continue
        values = table.numbers[name][rows]
        values = np.cos(np.radians(values)) if name == "incidence_deg" else values
        law = np.nan_to_num(np.log(np.maximum(values, 1e-3)))
        laws.append(law)
        known = known + exponent * law
    free = list(laws)
    if "surface" in table.categories:
        codes, labels = table.categories["surface"]
        free += [(codes[rows] == index).astype(float) for index in range(min(len(labels), 40))]
    ways = [(np.zeros(rows.size), free)]
    return [(known, []), *ways] if len(laws) == 3 or any(_is_made_of(law, powers) for law in laws) else ways


def _is_made_of(law: FloatArray, powers: FloatArray) -> bool:
    """Whether a regressor that is no constant is a sum of others."""
    around = law - law.mean()
    rest = around - powers @ np.linalg.lstsq(powers, around, rcond=1e-9)[0]
    return float(rest @ rest) < MADE_OF**2 * float(around @ around)


def powers_of_a_line(x: FloatArray, y: FloatArray) -> list[set[tuple[int, int]]]:
    """Even powers up to higher ones where one of two scaled angles alone varies."""
    ways: list[set[tuple[int, int]]] = []
    for own, other, place in ((x, y, 0), (y, x, 1)):
        sides = np.unique(np.abs(own)).size
        if np.ptp(own) > 0.0 and np.ptp(other) == 0.0:
            most = min(_OF_A_LINE, 2 * (sides - 1))
            ways += [
                {(power, 0) if place == 0 else (0, power) for power in range(2, top + 1, 2)}
                for top in range(6, most + 1, 2)
            ]
    return ways


def robust(matrix: FloatArray, target: FloatArray) -> tuple[FloatArray, float]:
    """Least squares that pixels of patterned boards do not bend, and the median size of what is left."""
    weight = np.ones(target.size)
    solution, rest = np.zeros(matrix.shape[1]), 0.0
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        solution = np.asarray(np.linalg.lstsq(matrix * root[:, None], target * root, rcond=1e-9)[0], dtype=np.float64)
        left = target - matrix @ solution
        rest = float(np.median(np.abs(left)))
        weight = 1.0 / (1.0 + (left / max(3.0 * rest, 1e-6)) ** 2) ** 2
    return solution, rest
