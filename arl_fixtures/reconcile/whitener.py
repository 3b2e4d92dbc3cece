"""Residuals made independent, for given scatters of the groups that rows share errors in.

For one grouping the transform x → x − d·(1 − 1/√(1 + τ²W))·(d·x)/W, with d = √w·g the direction and W = d·d, is the
exact inverse square root of 1 + τ² d d'; nested groupings are exact too (the inner transform first, the outer on the
transformed direction), crossed ones (pixel, angle) are an approximation that is good when each group is spread thinly
over the others, or where what is whitened first is the larger scatter.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.noise import NESTED, PARTS_OF_STEPS, Level


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
        levels: `frame`, or `stretch` and `spell`, before `step`; before or after them the crossed ones (`turned`).
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
        if level.name in NESTED:
            for step, inner in zip(self._steps, self.levels, strict=True):
                if inner.name in PARTS_OF_STEPS:
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
