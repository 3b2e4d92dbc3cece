"""Choose the terms of an empirical law: one by one while unseen blocks gain, simple ones before exact ones.

All candidates are judged by the same measure: the marginal likelihood of the whitened residual with the width of the
candidate's coefficients at its best, less a price for having been chosen among so many. A line, a curve and a map
thus compete on equal terms. What is accepted is fitted jointly, and every term must predict blocks that took no part
in its fit.
"""

from __future__ import annotations

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law_basis import Basis, is_order, is_proxy
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_evidence import evidence
from arl_fixtures.reconcile.law_fit import Chosen, holds_between, joint
from arl_fixtures.reconcile.law_work import Candidate, Work
from arl_fixtures.reconcile.roles import Role, role_of

MOST_TERMS = 5
"""Terms of a law."""
CLOSE, CLOSE_SHARE = 2.0, 0.03
"""Of candidates that differ by less (log-likelihood, or share of the best) the simplest is taken."""
STANDS_FOR_ALL = 4
"""How many functions more a law must ask to be believed before an order of the measurement is the simpler one."""
LEAST_GAIN, FURTHER_GAIN, FURTHER_SHARE = 1.0, 4.0, 0.01
"""Log-likelihood that the first term and further ones must gain on unseen blocks, and its share of what is gained."""
MOST_JUDGED = 16
"""Candidates of a round that are judged on all rows: those that rank first on a part of them."""
MOST_FAILED = 3
"""Times that the best candidates of all may fail on unseen blocks before a search ends."""
SET_MEANWHILE = 0.9
"""Share of what a law of an order foretells from which one of what was set in that order is the law."""
FEW_COEFFICIENTS = 4
"""Coefficients that it may have if the law of an order has fewer: as many as there are steps tell anything."""
FURTHER_EVIDENCE = 6.0
"""What a further term must earn beyond its price: of hundreds beside a good first one some earn a little."""


def find_terms(work: Work, pool: Candidates, whole: Work | None = None) -> Chosen:
    """Forward selection from a pool; the joint fit and what unseen blocks say of it.

    Where a law says when something was measured, and what was set meanwhile says nearly as much, that is the law.

    Args:
        work: the rows of the pool's vectors, on which its candidates are ranked.
        pool: candidates.
        whole: the rows on which they are judged and fitted, if these are more.
    """
    found = _forward(work, pool, whole or work, frozenset())
    if not any(is_order(name) for term in found.terms for name in term.basis.columns):
        return found
    orders = frozenset(k for k, item in enumerate(pool.items) if any(map(is_order, item.basis.columns)))
    timeless = _forward(work, pool, whole or work, orders)
    as_simple = _coefficients(timeless) <= max(_coefficients(found), FEW_COEFFICIENTS)
    return timeless if as_simple and timeless.held > SET_MEANWHILE * found.held else found


def _coefficients(chosen: Chosen) -> int:
    return sum(len(values) for values in chosen.values)


def _forward(work: Work, pool: Candidates, whole: Work, without: frozenset[int]) -> Chosen:
    own = f"sim_{work.data.channel.name}"
    chosen, left = Chosen(left=whole.residual), work.residual
    judged = _Judged(work, whole, pool)
    judged.tried |= without
    ranked: list[int] = []
    failed = 0
    while len(chosen.terms) < MOST_TERMS:
        least = FURTHER_EVIDENCE if chosen.terms else 0.0
        offers = judged.offers(left, chosen.left, least)
        if not offers:
            break
        best = max(offers)[0]
        near = [k for gain, k in offers if gain > best - max(CLOSE, CLOSE_SHARE * best)]
        accepted, between = None, False
        for k in sorted(near, key=lambda k: (_complexity(pool.items[k].basis, own), -judged.items[k].gain))[:4]:
            judged.tried.add(k)
            trial = joint(whole, [*chosen.terms, judged.items[k]])
            further = max(FURTHER_GAIN, FURTHER_SHARE * chosen.held) if chosen.terms else LEAST_GAIN
            if trial.beyond(chosen) > further:
                if holds_between(whole, chosen, trial):
                    accepted = trial
                    ranked.append(k)
                    break
                between = True
        if accepted is not None:
            chosen, failed = accepted, 0
            left = work.residual - sum(v @ pool.items[k].vectors for v, k in zip(chosen.values, ranked, strict=True))
        elif between or failed < MOST_FAILED:
            failed += not between  # what fits best but foretells nothing gives way to the next best
        else:
            break
    return chosen


class _Judged:
    """Candidates ranked on a part of the rows, the best of them judged on all."""

    def __init__(self, work: Work, whole: Work, pool: Candidates) -> None:
        self.whole, self.pool, self.alike = whole, pool, whole is work
        self.ratio = len(whole.pick) / len(work.pick)
        self.items: dict[int, Candidate] = dict(enumerate(pool.items)) if self.alike else {}
        self.tried: set[int] = set()

    def offers(self, part: FloatArray, left: FloatArray, least: float) -> list[tuple[float, int]]:
        """Gains above the least, and whose; `part` and `left` are the whitened rests on the two sets of rows."""
        offers: list[tuple[float, int]] = []
        for k, (item, gain, width) in enumerate(zip(self.pool.items, *self.pool.weigh(part), strict=True)):
            if k not in self.tried:
                item.gain, item.width = self.ratio * gain - item.basis.price, width
                offers.append((item.gain, k))
        if not self.alike:
            first = [k for _, k in sorted(offers, reverse=True)[:MOST_JUDGED]]
            offers = []
            new = [k for k in first if k not in self.items]
            made = Candidates(self.whole, left).add(self.pool.items[k].basis for k in new)
            self.items.update(zip(new, made, strict=True))
            for k in first:
                item = self.items[k]
                gain, item.width = evidence(item.gram, item.vectors @ left, item.basis.prior)
                item.gain = gain - item.basis.price
                offers.append((item.gain, k))
        return [offer for offer in offers if offer[0] > least]


def _complexity(basis: Basis, own: str) -> int:
    """How much a term asks to be believed: functions, factors, and columns that only stand for a physical one.

    Light and range act on each other; any other simulated channel than the law's `own` only goes along with it. An
    order goes along with all that was set in it.
    """
    proxies = sum(
        STANDS_FOR_ALL if is_order(c) else 1 if c == own or _acts(c) else 2 for c in basis.columns if is_proxy(c)
    )
    if basis.waves:
        return 1 + len(basis.waves) + proxies
    places = sum(axis.is_open for axis in basis.axes)
    plain = sum(
        not axis.is_open and axis.kind not in {"linear", "ratio", "is", "parity", "inverse"} for axis in basis.axes
    )
    return 4 * places + plain + len(basis.axes) + proxies


def _acts(column: str) -> bool:
    """Whether a column is a simulated signal or range."""
    return column.startswith("sim_") and role_of(column.removeprefix("sim_")) in {Role.INTENSITY, Role.DISTANCE}
