"""Rows that are off by far alone: wild readings, unless what is next to them, or of their kind, is off as well.

A few readings in a thousand may be wild by any amount. A fit by least squares would follow them, and a region drawn
about one looks like an effect. What an effect does it does to more than one row: to a pixel in other steps, to its
neighbours in the image or in the sweep, to the rest of the frame. Wild readings come in bursts of six rows at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effects_common import per_view
from arl_fixtures.reconcile.estimated_noise import group_median, group_quantiles
from arl_fixtures.reconcile.grouping import ROWS_OF_A_CURVE
from arl_fixtures.reconcile.problem import Problem

FAR_ALONE = 5.0
"""Standard errors from which a row is wild if nothing beside it is off: one of two million Gaussian ones."""
MOST_ALONE = 0.01
"""Share of rows above which far ones are no wild readings, but what the noise or an effect does."""
MOST_LINES = 8
"""Other columns that rows of a table without pixels, stage and times may be ordered by."""
FEWEST_KIN = 3
"""Rows of a kind whose median one of them does not set."""
TOLD = 3.75
"""Size of a median, in scatters of one row over the root of their number, from which rows of a kind are off."""


@dataclass(frozen=True, slots=True)
class Kin:
    """Which rows stand by each other.

    Attributes:
        kinds: codes of rows of a kind (a pixel), 0…k−1 each, most of which are off with one that an effect moves.
        images: codes of rows that were taken together (an image, a step), of which nearly all are.
        lines: orders of the rows along a line (of the image, of the sweep).
    """

    kinds: Sequence[IntArray] = ()
    images: Sequence[IntArray] = ()
    lines: Sequence[IntArray] = ()


def distance_alone(z: FloatArray, kin: Kin) -> FloatArray:
    """How far each row is off from what its kin are off, both in standard errors: |z| where these are not."""
    alone = np.abs(z)
    far = np.flatnonzero(alone > FAR_ALONE)
    if not far.size:
        return alone
    for code, image in [*((code, False) for code in kin.kinds), *((code, True) for code in kin.images)]:
        count = np.bincount(code)
        middle = (common_part if image else group_median)(code, z, len(count))
        spread = 1.4826 * group_median(code, np.abs(z - middle[code]), len(count))
        told = (count >= FEWEST_KIN) & (np.abs(middle) * np.sqrt(count) > TOLD * np.maximum(spread, 1.0))
        own = code[far]
        off = np.abs(z[far] - middle[own]) / np.maximum(spread[own], 1.0)
        alone[far] = np.where(told[own], np.minimum(alone[far], off), alone[far])
    for order in kin.lines:
        between = _between(z, order)[far]
        alone[far] = np.minimum(alone[far], np.abs(z[far] - between))
    return alone


def common_part(code: IntArray, z: FloatArray, count: int) -> FloatArray:
    """What the rows of each group are off in common, (count,): their median, but nil where not nearly all are.

    A burst of wild readings may fill more than half of an image; what an image shares it shares with nearly all rows.
    """
    low, middle, high = group_quantiles(code, z, count, (0.2, 0.5, 0.8))
    least = np.where(middle > 0.0, low, -high)
    return np.where((np.abs(middle) > FAR_ALONE) & (least < 0.5 * np.abs(middle)), 0.0, middle)


def _between(z: FloatArray, order: IntArray) -> FloatArray:
    """What six of the eight rows about a row are off at least, in its direction; nil where fewer are.

    Wild readings come in bursts, too: the rows of a burst are no witnesses for each other.
    """
    far, none = 4, np.zeros(4)
    line, sign = np.concatenate([none, z[order], none]), np.sign(z[order])
    about = np.stack([sign * line[far + k : len(line) - far + k] for k in range(-far, far + 1) if k])
    result = np.zeros(len(z))
    result[order] = sign * np.maximum(np.sort(about, axis=0)[2], 0.0)
    return result


def scatter_beside(z: FloatArray, kin: Kin) -> float:
    """Robust scatter of rows about the two next to them on a line, on the line where it is least.

    What a model lacks changes little from row to row along some line; noise does not know where rows stand.
    """
    off = [float(np.median(np.abs(z[o][1:-1] - 0.5 * (z[o][2:] + z[o][:-2])))) for o in kin.lines if len(o) > 2]
    return min((1.4826 / np.sqrt(1.5) * each for each in off), default=np.inf)


def distance_beside(z: FloatArray, kin: Kin) -> FloatArray:
    """How far each row is off from the middle of what lies on both its sides, on the line where that is least."""
    off, none = np.abs(z), np.zeros(4)
    for order in kin.lines:
        line = np.concatenate([none, z[order], none])
        before = np.median([line[k : len(line) - 8 + k] for k in range(4)], axis=0)
        after = np.median([line[k : len(line) - 8 + k] for k in range(5, 9)], axis=0)
        off[order] = np.minimum(off[order], np.abs(z[order] - 0.5 * (before + after)))
    return off


_LINES = (
    ("stage_angle_deg", "pixel_v", "pixel_u"),
    ("stage_angle_deg", "pixel_u", "pixel_v"),
    ("pixel_u", "pixel_v", "stage_angle_deg"),
    ("time_s",),
)
"""Columns that order the rows of a step along a line, the last of which runs fastest."""


def _curves(problem: Problem, rows: IntArray) -> list[list[FloatArray]]:
    """Columns that order the rows of a table without images along curves: one last, those of few values before it."""
    numbers = {name: problem.columns.numbers[name][rows] for name in problem.view.covariates()}
    few = [name for name, x in numbers.items() if len(np.unique(x)) <= len(x) / ROWS_OF_A_CURVE]
    ordered = [name for name in numbers if (name,) not in _LINES][:MOST_LINES]
    return [[*(numbers[n] for n in few if n != name), numbers[name]] for name in ordered]


def kin_of(problem: Problem, use: IntArray) -> Kin:
    """Kin of a channel's rows."""

    def make() -> Kin:
        rows, groups, numbers = problem.view.rows[use], problem.groups, problem.columns.numbers
        codes = {
            name: np.unique(code[rows], return_inverse=True)[1].astype(np.int64)
            for name in ("pixel", "angle", "frame", "step")
            if (code := getattr(groups, name)) is not None
        }
        kinds = [codes[name] for name in ("pixel", "angle") if name in codes]
        if len(kinds) == 2:
            both = kinds[0] * (int(kinds[1].max()) + 1) + kinds[1]
            kinds.append(np.unique(both, return_inverse=True)[1].astype(np.int64))
        unit, step = groups.unit[rows], groups.step[rows]
        lines = [
            [step, unit, *(numbers[n][rows] for n in line)] for line in _LINES if all(n in numbers for n in line)
        ]
        if groups.of_curves:
            lines += [[unit, *line] for line in _curves(problem, rows)]
        if "pixel" in codes:
            lines.append([codes["pixel"], codes.get("angle", unit), step])
        return Kin(
            kinds=kinds, images=[codes[name] for name in ("frame", "step") if name in codes],
            lines=[np.lexsort(tuple(reversed(keys))).astype(np.int64) for keys in lines],
        )  # fmt: skip

    return per_view(problem.view, ("kin", use.size, int(use.sum())), make)
