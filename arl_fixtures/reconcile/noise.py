"""Noise of a channel: independent scatter of each row, and what groups of rows share by chance.

A row's mean has the standard error `sim_X_std / sqrt(n_frames)`. On top of it rows share random effects: all rows
of a step, of an image (nested in the step), of a pixel, of a stage angle. Each has a variance that is estimated by
maximum likelihood from the residual at hand, never assumed zero; a declared `sim_X_repeat_std` is its lower bound
for the step.

`Whitener` turns residuals and tangents into independent unit variables: for one grouping the transform x → x − d·(1
− 1/√(1 + τ²W))·(d·x)/W, with d = √w·g the direction and W = d·d, is the exact inverse square root of 1 + τ² d d';
nested groupings are exact too (the inner transform first, the outer on the transformed direction), crossed ones
(pixel, angle) are an approximation that is good when each group is spread thinly over the others, or where what is
whitened first is the larger scatter.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_array

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
        name: `pixel`, `angle`, `frame`, `step`, or `unit` for the zeros of calibrated signals.
        code: group of each row, 0…count−1.
        count: number of groups.
        scale: shape of the shared error on each row: τ·scale is its standard deviation.
        floor: lower bound of τ (1 where the scale is the declared repeatability).
        declared: whether the table states this scatter.
    """

    name: str
    code: IntArray
    count: int
    scale: FloatArray
    floor: float = 0.0
    declared: bool = False

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
        return replace(self, code=code.astype(np.int64), count=len(present), scale=self.scale[rows])


@dataclass(frozen=True, slots=True)
class _Step:
    tau: float
    code: IntArray
    count: int
    direction: FloatArray
    weight: FloatArray
    shrink: FloatArray


def _step_of(level: Level, direction: FloatArray, weight: FloatArray, tau: float) -> _Step:
    tau = max(tau, level.floor)
    with np.errstate(invalid="ignore", divide="ignore"):
        shrink = np.where(weight > 0, (1.0 - 1.0 / np.sqrt(1.0 + tau**2 * weight)) / weight, 0.0)
    return _Step(tau, level.code, level.count, direction, weight, shrink)


class Shared:
    """Projection of many columns on a direction within each group, and what it makes on the rows.

    Args:
        code: group of each row; direction: of each row; count: number of groups.
    """

    def __init__(self, code: IntArray, direction: FloatArray, count: int) -> None:
        ends = np.arange(len(code) + 1, dtype=np.int32)
        self._rows = csr_array((direction, code.astype(np.int32), ends), shape=(len(code), count))
        self._sums = self._rows.T.tocsr()

    def sums(self, z: FloatArray) -> FloatArray:
        """Per group and column: (n, k) to (count, k)."""
        return np.asarray(self._sums @ z)

    def rows(self, share: FloatArray) -> FloatArray:
        """A share of the direction in each group, on rows: (count, k) to (n, k)."""
        return np.asarray(self._rows @ share)


class Whitener:
    """Linear map to independent unit variables for given group scatters.

    Args:
        root_weight: 1 / standard error of each row (0 = row does not count).
        levels: `frame` before `step`; before or after both the crossed ones (see `by_size`).
        tau: level name to scatter in units of the level's scale.
    """

    def __init__(self, root_weight: FloatArray, levels: tuple[Level, ...], tau: dict[str, float]) -> None:
        self.root_weight = root_weight
        self.levels: tuple[Level, ...] = ()
        self.tau: dict[str, float] = {}
        self._steps: list[_Step] = []
        self._shared: list[Shared] = []
        self.log_det = 0.0
        for level in levels:
            self._append(level, self._prepare(level, tau.get(level.name, 0.0)))

    def _append(self, level: Level, step: _Step) -> None:
        self.levels, self.tau = (*self.levels, level), {**self.tau, level.name: step.tau}
        self._steps, self._shared = [*self._steps, step], []
        self.log_det += float(np.sum(np.log1p(step.tau**2 * step.weight)))

    def _prepare(self, level: Level, tau: float) -> _Step:
        direction = self.root_weight * level.scale
        if level.name == "step":
            for step, inner in zip(self._steps, self.levels, strict=True):
                if inner.name == "frame":
                    direction = _apply(step, direction)
        weight = _sum_by(level.code, direction**2, level.count)
        return _step_of(level, direction, weight, tau)

    def followed_by(self, level: Level, tau: float = 0.0) -> Whitener:
        """The map with one more level; what is prepared for those before it serves both."""
        made = copy(self)
        made._append(level, self._prepare(level, tau))
        return made

    def at(self, tau: float) -> Whitener:
        """The map with another scatter of its last level."""
        level, last = self.levels[-1], self._steps[-1]
        if max(tau, level.floor) == last.tau:
            return self
        made = Whitener(self.root_weight, (), {})
        for inner, step in zip(self.levels[:-1], self._steps[:-1], strict=True):
            made._append(inner, step)
        made._append(level, _step_of(level, last.direction, last.weight, tau))
        return made

    def __call__(self, x: FloatArray) -> FloatArray:
        """Whiten a residual or tangent, shape (n,) or (k, n)."""
        if x.ndim == 2:
            return np.stack([self(row) for row in x]) if len(x) else x.copy()
        z = self.root_weight * x
        for step in self._steps:
            z = _apply(step, z)
        return z

    def columns(self, z: FloatArray) -> None:
        """Whiten many columns at once and in place; their rows, shape (n, k), are in standard errors already."""
        if not self._shared:
            self._shared = [Shared(step.code, step.direction, step.count) for step in self._steps]
        for step, shared in zip(self._steps, self._shared, strict=True):
            if step.tau > 0.0:
                z -= shared.rows(step.shrink[:, None] * shared.sums(z))

    def group_sums(self, x: FloatArray, name: str) -> tuple[FloatArray, FloatArray]:
        """Per group of a level: projection of the residual on the group's direction, and its weight."""
        z = self.root_weight * x
        for level, step in zip(self.levels, self._steps, strict=True):
            if level.name == name:
                return _sum_by(step.code, step.direction * z, step.count), step.weight
            z = _apply(step, z)
        raise KeyError(name)


def _sum_by(code: IntArray, x: FloatArray, count: int) -> FloatArray:
    return np.asarray(np.bincount(code, x, minlength=count), dtype=np.float64)


def _apply(step: _Step, z: FloatArray) -> FloatArray:
    if step.tau == 0.0:
        return z
    work = step.direction * z
    share = step.shrink * np.bincount(step.code, work, minlength=step.count)
    np.take(share, step.code, out=work, mode="clip")  # else it works on a copy; codes are within
    work *= step.direction
    return np.subtract(z, work, out=work)


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
NESTED = ("frame", "step")
"""Levels of which the groups of the one lie within those of the other."""


def by_size(levels: tuple[Level, ...], tau: dict[str, float]) -> tuple[Level, ...]:
    """Levels in the order in which they are best whitened: those that cross steps first, or steps if they share more.

    Where rows are missing a group of one kind sees more of one of another: what the larger scatter leaves in the sums
    of the smaller one would pass for it (a stage angle that two steps lack, for how these are off).
    """

    def size(names: tuple[str, ...]) -> float:
        scatters = [max(tau.get(v.name, 0.0), v.floor) * float(np.median(v.scale)) for v in levels if v.name in names]
        return max(scatters, default=0.0)

    crossed = [level for level in levels if level.name in CROSSED]
    nested = [level for level in levels if level.name in NESTED]
    rest = [level for level in levels if level.name not in (*CROSSED, *NESTED)]
    pair = (nested, crossed) if size(NESTED[-1:]) > size(CROSSED) else (crossed, nested)
    return (*rest, *pair[0], *pair[1])


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
