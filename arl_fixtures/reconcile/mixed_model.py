"""Constants of units beside what groups share, by generalised least squares that is exact for groups that cross.

Henderson's mixed model equations: with the units' directions X, the groups' directions Z and their variances τ², the
solution of [X'WX X'WZ; Z'WX Z'WZ + τ⁻²] [c; u] = [X'Wr; Z'Wr] has the c of generalised least squares, and the inverse
its covariance (Henderson, Biometrics 31 (1975) 423).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_matrix, diags_array, hstack
from scipy.sparse.linalg import splu

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.noise import Level

RIDGE = 1e-12
"""Share of the largest diagonal element that keeps what no row tells from being singular."""


class UnitConstants:
    """Solver for the gains or offsets of units under given scatters.

    Args:
        root_weight: 1 / standard error of each row, (n,).
        unit: unit of each row, (n,); units: their number.
        scale: what a constant of 1 changes in each row, (n,).
        levels: groups that share errors; tau: their scatters by name.

    Attributes:
        errors: standard error of each unit's constant, (units,); infinite for a unit without a row that counts.
    """

    def __init__(
        self, root_weight: FloatArray, unit: IntArray, units: int, scale: FloatArray, levels: Sequence[Level],
        tau: dict[str, float],
    ) -> None:  # fmt: skip
        shared = [level for level in levels if tau.get(level.name, 0.0) > 0.0]
        own = _indicators(unit, root_weight * scale, units)
        self._root_weight, self._units = root_weight, units
        self._design = hstack(
            [own, *(_indicators(v.code, root_weight * tau[v.name] * v.scale, v.count) for v in shared)], format="csr"
        )
        known = np.concatenate([np.zeros(units), *(np.ones(v.count) for v in shared)])
        normal = self._design.T @ self._design
        least = RIDGE * max(float(normal.diagonal().max()), 1e-300)
        self._solver = splu((normal + diags_array(known + least)).tocsc(), permc_spec="MMD_AT_PLUS_A")
        covariance = self._solver.solve(np.eye(len(known), units))
        seen = np.asarray(own.power(2).sum(axis=0)).ravel() > 0.0
        self.errors: FloatArray = np.where(seen, np.sqrt(np.maximum(np.diag(covariance[:units]), 0.0)), np.inf)

    def of(self, residual: FloatArray) -> FloatArray:
        """Gain or offset of each unit in a residual, (units,)."""
        score = self._design.T @ (self._root_weight * residual)
        return np.asarray(self._solver.solve(score)[: self._units], dtype=np.float64)


def _indicators(code: IntArray, values: FloatArray, count: int) -> csr_matrix:
    """Matrix with the value of each row in the column of its group, (n, count)."""
    return csr_matrix((values, code, np.arange(len(code) + 1)), shape=(len(code), count))
