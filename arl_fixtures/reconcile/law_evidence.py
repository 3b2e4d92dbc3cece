"""Marginal likelihood of candidates of a law: those with equally many coefficients are weighed together."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray

WIDTHS = np.geomspace(0.1, 1e4, 26)
"""Squared widths of a prior that are tried, in units of what the strongest direction of the functions tells."""
LEAST_POWER = 1e-9


class Evidence:
    """Gain of coefficients over none, at the best width of their prior.

    What does not depend on the residual is worked out once.

    Args:
        gram: products of the functions, shape (m, k, k).
        prior: covariances of the coefficients up to their width, (m, k, k); None for free coefficients.
    """

    def __init__(self, gram: FloatArray, prior: FloatArray | None) -> None:
        self._gram, self._free = gram, prior is None
        if prior is None:
            power = np.diagonal(gram, axis1=1, axis2=2)
            self._known = np.all(power > LEAST_POWER, axis=1)
            self._width = np.where(self._known, np.inf, 0.0)
            return
        root = np.linalg.cholesky(prior + 1e-9 * np.eye(prior.shape[1]))
        self._root = root.swapaxes(1, 2)
        size, turn = np.linalg.eigh(self._root @ gram @ root)
        size, self._turn = np.maximum(size, 0.0), turn.swapaxes(1, 2)
        self._known = size[:, -1] > LEAST_POWER
        self._widths = WIDTHS / np.where(self._known, size[:, -1], 1.0)[:, None]
        spread = self._widths[:, :, None] * size[:, None, :]
        self._beside, self._cost = 1.0 + spread, np.log1p(spread)

    def of(self, score: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gains and widths, (m,) each, from the products of the functions with a residual, (m, k)."""
        if self._free:
            return self._of_free(score), self._width
        push = (self._turn @ (self._root @ score[:, :, None]))[:, None, :, 0] ** 2
        gains = 0.5 * np.sum(self._widths[:, :, None] * push / self._beside - self._cost, axis=2)
        rows, best = np.arange(len(gains)), np.argmax(gains, axis=1)
        gain = np.where(self._known, np.maximum(gains[rows, best], 0.0), 0.0)
        return gain, np.where(self._known, np.sqrt(self._widths[rows, best]), 0.0)

    def _of_free(self, score: FloatArray) -> FloatArray:
        gain = np.zeros(len(score))
        if score.shape[1] == 1:
            one = score[self._known, 0]
            gain[self._known] = 0.5 * (one * (one / self._gram[self._known, 0, 0]))
            return gain
        for k in np.flatnonzero(self._known):
            gain[k] = 0.5 * float(score[k] @ np.linalg.lstsq(self._gram[k], score[k], rcond=1e-10)[0])
        return gain


def evidence(gram: FloatArray, score: FloatArray, prior: FloatArray | None) -> tuple[float, float]:
    """Gain of marginal likelihood of coefficients with a prior covariance at its best width, and that width."""
    gain, width = Evidence(gram[None], None if prior is None else prior[None]).of(score[None])
    return float(gain[0]), float(width[0])
