"""Echoes of several surfaces in one pulse's trace: which range a search for the peak finds."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray

_CLIMBS = 25


def climbed(light: FloatArray, ranges: FloatArray, start: FloatArray, width: float) -> FloatArray:
    """Peak of Gaussian echoes uphill from a start: the fixed point of their mean shift.

    Args:
        light, ranges: of each row's echoes, (n, k) each; start: ranges, (n,).
        width: standard deviation of an echo, in the ranges' unit.
    """
    place = start
    for _ in range(_CLIMBS):
        echo = light * np.exp(-0.5 * ((ranges - place[:, None]) / width) ** 2)
        place = np.sum(echo * ranges, axis=1) / np.maximum(np.sum(echo, axis=1), 1e-300)
    return place
