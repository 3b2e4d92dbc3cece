"""Pixels that fell silent at a step, where only their light is measured: it is gone and does not come back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.terms import RECORD_TIME, moment_of

LEFT = 0.15
"""Share of its light that a row may keep and still be dark: a stray share, an offset."""
LIT = 6.0
"""Standard errors of light that a row must be due, to be called dark without it."""
FEWEST_ROWS, MOST_ROWS = 4, 0.2
"""Dark rows of a channel below which there is nothing to tell of, and their share above which it is no few pixels."""


def some_dark(data: ChannelData, due: NDArray[np.float64]) -> bool:
    """Whether few of a channel's rows have no light where light is due, (rows,): else no level needs a look."""
    dark = (due > LIT * data.stated * data.spread) & (data.measured < LEFT * due)
    return bool(FEWEST_ROWS <= dark.sum() <= MOST_ROWS * len(dark))


@dataclass(frozen=True, slots=True)
class Deaths:
    """Levels at which a pixel is gone for good.

    Attributes:
        gone: (levels,).
        pixels: how many pixels that are.
        on_the_way: whether one of them still had light in the cycle in which it died: else steps tell nothing of it.
    """

    gone: NDArray[np.bool_]
    pixels: int
    on_the_way: bool


def deaths(
    keys: Sequence[tuple[str, ...]], per: Sequence[str], gone: NDArray[np.bool_], would_tell: NDArray[np.bool_]
) -> Deaths:
    """Levels of `gone` whose pixel is gone in every later level that would tell of it.

    Args:
        keys: of the levels, values in the order of `per`.
        per: columns of the levels, those of `RECORD_TIME` among them.
        gone: (levels,) whether the light is gone there.
        would_tell: (levels,) whether the light that is due there is enough to see that it is gone.
    """
    times = [k for k, name in enumerate(per) if name in RECORD_TIME]
    of_pixel: dict[tuple[str, ...], list[tuple[tuple[float, ...], int]]] = {}
    for level, key in enumerate(keys):
        if would_tell[level] or gone[level]:
            pixel = tuple(x for k, x in enumerate(key) if k not in times)
            of_pixel.setdefault(pixel, []).append((moment_of(tuple(key[k] for k in times)), level))
    kept, pixels, on_the_way = np.zeros(len(keys), dtype=bool), 0, False
    for levels in of_pixel.values():
        since: tuple[float, ...] | None = None
        for moment, level in sorted(levels, reverse=True):
            if not gone[level]:
                on_the_way = on_the_way or (since is not None and moment[:-1] == since[:-1])
                break
            kept[level], since = True, moment
        pixels += since is not None
    return Deaths(kept, pixels, on_the_way)
