"""When two names are too alike to choose between on what a table shows."""

import numpy as np

from arl_fixtures.reconcile.acceptance import PRICE
from arl_fixtures.reconcile.effect import Effect
from arl_fixtures.reconcile.fit import Fit
from arl_fixtures.reconcile.terms import Term

TWIN_GAIN, TWIN_SHARE = 3.0, 0.03
"""An alternative that loses less than this (log-likelihood, or share of the finding's gain) cannot be told apart."""
LIKE_SHARE = 0.12
"""The share for effects that are known to be alike: a real one's shape differs from the library's by such a part."""
EDGE_SHARE = 0.3
"""The share for effects that show at edges, where these are known from the table's own samples only: what the
operators themselves get wrong there is more than what tells them apart."""
IDLE = 1.0
"""Standard errors that all rows together change by over a parameter's range, below which it tells of nothing."""


def is_undecided(named: Term, other: Term, deficit: float, gain: float, *, sampled: bool) -> bool:
    """Whether another term in a finding's place cannot be told from it.

    That a law is the simpler one does not rule out another that is alike: then only how well they fit counts.

    Args:
        named: the finding's term.
        other: the term that was fitted in its place.
        deficit: by how much the other gains less, after both were charged for their parameters; log-likelihood.
        gain: what the finding gains after its charge; log-likelihood.
        sampled: whether the scene is known from the table's own samples only.
    """
    shape = share_undecided(named.effect, other.effect, sampled=sampled) * gain
    if not alike(named.effect, other.effect):
        return deficit < max(TWIN_GAIN, shape)
    extra = PRICE * max(len(other.free()) - len(named.free()), 0)
    return deficit - extra < TWIN_GAIN + shape  # chance comes on top of what their shapes get wrong


def idle_price(named: Term, other: Fit) -> float:
    """What the term of a fit was charged for shapes that change next to nothing here, beyond what the finding has.

    Of effects that are alike no further parameter counts any way, see `is_undecided`.
    """
    term, last = other.terms[-1], len(other.terms) - 1
    further = max(len(term.free()) - len(named.free()), 0)
    if not further or alike(named.effect, term.effect):
        return 0.0
    changes = zip(other.keys, np.linalg.norm(other.jacobian, axis=0), strict=True)
    idle = sum(
        index == last and not p.is_amplitude and float(change) * (p.high - p.low) < IDLE
        for (index, p), change in changes
    )
    return PRICE * min(further, idle)


def reason_of(deficit: float, gain: float, *, alike: bool) -> str:
    """What another effect in a finding's place loses, and why that may not decide."""
    text = f"loses {deficit:.1f} of {gain:.1f} in log-likelihood"
    if not alike or deficit < TWIN_GAIN:
        return text
    return f"{text}, {100.0 * deficit / gain:.0f} %: a real effect may miss its own law by as much"


def share_undecided(named: Effect, other: Effect, *, sampled: bool) -> float:
    """Share of a finding's gain that another effect may lose without being told apart."""
    if sampled and all(e.displaces or e.mixes for e in (named, other)):
        return EDGE_SHARE
    return LIKE_SHARE if alike(named, other) else TWIN_SHARE


def alike(named: Effect, other: Effect) -> bool:
    """Whether one of two effects says that it is like the other."""
    return other.id in named.confusable or named.id in other.confusable
