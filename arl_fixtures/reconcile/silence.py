"""Pixels that fell silent at a step or a cycle, where only light is measured: it is gone and does not come back."""

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
FEWEST_OF_PIXEL = 2
"""Rows of a pixel, its last, from which its light is gone: of many pixels the last reading of one is a wild one."""
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
    keys: Sequence[tuple[str, ...]], per: Sequence[str], due: NDArray[np.float64], lack: NDArray[np.float64],
    rows: NDArray[np.int64],
) -> Deaths:  # fmt: skip
    """Levels from which on a pixel has lost its light: where that is likeliest, and sure of all that follow together.

    A level alone may be too dim to tell; none that follows may have its light.

    Args:
        keys: of the levels, values in the order of `per`.
        per: columns of the levels, those of `RECORD_TIME` among them.
        due: (levels,) squared light that is due there, in standard errors.
        lack: (levels,) that light times the light that is lacking.
        rows: (levels,) how many rows each has.
    """
    times = [k for k, name in enumerate(per) if name in RECORD_TIME]
    of_pixel: dict[tuple[str, ...], list[tuple[tuple[float, ...], int]]] = {}
    for level, key in enumerate(keys):
        if due[level] > 0.0:
            pixel = tuple(x for k, x in enumerate(key) if k not in times)
            of_pixel.setdefault(pixel, []).append((moment_of(tuple(key[k] for k in times)), level))
    kept, pixels, on_the_way = np.zeros(len(keys), dtype=bool), 0, False
    for levels in of_pixel.values():
        moments, order = zip(*sorted(levels), strict=True)
        at = np.array(order)
        after = np.cumsum((lack - 0.5 * due)[at][::-1])[::-1]  # log-likelihood that it is gone from there on
        since = int(np.argmax(after))
        tail = at[since:]
        if after[since] <= 0.0 or rows[tail].sum() < FEWEST_OF_PIXEL or not _are_dark(due[tail], lack[tail]):
            continue
        kept[tail] = True
        pixels += 1
        cycle = moments[since][:-1]
        before = [order[k] for k in range(since) if moments[k][:-1] == cycle]
        on_the_way = on_the_way or _has_light(due[before], lack[before])
    return Deaths(kept, pixels, on_the_way)


def _are_dark(due: NDArray[np.float64], lack: NDArray[np.float64]) -> bool:
    """Whether all levels together lack their light for sure, and none of them has it."""
    dark = float(lack.sum()) > max(LIT * float(np.sqrt(due.sum())), (1.0 - LEFT) * float(due.sum()))
    return dark and bool(np.all(due - lack < LIT * np.sqrt(due)))


def _has_light(due: NDArray[np.float64], lack: NDArray[np.float64]) -> bool:
    return float((due - lack).sum()) > LIT * float(np.sqrt(due.sum()))
