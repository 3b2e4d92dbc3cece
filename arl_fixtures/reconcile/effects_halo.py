"""Light that spreads about its place by many pixels: an image through wide Gaussians, between which a width lies."""

from __future__ import annotations

from functools import partial

import numpy as np

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import FloatArray, per_table
from arl_fixtures.reconcile.effects_frame import between_widths, brighter
from arl_fixtures.reconcile.view import View

NEAREST_PX = 2.5
"""Standard deviation of the narrowest halo: what spreads by less is a blur's."""
FloatStray = tuple[FloatArray, dict[str, FloatArray]]
_RATIO = 1.5
"""Of neighbouring widths that are computed."""
_FULL = 0.6
"""Share of an image's raster that must be held for what lies between to be known."""


def widest_halo(view: View) -> float:
    """Width of a halo beyond which it is the image's mean, px; 0 where the table's images are not whole."""

    def find() -> float:
        if not (view.varies("pixel_u") and view.varies("pixel_v")):
            return 0.0
        raster = view.raster()
        if not raster.is_dense or raster.fullness < _FULL:
            return 0.0
        return 0.5 * float(min(raster.shape))

    return per_table(view, "widest halo", find)


def halo(view: View, state: State, channel: str, distances: tuple[str, ...], width_px: float) -> FloatStray:
    """What comes to each row from about its place, and from how far, through a kernel of `width_px`.

    Between the widths that are computed what comes is taken linear in the logarithm of the width.

    Args:
        view: rows; state: corrected so far: an image that got brighter as a whole spreads as much more.
        channel: signal.
        distances: their means by light are asked.
        width_px: standard deviation, px.
    """
    weights = between_widths(width_px, NEAREST_PX, _RATIO)
    names = (f"sim_{channel}",)
    light = _mix(view, weights, names, names)
    far = {}
    for distance in distances:
        seen = _mix(view, weights, names, (f"sim_{distance}",))
        moment = _mix(view, weights, (*names, f"sim_{distance}"), (f"sim_{distance}",))
        with np.errstate(invalid="ignore", divide="ignore"):
            far[distance] = moment / seen
    return light * brighter(view, state, channel), far


def _mix(view: View, weights: dict[int, float], names: tuple[str, ...], held: tuple[str, ...]) -> FloatArray:
    parts = [share * _of_width(view, names, held, k)[view.rows] for k, share in weights.items() if share > 0.0]
    return np.asarray(np.sum(parts, axis=0))


def _of_width(view: View, names: tuple[str, ...], held: tuple[str, ...], k: int) -> FloatArray:
    """Product of simulated columns of the whole table, where others have values, through the k-th Gaussian."""
    return per_table(view, ("halo", names, held, k), partial(_blurred, view, names, held, NEAREST_PX * _RATIO**k))


def _blurred(view: View, names: tuple[str, ...], held: tuple[str, ...], width_px: float) -> FloatArray:
    numbers = view.columns.numbers
    column = np.asarray(np.prod([numbers[name] for name in names], axis=0))
    known = np.isfinite(np.sum([numbers[name] for name in held], axis=0))
    return view.raster().blurred(np.where(known, column, np.nan), width_px)
