"""Candidates of a law on the rows at work, in blocks of one shape: made and weighed together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.law_evidence import Evidence
from arl_fixtures.reconcile.law_work import Candidate, Work

SHARED_PRICE = 3.0
"""Further price of what varies only from step to step."""
MOST_NUMBERS = 2_000_000
"""Numbers in the vectors of a block: all of them stay as long as a law has one of its candidates."""


@dataclass(frozen=True, slots=True)
class _Block:
    """Candidates with equally many functions, all with a prior or none.

    Attributes:
        places: in the pool, (m,); vectors: those that differ, (l, k, n); which: of them each candidate has, (m,).
        evidence: of all m.
    """

    places: list[int]
    vectors: FloatArray
    which: list[int]
    evidence: Evidence

    def weigh(self, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gains and widths beside what leaves a whitened rest."""
        return self.evidence.of((self.vectors @ rest)[self.which])


def likeliest(work: Work, left: FloatArray, bases: Iterable[Basis]) -> Basis:
    """Of bases the one that gains most beside the terms that leave `left`; the first of several."""
    return max(Candidates(work, left).add(bases), key=lambda item: item.gain).basis


class Candidates:
    """A pool of candidates in the order in which they came, each with the gain that it has when it comes.

    Args:
        work: the rows.
        left: whitened residual that they are weighed beside, that of the rows by default.
    """

    def __init__(self, work: Work, left: FloatArray | None = None) -> None:
        self.items: list[Candidate] = []
        self._work, self._left = work, work.residual if left is None else left
        self._blocks: list[tuple[_Block, tuple[FloatArray, FloatArray]]] = []

    def add(self, bases: Iterable[Basis]) -> list[Candidate]:
        """Candidates of bases, in their order."""
        bases = list(bases)
        start = len(self.items)
        shapes: dict[tuple[int, bool], list[int]] = {}
        for place, basis in enumerate(bases):
            shapes.setdefault((basis.count, basis.prior is None), []).append(place)
        made: dict[int, Candidate] = {}
        for places in self._parts(shapes):
            alike = [bases[p] for p in places]
            distinct = {(b.axes, b.waves): b for b in alike}  # curves of two smoothnesses are the same functions
            order = {functions: k for k, functions in enumerate(distinct)}
            which = [order[b.axes, b.waves] for b in alike]
            vectors, gram = self._work.together(list(distinct.values()))
            block = _Block([start + p for p in places], vectors, which, Evidence(gram[which], _priors(alike)))
            gains, widths = first = block.weigh(self._left)
            self._blocks.append((block, first))
            for p, k, gain, width in zip(places, which, gains.tolist(), widths.tolist(), strict=True):
                made[p] = Candidate(
                    basis=bases[p], vectors=vectors[k], gram=gram[k], gain=gain - bases[p].price, width=width
                )
        self.items += [made[place] for place in range(len(bases))]
        return self.items[start:]

    def _parts(self, shapes: dict[tuple[int, bool], list[int]]) -> Iterator[list[int]]:
        for (count, _), places in shapes.items():
            most = max(MOST_NUMBERS // (count * len(self._left)), 1)
            for start in range(0, len(places), most):
                yield places[start : start + most]

    def weigh(self, rest: FloatArray) -> tuple[list[float], list[float]]:
        """Gains, before their price, and widths of all candidates beside what leaves a whitened rest."""
        gains, widths = np.zeros(len(self.items)), np.zeros(len(self.items))
        for block, first in self._blocks:
            gains[block.places], widths[block.places] = first if rest is self._left else block.weigh(rest)
        return gains.tolist(), widths.tolist()


def _priors(bases: Sequence[Basis]) -> FloatArray | None:
    priors = [basis.prior for basis in bases if basis.prior is not None]
    return np.stack(priors) if priors else None


def shared_price(work: Work, columns: tuple[str, ...]) -> float:
    """Further price of what varies only from step to step: few witnesses, and many columns that follow them."""
    return SHARED_PRICE if work.is_shared(columns) else 0.0


def varied(ranked: Sequence[Candidate], most: int = 4) -> list[Candidate]:
    """Strongest functions of a column, one of a kind, the line always among them."""
    kinds: set[str] = set()
    kept: list[Candidate] = []
    for item in ranked:
        kind = item.basis.axes[0].kind
        if (kind not in kinds or kind == "is") and (len(kept) < most or kind in {"linear", "ratio", "parity"}):
            kinds.add(kind)
            kept.append(item)
    return kept
