"""Stray light of a pulsed sensor: only what comes back within its own pulse is measured with it.

A pixel's peak, and the window about it, see as much of a pulse from `delta` nearer or farther as the pulses overlap:
`exp(−delta² / 2·overlap²)` for Gaussian pulses, where `overlap` is a pulse's standard deviation, as a range, at the
peak, and √2 of it for what a matched filter finds. A camera that correlates a modulation sees all light: there the
overlap is as wide as the scene.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from arl_fixtures.reconcile.effect import Parameter, State
from arl_fixtures.reconcile.effects_common import FloatArray, per_table, shape
from arl_fixtures.reconcile.effects_frame import between_widths, brighter
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_BINS = 96
_NARROWEST = 1.0 / 40.0
"""Of the ranges' span: the pulse shorter than this sees no other surface."""
_RATIO = 1.5
"""Of neighbouring overlaps that are computed."""
_MOST = 2e7
"""Images times bins that are held at most."""


def overlap_shape(view: View, distance: str) -> Parameter:
    """How far two surfaces may lie apart for their pulses to add up: the unit of `distance`."""
    low, high = view.span(f"sim_{distance}")
    across = high - low
    return shape("overlap", unit_of(distance), _NARROWEST * across, across, across / 16.0)


def within(away: FloatArray, overlap: float) -> FloatArray:
    """Share of a pulse that a pixel's own one sees from `away` nearer or farther, both in the unit of `overlap`."""
    return np.asarray(np.exp(-0.5 * (np.nan_to_num(away, nan=np.inf) / overlap) ** 2))


def can_overlap(view: View, distance: str) -> bool:
    """Whether the images show more than one range, and are few enough to be held range by range."""
    images = int(view.columns.group(*view.columns.image_columns).max()) + 1
    low, high = view.span(f"sim_{distance}")
    return high > low and images * _BINS <= _MOST


def overlapping(
    view: View, state: State, channel: str, distance: str, overlap: float
) -> tuple[FloatArray, FloatArray]:
    """Mean light of each row's image that comes within the row's own pulse, and its mean range, both shape (n,).

    Args:
        view: rows under work.
        state: corrected so far: an image that got brighter as a whole spreads as much more.
        channel: the signal.
        distance: the channel of the ranges.
        overlap: Gaussian standard deviation of the ranges that are seen along, in the unit of `distance`.
    """
    low, high = view.span(f"sim_{distance}")
    weights = between_widths(overlap, _NARROWEST * (high - low), _RATIO)
    seen = [_of_width(view, channel, distance, k) for k in weights]
    light, moment = (
        np.sum([share * both[kind][view.rows] for share, both in zip(weights.values(), seen, strict=True)], axis=0)
        for kind in (0, 1)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        return light * brighter(view, state, channel), moment / light


def _of_width(view: View, channel: str, distance: str, k: int) -> tuple[FloatArray, FloatArray]:
    """Light within the k-th overlap, and light times range, of all rows of the table."""
    return per_table(view, ("overlap", channel, distance, k), partial(_seen, view, channel, distance, k))


def _seen(view: View, channel: str, distance: str, k: int) -> tuple[FloatArray, FloatArray]:
    columns = view.columns
    code = columns.group(*columns.image_columns)
    light, far = columns.numbers[f"sim_{channel}"], columns.numbers[f"sim_{distance}"]
    low, high = view.span(f"sim_{distance}")
    good = np.isfinite(light) & np.isfinite(far) & (light > 0.0)
    width = (high - low) / (_BINS - 1)
    slot = np.where(good, np.rint((np.nan_to_num(far) - low) / width), 0.0).clip(0, _BINS - 1).astype(np.int64)
    images = int(code.max()) + 1
    cell, cells = code * _BINS + slot, images * _BINS
    held = np.bincount(code, good.astype(float), minlength=images).clip(1.0)[:, None]
    at = low + width * np.arange(_BINS)
    overlap = _NARROWEST * (high - low) * _RATIO**k
    kernel = within(at[:, None] - at[None, :], overlap)
    known = np.where(good, light, 0.0)
    light_at, moment_at = (
        (np.bincount(cell, weight, minlength=cells).reshape(images, _BINS) / held) @ kernel
        for weight in (known, known * np.nan_to_num(far))
    )
    own = ((np.nan_to_num(far, nan=low) - low) / width).clip(0.0, _BINS - 1.0)
    below = np.minimum(own.astype(np.int64), _BINS - 2)
    above = own - below

    def of_rows(part: FloatArray) -> FloatArray:
        between = (1.0 - above) * part[code, below] + above * part[code, below + 1]
        return np.where(np.isfinite(far), between, np.nan)

    return of_rows(light_at), of_rows(moment_at)
