"""Noise of a channel: independent scatter of each row, and what groups of rows share by chance.

A row's mean has the standard error `sim_X_std / sqrt(n_frames)`. On top of it rows share random effects: all rows
of a step, of an image (nested in the step), of a pixel, of a stage angle. Each has a variance that is estimated by
maximum likelihood from the residual at hand, never assumed zero; a declared `sim_X_repeat_std` is its lower bound
for the step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from arl_fixtures.reconcile.columns import FloatArray, IntArray

GAUGE_FREEDOM = 12.0
"""Degrees of freedom on which a declared repeatability counts as resting: it is then off by 20 %, one in three."""
FEWEST_CROSSED = 4
"""Groups of a level that a step must hold on average for its mean to tell of the step, not of them."""
ALIKE = 1e-6
"""Share of a constant's square that is left beside what steps share, below which the two are one."""
UNNOTICED = 0.5
"""Scatter between steps that a repeatability stated as nil leaves possible, in standard errors of a step's mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """One grouping of a channel's rows.

    Attributes:
        name: `pixel`, `angle`, `patch`, `pose`, `frame`, `stretch`, `spell`, `step`, or `unit` for the zeros of
            calibrated signals.
        code: group of each row, 0…count−1.
        count: number of groups.
        scale: shape of the shared error on each row: τ·scale is its standard deviation.
        floor: lower bound of τ (1 where the scale is the declared repeatability).
        declared: whether the table states this scatter.
        amount: whether groups differ by an amount and not by a part of the signal.
        smooth: functions of the groups that are no scatter, (groups, functions); None for none.
    """

    name: str
    code: IntArray
    count: int
    scale: FloatArray
    floor: float = 0.0
    declared: bool = False
    amount: bool = False
    smooth: FloatArray | None = None

    @property
    def freedom(self) -> float:
        """Degrees of freedom of what the table states about the scatter."""
        return GAUGE_FREEDOM if self.declared else 0.0

    def is_crossed(self, step: Level) -> bool:
        """Whether each step holds several of the groups: what a step shares is then told from them."""
        pair = step.code * self.count + self.code
        few = step.count * self.count <= 4 * len(pair)  # counting takes a tenth of sorting; asked for at every fit
        pairs = np.count_nonzero(np.bincount(pair)) if few else np.unique(pair).size
        return bool(pairs >= FEWEST_CROSSED * step.count)

    def part(self, rows: IntArray) -> Level:
        """The grouping on some of its rows."""
        present, code = np.unique(self.code[rows], return_inverse=True)
        smooth = None if self.smooth is None else self.smooth[present]
        return replace(self, code=code.astype(np.int64), count=len(present), scale=self.scale[rows], smooth=smooth)

    def beyond_smooth(self, sums: FloatArray, weight: FloatArray) -> FloatArray:
        """Projections of groups beyond what they follow as smooth functions; one counts at most as the middle one."""
        if self.smooth is None or not np.any(weight > 0.0):
            return sums
        root = np.sqrt(np.minimum(weight, float(np.median(weight[weight > 0.0]))))
        mean = sums / np.maximum(weight, 1e-300)
        fitted = np.linalg.lstsq(root[:, None] * self.smooth, root * mean, rcond=1e-9)[0]
        beyond = np.asarray(sums - weight * (self.smooth @ fitted))
        return np.where(np.abs(beyond) < np.abs(sums), beyond, sums)


def less_constants(
    residual: FloatArray, scale: FloatArray, weight: FloatArray, unit: IntArray, *, second: FloatArray | None
) -> FloatArray:
    """A residual less each unit's plain gain or offset in it.

    Args:
        residual, weight, unit: of each row; scale: what a constant of 1 changes in it.
        second: what another constant of each unit changes, a zero maybe: else a gain would stand in for it, and its
            rest pass for a scatter of pixels.
    """

    def summed(x: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(unit, weight * x))

    if second is not None:
        total = np.maximum(summed(second**2), 1e-300)
        scale, residual = (x - second * (summed(second * x) / total)[unit] for x in (scale, residual))
    return residual - scale * (summed(scale * residual) / np.maximum(summed(scale**2), 1e-300))[unit]


def less_shared(residual: FloatArray, shape: FloatArray, weight: FloatArray, code: IntArray) -> FloatArray:
    """A residual less what the rows of each group share of it, in proportion to `shape`; all (n,)."""
    top, bottom = np.bincount(code, weight * shape * residual), np.bincount(code, weight * shape**2)
    return np.asarray(residual - shape * (top / np.maximum(bottom, 1e-300))[code])


def beside_steps(
    residual: FloatArray, step: Level, weight: FloatArray, scale: FloatArray | None, unit: IntArray
) -> FloatArray:
    """A residual beside what each step shares: in counts maybe, where the constant of a unit is a gain.

    Args:
        residual, weight, unit: of each row.
        scale: what a unit's constant of 1 changes, (n,); None where it is of the step's own shape, or not free.
    """
    beside = less_shared(residual, step.scale, weight, step.code)
    if scale is None:
        return beside
    slope = less_shared(scale, step.scale, weight, step.code)
    if float(weight @ slope**2) < ALIKE * float(weight @ scale**2):
        return beside
    return less_constants(beside, slope, weight, unit, second=None)


CROSSED = ("pixel", "angle")
"""Levels whose groups each hold rows of many steps."""
POSE = "pose"
"""Level of how each image stands: its groups are those of `frame`, its shape is of both signs within each."""
PATCH = "patch"
"""Level of neighbouring pixels of an image, which share its noise."""
OF_THEIR_OWN = ("unit", PATCH, POSE)
"""Levels whose shape is no part of what is corrected."""
IN_STEPS = ("frame", "stretch", "spell")
"""Groups that lie within steps: images, or few and many rows that follow one another in time."""
PARTS_OF_STEPS = (PATCH, POSE, *IN_STEPS)
"""Levels of such groups."""
NESTED = (*PARTS_OF_STEPS, "step")
"""Levels of which the groups of the one lie within those of the next."""


def turned(levels: tuple[Level, ...]) -> tuple[Level, ...]:
    """Levels in the other order in which they may be whitened: those that cross steps before these, or after.

    Where rows are missing a group of one kind sees more of one of another: what is whitened first passes for what
    comes after it (a stage angle that two steps lack, for how these are off; a pixel, for the images that hold it).
    """
    first, second = _in_order(levels)
    rest = (level for level in levels if level.name not in (*CROSSED, *NESTED))
    return (*rest, *second, *first)


def _in_order(levels: tuple[Level, ...]) -> tuple[list[Level], list[Level]]:
    """The levels of the kind that is whitened first, and those of the other."""
    crossed, nested = ([level for level in levels if level.name in names] for names in (CROSSED, NESTED))
    first = next((level.name for level in levels if level.name in (*CROSSED, *NESTED)), "")
    return (crossed, nested) if first in CROSSED else (nested, crossed)


def is_largest_first(levels: tuple[Level, ...], tau: dict[str, float]) -> bool:
    """Whether the larger scatter is whitened first: in the other order what it leaves passes for the smaller one."""
    first, second = (
        max((max(tau.get(v.name, 0.0), v.floor) * float(np.median(v.scale)) for v in kind), default=0.0)
        for kind in _in_order(levels)
    )
    return first >= second


def share_more_than_stated(levels: tuple[Level, ...], tau: dict[str, float]) -> bool:
    """Whether those of the levels that are whitened first hold any scatter beyond their floors."""
    return any(tau.get(v.name, 0.0) > v.floor for v in _in_order(levels)[0])


def ordered_like(other: tuple[Level, ...], levels: tuple[Level, ...]) -> tuple[Level, ...]:
    """Levels in the order of those of another part of the same channel."""
    place = {level.name: k for k, level in enumerate(other)}
    return tuple(sorted(levels, key=lambda level: place.get(level.name, -1)))


def surprise(tau: float, floor: float, freedom: float) -> float:
    """Log-likelihood that a scatter loses because a study of so many degrees of freedom found the floor instead."""
    if freedom == 0.0 or tau <= floor or floor <= 0.0:
        return 0.0
    ratio = tau / floor
    return float(freedom * (np.log(ratio) + 0.5 * (1.0 / ratio**2 - 1.0)))


def fit_tau(
    sums: FloatArray, weight: FloatArray, *, floor: float = 0.0, lost: float = 0.0, freedom: float = 0.0
) -> tuple[float, float]:
    """Most likely scatter of a level.

    Args:
        sums, weight: of `Whitener.group_sums`; sums²/weight has expectation 1 + τ²·weight.
        floor: smallest τ allowed.
        lost: degrees of freedom that fitted parameters took from this level.
        freedom: those of a study which found τ = floor, 0 for none.

    Returns:
        τ, and the gain of log-likelihood over τ = floor.
    """
    good = weight > 0
    if good.sum() < 3:
        return floor, 0.0
    weight = weight[good]
    power = sums[good] ** 2 / weight * (len(weight) / max(len(weight) - lost, 1.0))

    def loss(log_tau: float) -> float:
        variance = np.exp(2.0 * log_tau) * weight
        variance += 1.0
        found = np.log(variance)
        found += power / variance
        unlikely = surprise(float(np.exp(log_tau)), floor, freedom) if freedom else 0.0
        return float(0.5 * np.add.reduce(found)) + unlikely

    at_floor = 1.0 + floor**2 * weight
    base = float(0.5 * np.sum(np.log(at_floor) + power / at_floor))
    unit = -0.5 * float(np.log(np.median(weight)))
    low = np.log(floor) if floor > 0 else unit - 4.0
    high = max(unit + 0.5 * float(np.log(max(power.max(), 1.0))) + 2.0, low + 1.0)
    best = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 1e-3})
    gain = base - float(best.fun)
    if gain <= 1e-9:
        return floor, 0.0
    return float(np.exp(best.x)), gain


def unnoticed(scale: FloatArray, stated: FloatArray, group: IntArray) -> FloatArray:
    """Scatter of groups, in proportion to `scale`, that a study may have overlooked which says there is none."""
    _, code = np.unique(group, return_inverse=True)
    of_a_group = np.bincount(code, (scale / stated) ** 2)
    return np.asarray(scale * UNNOTICED / np.sqrt(np.median(of_a_group)))


def scale_of(values: FloatArray) -> FloatArray:
    """What a relative error of 1 would change, at least a thousandth of the median; 1 where there is no signal."""
    middle = float(np.median(np.abs(values)))
    return np.maximum(np.abs(values), 1e-3 * middle) if middle > 0 else np.ones(len(values))


def level_of(
    name: str, code: IntArray, scale: FloatArray, *, floor: float = 0.0, fewest: int = 3, declared: bool = False
) -> Level | None:
    """Level of the rows' groups; None where there are fewer than `fewest`, or about one row in each."""
    present, inverse = np.unique(code, return_inverse=True)
    if len(present) < fewest or len(code) < 2 * len(present):
        return None
    return Level(
        name=name, code=inverse.astype(np.int64), count=len(present), scale=scale, floor=floor, declared=declared
    )
