"""Names about the threshold: one that came near stands for a law, one that is just beyond does not beside others.

That something is missing in a channel and what it is are two questions. A physics-free look answers the first; where
it says yes, an effect of the library needs less evidence of its own than one that must answer both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from arl_fixtures.reconcile.acceptance import Ranked, evidence, is_as_good, simplest
from arl_fixtures.reconcile.gate import drop_fallen
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.own_driver import driven_by
from arl_fixtures.reconcile.rivals import OF_BEARINGS
from arl_fixtures.reconcile.roles import told_by
from arl_fixtures.reconcile.search import LEVEL_NAME
from arl_fixtures.reconcile.terms import Term
from arl_fixtures.reconcile.what_is_left import find_laws

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

NEAR = 0.9
"""Share of the threshold that is asked of an effect whose channel is known to differ."""


def name_near_miss(decision: Decision) -> bool:
    """Take the best effect that all but reached the threshold, if with it nothing is left; tells whether it did."""
    if decision.best.terms or decision.patterns or not decision.found.stages:
        return False
    chosen = _nearest(decision)
    if chosen is None:
        return False
    before = decision.best, decision.laws, dict(decision.after)
    decision.keep([chosen.fit.terms[-1]])
    decision.laws = []
    decision.look()
    if not drop_fallen(decision):
        find_laws(decision)
        if not decision.laws:
            return True
    decision.best, decision.laws, decision.after = before
    decision.patterns = []
    return False


def drop_doubtful(decision: Decision) -> bool:
    """Drop a lone name that all free looks of chance could give where its channels hold more than it; tells if so.

    A table without a mismatch is what the first name is measured by: one with a pattern of pixels is none.
    """
    stages, chance = decision.found.stages, decision.found.screening
    if len(decision.best.terms) != 1 or not stages or chance is None:
        return False
    term = decision.best.terms[0]
    others = {c for p in decision.patterns for c in p.term.variant.channels} | {law.channel for law in decision.laws}
    sure = [
        evidence(r, decision.search.surcharge) for r in stages[0].ranked
        if r.fit.terms[-1].effect is term.effect
    ]  # fmt: skip
    if not others & set(term.variant.channels) or max(sure, default=0.0) > chance.threshold(LEVEL_NAME):
        return False
    decision.keep([])
    return True


def _nearest(decision: Decision) -> Ranked | None:
    search, stage = decision.search, decision.found.stages[0]
    near = [
        r for r in search.nameable(stage.base, stage.ranked)
        if evidence(r, search.surcharge) > NEAR * stage.threshold
        and any(_is_of(law, r.fit.terms[-1]) for law in decision.laws)
    ]  # fmt: skip
    return min((r for r in near if is_as_good(r, near[0])), key=simplest, default=None)


def _is_of(law: Law, term: Term) -> bool:
    """Whether a law tells of what drives an effect, in a channel in which it acts."""
    known = driven_by(term) | ({told_by(c) for c in OF_BEARINGS} if term.effect.displaces else set())
    return bool(law.terms) and law.channel in term.variant.channels and {told_by(c) for c in law.drivers} <= known
