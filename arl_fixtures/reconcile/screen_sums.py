"""Sums that score a screen's candidates: per unit and for all, their amplitudes within bounds, and chance's part."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import Variant


class UnitSums:
    """Products of tangents with each other, with the residual and with draws of noise, over each unit's rows."""

    def __init__(
        self, residual: FloatArray, unit: IntArray, count: int, noise: NDArray[np.float32] | None = None
    ) -> None:
        order = np.argsort(unit, kind="stable")
        self._order = None if np.array_equal(order, np.arange(len(order))) else order
        self._residual = residual if self._order is None else residual[order]
        self._noise = noise  # any order of its rows is as good a draw
        ends = np.cumsum(np.bincount(unit, minlength=count))  # of a unit that no channel at work has, no rows
        self._parts = [slice(start, end) for start, end in itertools.pairwise([0, *ends.tolist()])]

    def __call__(self, tangents: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
        """Matrix of the tangents' products, and scores, of each unit."""
        rows = tangents if self._order is None else tangents[:, self._order]
        parts = [(rows[:, part], self._residual[part]) for part in self._parts]
        return [own @ own.T for own, _ in parts], [own @ residual for own, residual in parts]

    def by_chance(self, tangents: FloatArray) -> list[FloatArray]:
        """Scores of each unit on each draw of noise, shape (draws, amplitudes)."""
        if self._noise is None:
            return []
        rows = (tangents if self._order is None else tangents[:, self._order]).T.astype(np.float32)
        return [np.asarray(self._noise[:, part] @ rows[part], dtype=np.float64) for part in self._parts]


def choices_of(
    grams: list[FloatArray], scores: list[FloatArray], labels: tuple[str, ...]
) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """All units together, then each where there are several: label, products and scores."""
    yield "", np.sum(grams, axis=0), np.sum(scores, axis=0)
    if len(labels) > 1:
        yield from zip(labels, grams, scores, strict=True)


def solve_amplitudes(gram: FloatArray, score: FloatArray, variant: Variant) -> tuple[FloatArray, float]:
    """Amplitudes (typical sizes from null) within their one-sided bounds, and the log-likelihood gained."""
    amplitudes = [p for p in variant.amplitudes() if not p.per]
    free = np.diag(gram) > 1e-9
    result = np.zeros(len(amplitudes))
    for _ in range(len(amplitudes)):
        if not free.any():
            return np.zeros(len(amplitudes)), 0.0
        block = gram[np.ix_(free, free)]
        block = block + np.eye(len(block)) * 1e-9 * np.trace(block)
        result = np.zeros(len(amplitudes))
        result[free] = np.linalg.solve(block, score[free])
        wrong = np.array([
            (p.null is not None)
            and (((p.low >= p.null) and x * p.typical < 0) or ((p.high <= p.null) and x * p.typical > 0))
            for p, x in zip(amplitudes, result, strict=True)
        ])  # fmt: skip
        if not wrong.any():
            break
        free &= ~wrong
        result[wrong] = 0.0
    gain = float(result @ score) - 0.5 * float(result @ gram @ result)
    return result, max(gain, 0.0)


def by_chance(scores: FloatArray, gram: FloatArray) -> FloatArray:
    """Log-likelihood that amplitudes gain on draws of noise with these scores."""
    good = np.diag(gram) > 1e-9
    if not good.any():
        return np.zeros(len(scores))
    scores = scores[:, good]
    block = gram[np.ix_(good, good)]
    block = block + np.eye(len(block)) * 1e-9 * np.trace(block)
    return np.asarray(0.5 * np.einsum("dk,kd->d", scores, np.linalg.solve(block, scores.T)))
