"""Laws that whitening flatters: terms that cancel within blocks, and move whole blocks by more than they are off."""

from __future__ import annotations

from collections.abc import Callable

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law_fit import Chosen, confirm
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.noise import less_constants

WORSE = 1.02
"""Ratio of the rows' weighted squares after a law and before, from which it harms."""


def harmless(
    work: Work, chosen: Chosen, data: ChannelData, residual: FloatArray, changed: Callable[[Chosen], FloatArray]
) -> Chosen:  # fmt: skip
    """The terms of a law without those with which rows agree worse than without any.

    What whole blocks share is free while terms are fitted: a curve and a step over time may cancel within each block
    and send it anywhere. As long as the rows as they are say that this harms, the term leaves whose loss mends most.

    Args:
        work: rows and noise of the fit; chosen: its terms.
        data: the channel; residual: of its rows; changed: what terms make of the simulation there.
    """

    def squares(terms: Chosen) -> float:
        rest, weight = residual - changed(terms) if terms.terms else residual, data.root_weight**2
        if data.calibrated:
            rest = less_constants(rest, data.scale, weight, data.unit, second=data.second)
        return float(weight @ rest**2)

    before = squares(Chosen())
    while chosen.terms and squares(chosen) > WORSE * before:
        bases = [t.basis for t in chosen.terms]
        chosen = min((confirm(work, [*bases[:k], *bases[k + 1 :]]) for k in range(len(bases))), key=squares)
    return chosen
