"""Candidates of a law on the rows at work, in blocks of one shape: made and weighed together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.law_evidence import Evidence
from arl_fixtures.reconcile.law_work import Candidate, Work


@dataclass(frozen=True, slots=True)
class _Block:
    """Candidates with equally many functions, all with a prior or none: places in the pool, vectors (m, k, n)."""

    places: list[int]
    vectors: FloatArray
    evidence: Evidence


class Candidates:
    """A pool of candidates in the order in which they came, each with the gain that it has by itself.

    Args:
        work: the rows.
    """

    def __init__(self, work: Work) -> None:
        self.items: list[Candidate] = []
        self._work = work
        self._blocks: list[_Block] = []

    def add(self, bases: Iterable[Basis]) -> list[Candidate]:
        """Candidates of bases, in their order."""
        bases = list(bases)
        start = len(self.items)
        shapes: dict[tuple[int, bool], list[int]] = {}
        for place, basis in enumerate(bases):
            shapes.setdefault((basis.count, basis.prior is None), []).append(place)
        made: dict[int, Candidate] = {}
        for places in shapes.values():
            alike = [bases[place] for place in places]
            vectors, gram = self._work.together(alike)
            block = _Block([start + place for place in places], vectors, Evidence(gram, _priors(alike)))
            self._blocks.append(block)
            gains, widths = block.evidence.of(vectors @ self._work.residual)
            for k, place in enumerate(places):
                made[place] = Candidate(
                    basis=bases[place], vectors=vectors[k], gram=gram[k],
                    gain=float(gains[k]) - bases[place].price, width=float(widths[k]),
                )  # fmt: skip
        self.items += [made[place] for place in range(len(bases))]
        return self.items[start:]

    def weigh(self, rest: FloatArray) -> tuple[list[float], list[float]]:
        """Gains, before their price, and widths of all candidates beside what leaves a whitened rest."""
        gains, widths = np.zeros(len(self.items)), np.zeros(len(self.items))
        for block in self._blocks:
            gains[block.places], widths[block.places] = block.evidence.of(block.vectors @ rest)
        return gains.tolist(), widths.tolist()


def _priors(bases: Sequence[Basis]) -> FloatArray | None:
    priors = [basis.prior for basis in bases if basis.prior is not None]
    return np.stack(priors) if priors else None
