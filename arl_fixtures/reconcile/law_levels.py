"""What a law leaves to the steps' own scatter though its columns say it, too.

What steps share is free while a law is fitted, and of a large effect that varies mostly from step to step the law may
say the part within steps alone: the likelihood gives the rest to the steps' scatter, which costs less than a curve of
many coefficients. An unseen step then lacks that part. Whether the columns tell it unseen steps know.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.law_fit import Chosen, confirm, each_fold
from arl_fixtures.reconcile.law_search import settled
from arl_fixtures.reconcile.law_work import ALL_ROWS, Work
from arl_fixtures.reconcile.noise import less_constants
from arl_fixtures.reconcile.pilot import Looker

SHARES = (0.3, 0.1, 0.03)
"""Shares of the steps' scatter beside a law with which it is fitted anew."""
CLOSER = 0.7
"""Ratio of the squares on rows of unseen blocks below which the law of less scatter of steps is the better one."""
ALL_OF_THEM = 1.5
"""Significance over blocks that they are less: not one of them alone."""


def told_closer(looker: Looker, data: ChannelData, state: State, law: Law, chosen: Chosen) -> Law:
    """The law, or one of the same terms that foretells rows of unseen blocks, as they are, clearly better.

    Args:
        looker: of the problem; data: the channel; state: corrected simulation that the law was found on.
        law, chosen: what was found; what it gains stays as it was told.
    """
    if not chosen.terms or data.level("step") is None:
        return law
    corrected = state[data.channel.name] + law.correction(looker.features, state[data.channel.name])
    _, tau = data.fit_scatter(data.measured - data.expect * corrected[data.use])
    bases = [t.basis for t in chosen.terms]
    least, best = CLOSER, law
    if not tau.get("step", 0.0) > 0.0:
        return law
    work = Work(data, state, looker.features, tau, ALL_ROWS)
    same = confirm(work, bases)  # what is compared is whitened alike
    if len(same.terms) < len(bases):
        return law
    before = _squares(work, same)
    for share in SHARES:
        tighter = Work(data, state, looker.features, {**tau, "step": share * tau["step"]}, ALL_ROWS)
        trial, found = settled(tighter, data, state, looker, bases)
        if len(found.terms) < len(bases):
            continue
        after = _squares(tighter, found)
        ratio, less = float(after.sum() / before.sum()), before - after
        if ratio < least and less.sum() > ALL_OF_THEM * float(np.sqrt(less @ less)):
            least = ratio
            best = replace(trial, drivers=law.drivers, law_gain=law.law_gain, gain=law.gain, confirmed=law.confirmed)
    return best


def _squares(work: Work, chosen: Chosen) -> FloatArray:
    """Squares of what each block's rows, in their own standard errors, differ from what the other folds say."""
    rows = [work.raw(t.basis) for t in chosen.terms]
    vectors, told = np.concatenate(rows), np.zeros(len(work.pick))
    for fold, values in each_fold(work, chosen.terms):
        told[fold] = values @ vectors[:, fold]
    rest = work.bare - told
    if work.data.calibrated:
        scale = work.data.scale[work.pick] * work.data.root_weight[work.pick]
        rest = less_constants(rest, scale, np.ones(len(rest)), work.unit, second=None)
    return np.asarray(np.bincount(work.block, rest**2))
