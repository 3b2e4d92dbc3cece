"""The image turned round: what the table's own pixels see at the place that a mirror shows each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import FloatArray, per_table, per_view
from arl_fixtures.reconcile.view import IntArray, View

_MOST_KEPT = 8
"""Blurred columns of the whole table that are kept."""
_MIRRORS_KEPT = 4
"""Mirrors of a view whose places are kept: a fit's own, and those beside it that it is differentiated by."""
_SMALLEST_SHARE = 1e-9


class Mirror(NamedTuple):
    """About which pixel an image is turned round, and along which of its axes."""

    u0: float
    v0: float
    flip_u: bool = True
    flip_v: bool = True

    def of(self, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns and rows of the mirrored pixels."""
        return 2.0 * self.u0 - u if self.flip_u else u, 2.0 * self.v0 - v if self.flip_v else v


def mirrored(view: View, state: State, channel: str, mirror: Mirror) -> FloatArray:
    """Value at the mirrored pixel, linear between pixel centres; NaN outside the table's image.

    For a pixel that the table does not hold stands the nearest one that is close by.
    """
    return _between(view, mirror, partial(view.take, state, channel))


def mirrored_blur(view: View, state: State, channel: str, mirror: Mirror, width_px: float) -> FloatArray:
    """The same of the simulation as it was, through a Gaussian of `width_px`, scaled by what was done to the row.

    Images too large and sparse for a raster stay sharp.
    """
    spread = _spread(view, (f"sim_{channel}",), width_px)
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = state[channel] / view.sim[channel]
    return _between(view, mirror, partial(_at, spread)) * np.where(np.isfinite(scale), scale, 1.0)


def mirrored_range(view: View, distance: str, channel: str, mirror: Mirror, width_px: float) -> FloatArray:
    """Mean by light of a simulated distance about the mirrored pixel, through a Gaussian of `width_px`."""
    light, far = f"sim_{channel}", f"sim_{distance}"
    seen, moment = (
        _between(view, mirror, partial(_at, _spread(view, names, width_px, ranged=far)))
        for names in ((light,), (light, far))
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(moment / seen)


def _spread(view: View, names: tuple[str, ...], width_px: float, ranged: str = "") -> FloatArray:
    """Product of simulated columns of the whole table, through the Gaussian; a fit asks for the same ones again.

    With `ranged` of pixels only that have a value in that column.
    """
    kept = per_table(view, "blurred images", dict[tuple[tuple[str, ...], float, str], FloatArray])
    key = names, width_px, ranged
    if key not in kept:
        if len(kept) >= _MOST_KEPT:
            kept.clear()
        column = np.asarray(np.prod([view.columns.numbers[name] for name in names], axis=0))
        if ranged:
            column = np.where(np.isfinite(view.columns.numbers[ranged]), column, np.nan)
        kept[key] = view.raster().blurred(column, width_px) if view.raster().is_dense else column
    return kept[key]


def _at(column: FloatArray, place: IntArray) -> FloatArray:
    return np.where(place >= 0, column[place], np.nan)


def _between(view: View, mirror: Mirror, take: Callable[[IntArray], FloatArray]) -> FloatArray:
    """What `take` finds at the four pixels about each mirrored place, weighted by how near they are."""
    total, weight = np.zeros(view.n), np.zeros(view.n)
    for place, share in _corners(view, mirror):
        value = take(place)
        good = np.isfinite(value) & (share > _SMALLEST_SHARE)
        total[good] += (share * np.nan_to_num(value))[good]
        weight[good] += share[good]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0.5, total / weight, np.nan)


def _corners(view: View, mirror: Mirror) -> tuple[tuple[IntArray, FloatArray], ...]:
    """Rows of the pixels about each mirrored place, and their weights; a fit turns light and ranges round alike."""
    kept = per_view(view, "mirrored places", dict[Mirror, tuple[tuple[IntArray, FloatArray], ...]])
    if mirror not in kept:
        if len(kept) >= _MIRRORS_KEPT:
            kept.clear()
        kept[mirror] = tuple(_find_corners(view, mirror))
    return kept[mirror]


def _find_corners(view: View, mirror: Mirror) -> Iterator[tuple[IntArray, FloatArray]]:
    raster, image = view.raster(), view.frame()
    target_u, target_v = mirror.of(raster.u[view.rows], raster.v[view.rows])
    low_u, low_v = np.floor(target_u), np.floor(target_v)
    part_u, part_v = target_u - low_u, target_v - low_v
    for step_u, share_u in ((0, 1.0 - part_u), (1, part_u)):
        for step_v, share_v in ((0, 1.0 - part_v), (1, part_v)):
            share = share_u * share_v
            if np.any(share > _SMALLEST_SHARE):
                yield raster.rows_at(image, low_u + step_u, low_v + step_v, near=True), share
