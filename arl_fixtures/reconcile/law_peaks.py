"""Peaks of a law: a resonance over a frequency or a temperature, a line over a wavelength.

A curve that is as smooth everywhere can be as steep as a peak only where it wags elsewhere, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.features import OF_NEIGHBOURS
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_bands import PRICE_BAND, parted
from arl_fixtures.reconcile.law_basis import PRICE_PRODUCT, Basis, price_of
from arl_fixtures.reconcile.law_candidates import likeliest, shared_price
from arl_fixtures.reconcile.law_work import Work

WIDTHS = (0.02, 0.04, 0.08, 0.16)
"""Half widths at half height that are tried, as shares of the column's span: a wider one is a curve."""
LEAST_IN, LEAST_BLOCKS = 3, 2
"""Levels of a column, and blocks, that a peak must reach at half its height: on one it is a level that is off."""
FINER = ((0.6, 0.5), (0.2, 0.2), (0.07, 0.08))
"""Relative change of a peak's width, and part of that by which it is moved, within which it is refined."""


def peaks_of(work: Work, names: Sequence[str], lines: Sequence[Axis]) -> Iterator[Basis]:
    """The best peak over each column, alone and times lines of others.

    Args:
        work: the rows; names: columns with sizes.
        lines: that may multiply it.
    """
    for name in names:
        if name.startswith(OF_NEIGHBOURS):
            continue
        for line in (None, *lines):
            axis = None if line and line.column == name else best_peak(work, name, work.features[name], line)
            if axis is None:
                continue
            columns, axes = ((name,), (axis,)) if line is None else ((name, line.column), (axis, line))
            price = PRICE_BAND + price_of(columns) + shared_price(work, columns)
            yield Basis(axes=axes, price=price + (0.0 if line is None else PRICE_PRODUCT))


def best_peak(work: Work, name: str, values: FloatArray, line: Axis | None = None) -> Axis | None:
    """The peak that explains most of what is left, from sums over a column's levels; None where there is none.

    Args:
        work: the rows; name: of the axis; values: (n,) of the column.
        line: that multiplies it.
    """
    levels = parted(work, name, values)
    if levels is None:
        return None
    there = levels.code >= 0
    direction = work.direction if line is None else work.direction * line(work.features)
    code, x, count = levels.code[there], values[there], len(levels.cuts) + 1
    place = np.bincount(code, x, count) / np.maximum(np.bincount(code, minlength=count), 1)
    push = np.bincount(code, (direction * work.residual)[there], count)
    power = np.bincount(code, direction[there] ** 2, count)
    at, width = (a.ravel() for a in np.meshgrid(place[1:-1], np.array(WIDTHS) * np.ptp(place), indexing="ij"))
    shape = 1.0 / (1.0 + ((place[None, :] - at[:, None]) / width[:, None]) ** 2)
    gain = (shape @ push) ** 2 / np.maximum(shape**2 @ power, 1e-300)
    gain[np.sum(shape > 0.5, axis=1) < LEAST_IN] = 0.0
    best = int(np.argmax(gain))
    high = np.abs(x - at[best]) < width[best]
    if not gain[best] > 0.0 or np.unique(work.block[there][high]).size < LEAST_BLOCKS:
        return None
    return Axis(column=name, kind="peak", at=float(at[best]), width=float(width[best]))


def refined_peak(work: Work, left: FloatArray, basis: Basis, number: int) -> Basis:
    """A basis with one of its peaks where it is likeliest: wider or narrower, and moved by ever finer parts of that.

    Args:
        work: the rows; left: what the other terms leave.
        basis: with the peak; number: of its axis.
    """
    for change, part in FINER:
        axis = basis.axes[number]
        others = [
            replace(axis, width=axis.width * (1.0 + more), at=axis.at + axis.width * moved)
            for more in np.linspace(-change, change, 7)
            for moved in np.linspace(-part, part, 7)
        ]
        basis = likeliest(work, left, [basis, *(basis.with_axis(number, other) for other in others)])
    return basis
