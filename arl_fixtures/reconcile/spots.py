"""Several spots in the place of a pattern of all pixels: dirt in more than one place, where one spot says too little.

The search takes one effect after the other, and each must do better than a scatter of the pixels' gains. One of two
alike spots does not: the other one keeps that scatter as wide as it was. Here they are added as if pixels were all
alike, as many as help, and then judged together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arl_fixtures.reconcile.acceptance import worth
from arl_fixtures.reconcile.fit import Fit, finish, fit, within_reach
from arl_fixtures.reconcile.patterns import Pattern
from arl_fixtures.reconcile.ranking import polished
from arl_fixtures.reconcile.screen import screen
from arl_fixtures.reconcile.small_problem import pixels_alike

if TYPE_CHECKING:
    from arl_fixtures.reconcile.search import Search

MOST_SPOTS = 4


def spots_instead(search: Search, base: Fit, pattern: Pattern, threshold: float) -> Fit | None:
    """The base with spots beside its terms, where they say what a pattern says; None where they do not.

    Args:
        search: with its problems and variants; base: what stands on all rows.
        pattern: over the pixels, that stands beside it.
        threshold: log-likelihood that all of them must gain, the price of their parameters and places paid.
    """
    channels = set(pattern.term.variant.channels)
    variants = [(e, v) for e, v in search.variants if e.several and channels & set(v.channels)]
    terms, best, most = base.terms, None, threshold
    for number in range(MOST_SPOTS if variants else 0):
        with pixels_alike(search.small):
            found = [c for c in screen(search.small, variants, terms).candidates if not c.term.unit]
            if not found:
                break
            terms = fit(search.small, (*terms, within_reach(search.small, terms, found[0].term)), rounds=8).terms
        trial = polished(search.full, base, found[0], terms, rounds=4)
        gain = trial.gain - sum(search.surcharge.of(term) for term in trial.fit.terms[len(base.terms) :])
        if gain > most:
            best, most = trial.fit, gain
        elif number and gain <= 0.0:
            break
    return None if best is None else without_idle(search, best, len(base.terms))


def without_idle(search: Search, best: Fit, first: int) -> Fit:
    """A fit without those of its spots, from the term `first` on, that no longer pay for themselves, the least first.

    A spot that was tried while the ones before it had not come to rest is paid by what these gain meanwhile.
    """
    while len(best.terms) > first + 1:
        gains = []
        for index in range(first, len(best.terms)):
            rest = tuple(t for k, t in enumerate(best.terms) if k != index)
            without = finish(search.full, fit(search.full, rest, rounds=3))
            gains.append((worth(best, without) - search.surcharge.of(best.terms[index]), index, without))
        weakest = min(gains, key=lambda item: item[0])
        if weakest[0] > 0.0:
            break
        best = weakest[2]
    return best
