"""A channel's rows as the search for a law sees them: a part of them, whitened, without what calibration explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Axis, Features
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.noise import Whitener
from arl_fixtures.reconcile.problem import ChannelData
from arl_fixtures.reconcile.roles import Role

MOST_ROWS, ALL_ROWS = 6_000, 20_000
"""Rows on which candidates are ranked, and on which the best of them are judged and fitted."""
LEAST_LEVELS, MOST_LEVELS, LEVEL_FOLDS = 5, 48, 4
"""Levels of a column from which, and into at most how many, it is parted; folds of them."""
LEAST_SEEN = 1e-3
"""Share of a function's power that must be left beside the units' constants."""


@dataclass(slots=True, kw_only=True)
class Candidate:
    """A basis on the rows at work: whitened vectors, their sums per fold, and what it would gain."""

    basis: Basis
    vectors: FloatArray
    gram: FloatArray
    gain: float = 0.0
    width: float = 1.0


class Work:
    """A part of a channel's rows, whitened by the channel's noise.

    Args:
        data: the channel; state: corrected simulation that its residual is taken from.
        features: columns on the view's rows.
        tau: scatters that groups share.
        most: rows at work, drawn where there are more.
    """

    def __init__(
        self, data: ChannelData, state: State, features: Features, tau: dict[str, float], most: int = MOST_ROWS
    ) -> None:
        n = len(data.use)
        pick = np.arange(n)
        if n > most:  # not every k-th: a stride would alias with the image's rows
            pick = np.sort(np.random.default_rng(n).choice(n, size=most, replace=False))
        self.data, self.pick = data, pick
        self.features: Features = {name: values[data.use[pick]] for name, values in features.items()}
        levels = tuple(level.part(pick) for level in data.levels)
        self._root_weight = data.root_weight[pick]
        self._whitener = Whitener(self._root_weight, levels, tau)
        self._axes: dict[Axis, FloatArray] = {}
        self.unit = np.unique(data.unit[pick], return_inverse=True)[1]
        relative = data.channel.role in {Role.INTENSITY, Role.SCATTER}
        sim = state[data.channel.name][data.use[pick]]
        self.scale = data.expect[pick] * (sim if relative else np.ones(len(pick)))
        self.direction = self.scale * self._root_weight
        self._constant = self._whitener(data.scale[pick]) if data.calibrated else np.zeros(0)
        self._power = np.maximum(np.bincount(self.unit, self._constant**2), 1e-300) if data.calibrated else None
        self.residual = self.whiten(data.residual(state)[pick])
        self.step = next(
            (level.code for level in levels if level.name == "step"), np.zeros(len(pick), dtype=np.int64)
        )
        self.fold, self.block = data.fold[pick], np.unique(data.block[pick], return_inverse=True)[1]

    def whiten(self, x: FloatArray) -> FloatArray:
        """Whitened vector without what a constant per unit explains."""
        z = self._whitener(x)
        if self._power is not None:
            share = np.bincount(self.unit, self._constant * z) / self._power
            z = z - self._constant * share[self.unit]
        return np.asarray(z)

    def is_shared(self, columns: Sequence[str]) -> bool:
        """Whether all columns are constant within steps: steps then are the only witnesses, and they share errors."""
        count = np.maximum(np.bincount(self.step), 1)
        for name in columns:
            x = np.nan_to_num(self.features[name])
            mean = np.bincount(self.step, x) / count
            if float(np.mean((x - mean[self.step]) ** 2)) > 0.02 * float(np.var(x)):
                return False
        return True

    def levels_of(self, column: str) -> IntArray | None:
        """Folds that keep equal (or, of very many, neighbouring) values of a column together; None for few values."""
        x = np.nan_to_num(self.features[column])
        levels, code = np.unique(x, return_inverse=True)
        if len(levels) < LEAST_LEVELS:
            return None
        if len(levels) > MOST_LEVELS:
            code = np.searchsorted(np.quantile(x, np.linspace(0.0, 1.0, MOST_LEVELS + 1)[1:-1]), x, side="right")
        fold = np.random.default_rng(len(levels)).permutation(int(code.max()) + 1) % LEVEL_FOLDS
        return np.asarray(fold[code], dtype=np.int64)

    def candidate(self, basis: Basis) -> Candidate:
        """A basis on these rows."""
        vectors = basis.vectors(self.features, self._axes) * self.scale
        white = np.empty_like(vectors)
        for place, vector in enumerate(vectors):
            white[place] = self.whiten(vector)
        gram = white @ white.T
        # what calibration explains must not come back as a difference of large numbers
        np.multiply(vectors, self._root_weight, out=vectors)
        lost = np.diag(gram) < LEAST_SEEN * np.einsum("kn,kn->k", vectors, vectors)
        if lost.any():
            white[lost] = gram[lost] = gram[:, lost] = 0.0
        return Candidate(basis=basis, vectors=white, gram=gram)


def evidence(gram: FloatArray, score: FloatArray, prior: FloatArray | None) -> tuple[float, float]:
    """Gain of marginal likelihood of coefficients with a prior covariance at its best width, and that width."""
    if prior is None:
        power = np.diag(gram)
        if not np.all(power > 1e-9):
            return 0.0, 0.0
        if len(score) == 1:
            return 0.5 * float(score[0] * (score[0] / gram[0, 0])), np.inf
        return 0.5 * float(score @ np.linalg.lstsq(gram, score, rcond=1e-10)[0]), np.inf
    root = np.linalg.cholesky(prior + 1e-9 * np.eye(len(prior)))
    size, turn = np.linalg.eigh(root.T @ gram @ root)
    size = np.maximum(size, 0.0)
    if size[-1] <= 1e-9:
        return 0.0, 0.0
    push = (turn.T @ (root.T @ score)) ** 2
    widths = np.geomspace(0.1 / size[-1], 1e4 / size[-1], 26)[:, None]
    gains = 0.5 * np.sum(widths * push / (1.0 + widths * size) - np.log1p(widths * size), axis=1)
    best = int(np.argmax(gains))
    return float(max(gains[best], 0.0)), float(np.sqrt(widths[best, 0]))
