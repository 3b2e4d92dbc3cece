"""Whether a detector counts photons one by one: the variance of a frame then grows by one for every count more."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_common import per_table
from arl_fixtures.reconcile.view import View

_ONE_BY_ONE = (0.95, 1.08)
"""Counts of variance for a count of signal; a little more where a background's own noise is in it."""
_OF_GAIN, _FEWEST, _LEAST_RANGE = 0.05, 30, 1.5
"""Share of the variance at the usual signal that may go with its square; rows, and range of the signal, that tell."""


def counts_photons(view: View, channel: str) -> bool:
    """Whether a signal's simulated variance is its mean, beside a constant: nothing before counting has a gain."""
    return per_table(view, ("counts photons", channel), lambda: _counts(view, channel))


def _counts(view: View, channel: str) -> bool:
    numbers = view.columns.numbers
    light, scatter = (numbers.get(name) for name in (f"sim_{channel}", f"sim_{channel}_std"))
    if light is None or scatter is None:
        return False
    good = np.isfinite(light) & np.isfinite(scatter) & (light > 0.0) & (scatter > 0.0)
    light, variance = light[good], scatter[good] ** 2
    if light.size < _FEWEST or float(np.quantile(light, 0.95)) < _LEAST_RANGE * float(np.quantile(light, 0.05)):
        return False
    usual = float(np.median(light))
    powers = np.stack([np.ones_like(light), light / usual, (light / usual) ** 2], axis=1)
    _, of_light, of_square = np.linalg.lstsq(powers / variance[:, None], np.ones_like(light), rcond=None)[0]
    at_usual = float(np.median(variance))
    return bool(
        _ONE_BY_ONE[0] < of_light / usual < _ONE_BY_ONE[1] and abs(of_square) < _OF_GAIN * at_usual
    )  # fmt: skip
