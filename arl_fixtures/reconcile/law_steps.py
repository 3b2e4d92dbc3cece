"""What steps share by chance, and what a law may say of it: with few of them either explains the other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import stats

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law_fit import Chosen, confirm, paid
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.noise import Level
from arl_fixtures.reconcile.robust import LEAST_TAIL, log_beta


def of_few_steps(gain: float, coefficients: int, steps: Level | None) -> float:
    """What a gain of likelihood is worth where the steps' scatter is told from the very steps that a law explains.

    With n steps of unknown variance the likelihood gains n/2 ln(1 + k F/ν) for an F ratio of (k, ν = n − 1 − k)
    degrees; the chi-squared/2 of k degrees that is as unlikely is what it would be if the scatter were known.
    """
    if steps is None or steps.declared or steps.floor > 0.0 or gain <= 0.0:
        return gain
    freedom = steps.count - 1 - coefficients
    if freedom < 1:
        return 0.0
    tail = log_beta(-2.0 * gain / steps.count, 0.5 * freedom, 0.5 * coefficients)
    return -tail if tail < LEAST_TAIL else 0.5 * float(stats.chi2.isf(np.exp(tail), coefficients))


def without_chance(
    work: Work, chosen: Chosen, data: ChannelData, residual: FloatArray, changed: Callable[[Chosen], FloatArray]
) -> Chosen:
    """A law without those terms of what steps share which their scatter explains as well, beside the others.

    A law is sought with less scatter of steps than they seem to have, which a law could be. Beside a strong term of
    another kind a curve over the steps stays then, though alone it would be none.

    Args:
        work: rows and noise of the fit; chosen: its terms.
        data: the channel; residual: of its rows; changed: what terms make of the simulation there.
    """
    steps = data.level("step")
    while len(chosen.terms) > 1 and steps is not None:
        shared = [k for k, term in enumerate(chosen.terms) if work.shares(term.basis)]
        if not shared:
            break
        fits = data.fit_scatter(residual - changed(chosen))[0]
        left: list[tuple[float, int, Chosen]] = []
        for k in shared:
            term, values = chosen.terms[k], chosen.values[k]
            rest = confirm(work, [t.basis for t in chosen.terms if t is not term])
            gain = fits - data.fit_scatter(residual - changed(rest))[0]
            cost = paid(term, values) + term.basis.price
            left.append((of_few_steps(gain, len(values), steps) / chosen.scatter - cost, k, rest))
        worst = min(left)
        if worst[0] > 0.0:
            break
        chosen = worst[2]
    return chosen
