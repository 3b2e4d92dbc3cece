"""Verdicts and their algebra: the worst of several decides."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Final


class Verdict(StrEnum):
    """What is said of a measurement, a step or a cycle.

    PASS: conformity is shown. CONDITIONAL: neither conformity nor its contrary is shown, or a minor limit is
    exceeded. NOT_RUN: it was never attempted. INVALID: it was attempted and cannot be trusted. FAIL: the limit is
    exceeded.
    """

    PASS = "PASS"
    CONDITIONAL = "CONDITIONAL"
    NOT_RUN = "NOT_RUN"
    INVALID = "INVALID"
    FAIL = "FAIL"

    @property
    def badness(self) -> int:
        """Rank in the order PASS < CONDITIONAL < NOT_RUN < INVALID < FAIL: what is known outranks what is not."""
        return _RANK[self]

    def __or__(self, other: Verdict) -> Verdict:
        """The worse of the two."""
        return self if self.badness >= other.badness else other


_RANK: Final = {verdict: rank for rank, verdict in enumerate(Verdict)}


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The worst of all; NOT_RUN where there is none, because nothing was shown."""
    ranked = sorted(verdicts, key=lambda verdict: verdict.badness)
    return ranked[-1] if ranked else Verdict.NOT_RUN
