"""Waves over one column or two: at which period a residual swings most.

A pump, a fan or a compressor may turn hundreds of times in a record. All periods that a column's levels can tell are
asked for at once, by Fourier transforms of the residual's sums over a fine grid (Press & Rybicki, Astrophys. J. 338
(1989) 277, for the least-squares periodogram of uneven times; here on the nearest cell of a grid so fine that the
phase is off by a few hundredths of a turn at most).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import Rings
from arl_fixtures.reconcile.law_work import Work

FAR_APART, FAR_BESIDE = 0.9, 0.25
"""Share of the gaps between a column's levels of which half a wave must be longer; of one over two columns."""
_FILLED = 0.5
"""Share of the thirds of a wave's turns in which a column must have levels."""
MOST_TURNS, ALONE_TURNS = 16.0, 24.0
"""Turns of a wave over the span of each of two columns, and of one column alone."""
MOST_IN_TIME = 4096.0
"""Turns of a wave over time: a few seconds of a cycle of hours."""
_PARTS = 8
"""Frequencies that are tried within a turn over the span."""
_CELLS_OF_TURN = 24
"""Cells of the grid in the shortest turn."""
_RANK = 1e-9
"""Share of all weight below which a wave differs from a constant, or a sine from a cosine, by rounding."""


class Wave(NamedTuple):
    """Turns per unit of a column, and the log-likelihood that it must earn beside others for its many looks."""

    turns: float
    price: float


def best_rings(work: Work, name: str, rings: Rings) -> Wave | None:
    """The rings over an angle at which the residual swings most, in turns per unit of their phase; at least one."""
    wave = best_wave(work, name, values=rings.of(work.features[name]))
    return wave if wave and wave.turns > 1.0 else None


def best_moving_rings(work: Work, name: str, second: str, rings: Rings) -> tuple[float, float] | None:
    """Rings over an angle that move with a second column: turns per unit of their phase, and per unit of that."""
    turns = best_pair_wave(work, name, second, rings.of(work.features[name]))
    return turns if turns and turns[0] > 1.0 else None


def best_wave(
    work: Work, name: str, factor: FloatArray | None = None, values: FloatArray | None = None
) -> Wave | None:  # fmt: skip
    """The wave over a column at which the residual swings most, None for columns with few values.

    Args:
        work: the rows; name: of the column.
        factor: what the wave comes with, by row; nothing else by default.
        values: of another function of the column than itself.
    """
    x = work.features[name] if values is None else values
    good = np.isfinite(x) if factor is None else np.isfinite(x) & (factor != 0.0)  # the levels of these rows count
    levels, code = np.unique(x[good], return_inverse=True)
    if len(levels) < 8 or not good.any():
        return None
    span = float(levels[-1] - levels[0])
    if name == "time_s":  # images that follow each other closely tell what steps far apart cannot
        most = min(_half_waves(levels, FAR_BESIDE), MOST_IN_TIME)
    else:
        most = _told_turns(levels, min(len(levels) / 3.0, ALONE_TURNS, _most_turns(levels)))
    direction = work.direction[good] if factor is None else (work.direction * factor)[good]
    score: FloatArray = np.bincount(code, direction * work.residual[good]).astype(np.float64)
    weight: FloatArray = np.bincount(code, direction**2).astype(np.float64)
    turns = _strongest((levels - levels[0]) / span, score, weight, most)
    return Wave(turns / span, max(float(np.log(most / ALONE_TURNS)), 0.0))


def _most_turns(levels: FloatArray, apart: float = FAR_APART) -> float:
    """Turns over a column up to which its levels lie close enough together; whole numbers are all there are."""
    return np.inf if bool(np.all(levels == np.round(levels))) else _half_waves(levels, apart)


def _half_waves(levels: FloatArray, apart: float) -> float:
    """Turns of which half a wave is as long as this share of the gaps between levels, whole seconds or not."""
    gap = float(np.quantile(np.diff(levels), apart))
    return 0.5 * float(levels[-1] - levels[0]) / gap


def _told_turns(levels: FloatArray, most: float) -> float:
    """Turns up to which a column's levels fill half of the thirds of a turn: fewer cannot tell a wave from another.

    Levels in a few clusters, or on a lattice of every third number, see a short wave as a slow one.
    """
    place = (levels - levels[0]) / max(float(levels[-1] - levels[0]), 1e-300)
    for turns in np.arange(1.0, most, 0.5):
        cells = int(np.ceil(3.0 * turns))
        if np.unique(np.minimum((place * cells).astype(np.int64), cells - 1)).size < _FILLED * cells:
            return float(turns)
    return most


def _strongest(place: FloatArray, score: FloatArray, weight: FloatArray, most: float) -> float:
    """Turns, from half a one on, with the largest drop of the weighted sum of squares, beside a constant.

    Args:
        place: of each level, 0 to 1; score, weight: sums over its rows.
        most: turns up to which waves are tried.
    """
    order = np.arange(_PARTS // 2, max(int(_PARTS * most), _PARTS // 2 + 1))
    cells = 1 << int(np.ceil(np.log2(_PARTS * _CELLS_OF_TURN * (most + 1.0))))
    cell = np.minimum(np.rint(place * (cells / _PARTS)).astype(np.int64), cells - 1)
    pushed, counted = (np.fft.rfft(np.bincount(cell, x, minlength=cells)) for x in (score, weight))
    total, shared = max(float(weight.sum()), 1e-300), float(score.sum())  # nothing is told of a dark simulation
    sine, cosine, twice = -counted[order].imag, counted[order].real, counted[2 * order]
    push_sine = -pushed[order].imag - shared * sine / total  # beside a constant
    push_cosine = pushed[order].real - shared * cosine / total
    sines = 0.5 * (total - twice.real) - sine**2 / total
    cosines = 0.5 * (total + twice.real) - cosine**2 / total
    both = -0.5 * twice.imag - sine * cosine / total
    size, determinant = sines + cosines, sines * cosines - both**2
    whole = determinant > _RANK * total * size  # or else one wave of the two is no other than the constant
    squares = cosines * push_sine**2 - 2.0 * both * push_sine * push_cosine + sines * push_cosine**2
    drop = np.divide(push_sine**2 + push_cosine**2, size, out=np.zeros(len(order)), where=size > _RANK * total)
    return float(order[np.argmax(np.divide(squares, determinant, out=drop, where=whole))]) / _PARTS


def best_pair_wave(
    work: Work, first: str, second: str, values: FloatArray | None = None
) -> tuple[float, float] | None:  # fmt: skip
    """Turns per unit of two columns at which a wave over both is strongest, from a periodogram of cells.

    Args:
        work: the rows; first, second: names of the columns.
        values: of another function of the first column than itself.
    """
    x, y = work.features[first] if values is None else values, work.features[second]
    good = np.isfinite(x) & np.isfinite(y)
    cells = []
    for values in (x[good], y[good]):
        levels = np.unique(values)
        if len(levels) < 6:
            return None
        if len(levels) > 48:
            cuts = np.linspace(levels[0], levels[-1], 49)
            code = np.clip(np.searchsorted(cuts, values, side="right") - 1, 0, 47)
            cells.append((0.5 * (cuts[1:] + cuts[:-1]), code))
        else:
            cells.append((levels, np.searchsorted(levels, values)))
    (a, code_a), (b, code_b) = cells
    direction = work.direction[good]
    flat = code_a * len(b) + code_b
    score = np.bincount(flat, direction * work.residual[good], minlength=len(a) * len(b)).reshape(len(a), len(b))
    span_a, span_b = float(a[-1] - a[0]), float(b[-1] - b[0])
    most_a, most_b = (
        most if name.endswith(("time_s", "time_s)")) else _told_turns(np.unique(here[good]), most)
        for name, here, most in (
            (first, x, min(len(a) / 3.0, MOST_TURNS, _most_turns(a, FAR_BESIDE))),
            (second, y, min(MOST_TURNS, _most_turns(b, FAR_BESIDE))),
        )
    )  # fmt: skip
    turns_a = np.arange(0.0, most_a, 0.125) / span_a
    turns_b = np.arange(-most_b, most_b, 0.125) / span_b
    power = np.abs(np.exp(2j * np.pi * np.outer(turns_a, a)) @ score @ np.exp(2j * np.pi * np.outer(b, turns_b))) ** 2
    power[turns_a * span_a < 0.3, :] = 0.0
    power[:, np.abs(turns_b * span_b) < 0.3] = 0.0
    i, j = np.unravel_index(int(np.argmax(power)), power.shape)
    return (float(turns_a[i]), float(turns_b[j])) if power[i, j] > 0 else None
