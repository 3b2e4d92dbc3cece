"""Whether names can stand in a channel: what they leave, and whether a law without physics says more than they.

The adequacy gate asks this of every channel; nothing is decided here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from arl_fixtures.reconcile.acceptance import PRICE
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Axis, Law
from arl_fixtures.reconcile.law_fit import Chosen
from arl_fixtures.reconcile.law_search import gain_of_others, search_law
from arl_fixtures.reconcile.locate import locate
from arl_fixtures.reconcile.other_cause import OtherCauses
from arl_fixtures.reconcile.own_driver import driven_by
from arl_fixtures.reconcile.rivals import (
    BEATEN_BY,
    LEAST_Z,
    has_rings,
    is_structure,
    lies_where_names_act,
    mends_the_same,
    needed_by_law,
    plain_beyond,
)
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.step_means import (
    acts_within_steps,
    leaves_other_rows,
    leaves_what_stays,
    left_in_steps,
    tells_steps,
)
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.unit_strengths import may_differ, of_each_unit

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

LEFT_SHARE, LEFT_AT_EDGES = 0.25, 0.6
"""Largest share of a channel's mismatch that may stay predictable under a name; where names and what is left both
tell of edges, whose two sides a pixel shares by a part that no column tells."""

UNDONE = 5.0
"""Log-likelihood that names must cost a channel together for them to undo each other there."""


class _Rival(NamedTuple):
    """A law that says more than names.

    Attributes:
        law: that it is; chosen: its terms and what they gain.
        needed: what it must gain for the names to be refused if something else beside them gains so much.
    """

    law: Law
    chosen: Chosen
    needed: Callable[[float], float]


class Standing:
    """What a decision's names leave of its channels, as they are now.

    Args:
        decision: with its names, patterns and looks.
    """

    def __init__(self, decision: Decision) -> None:
        self.decision, self.problem, self.looker = decision, decision.problem, decision.found.looker
        self.causes = OtherCauses(self.looker)

    def left_share(self, name: str) -> float:
        """Share of a channel's mismatch that stays predictable."""
        left = self.decision.after[name]
        if not is_structure(left):
            d = next(d for d in self.problem.data if d.channel.name == name)
            seen = is_structure(self.decision.found.before[name])
            return left_in_steps(self.problem, d, self.decision.terms, LEFT_SHARE) if seen else 0.0
        now = self._gain_of_terms(name)
        return left.gain / max(self.decision.found.before[name].gain, left.gain + max(now, 0.0), 1.0)

    def is_left(self, d: ChannelData) -> bool:
        """Whether so much stays predictable that the names of a channel cannot stand."""
        acting = [t for t in self.decision.best.terms if d.channel.name in self.decision.energy(t)]
        same = mends_the_same(acting, self.decision.after[d.channel.name].leading())
        same = same or lies_where_names_act(self.problem, d, acting, self.decision.terms)
        small = self.left_share(d.channel.name) <= (LEFT_AT_EDGES if same else LEFT_SHARE)
        if small or self._leaves_others(d, acting):
            return False
        predictable = is_structure(self.decision.after[d.channel.name])
        return predictable or not acts_within_steps(self.problem, d, self.decision.terms)

    def told_in_steps(self, term: Term) -> set[str]:
        """Channels in which a name tells whole steps apart."""
        full = forward(self.decision.terms, self.problem.view)
        rest = forward([t for t in self.decision.terms if t is not term], self.problem.view)
        return {
            d.channel.name for d in self.problem.data
            if full[d.channel.name] is not rest[d.channel.name]
            and tells_steps(d, full[d.channel.name] - rest[d.channel.name])
        }  # fmt: skip

    def comes_and_goes(self, term: Term) -> set[str]:
        """Channels in which a name comes and goes with the steps, and what is left stays wherever the same is seen.

        These are two causes, whatever else was named of what stays.
        """
        found = set()
        for d in self.problem.data:
            rows, left = self.looker.rows_of(d), self.decision.after[d.channel.name]
            if is_structure(left) and leaves_what_stays(
                self.problem, d, self.decision.terms, term, rows, left.ceiling.prediction
            ):
                found.add(d.channel.name)
        return found

    def _leaves_others(self, d: ChannelData, acting: Sequence[Term]) -> bool:
        """Whether what names leave of a channel has another cause for sure: nothing that is left has none."""
        if not is_structure(self.decision.after[d.channel.name]):
            return False
        rows, left = self.looker.rows_of(d), self.decision.after[d.channel.name]
        apart = leaves_other_rows(self.problem, d, acting, rows, left.ceiling.prediction)
        return apart or self.causes.of(d, left, self.decision.terms, acting)

    def _gain_of_terms(self, name: str) -> float:
        """Drop of half the sum of squares of a channel that the accepted effects bring."""
        d = next(d for d in self.problem.data if d.channel.name == name)
        before = d.whiten(d.residual(self.problem.view.fresh_state()))
        after = d.whiten(d.residual(forward(self.decision.terms, self.problem.view)))
        return 0.5 * float(before @ before - after @ after)

    def is_beaten(self, d: ChannelData) -> bool:
        """Whether an empirical law explains a channel clearly better than its names; each pays for its parameters."""
        if d.channel.role is Role.SCATTER:
            return False
        acting = [t for t in self.decision.best.terms if d.channel.name in self.decision.energy(t)]
        if not acting or self._leaves_others(d, acting):
            return False
        # without the patterns: their pixels' values are read off the residual, where a law leaves them to chance
        rival = self._law_beyond(d, acting, self.decision.best.terms)
        if rival is None:
            return False
        beside = [p.term for p in self.decision.patterns if d.channel.name in p.term.variant.channels]
        # but a law that says of pixels what a pattern says better is no rival of what acts beside it
        outdone = not beside or has_rings(rival.law)
        outdone = outdone or self._law_beyond(d, acting, [*self.decision.best.terms, *beside]) is not None
        if not outdone or self.causes.of(d, self.decision.after[d.channel.name], self.decision.terms, acting):
            return False
        return not self._stands_beside(d, acting, rival)

    def _stands_beside(self, d: ChannelData, acting: Sequence[Term], rival: _Rival) -> bool:
        """Whether names do as well as a law if what the law has found beyond their own columns stands beside them.

        Not where all of the law holds in one place that no name tells: what happens there is one thing.
        """
        if {mark.column for mark in _marks_of(rival.chosen)} - {t.unit_column for t in acting}:
            return False
        own = forward(self.decision.best.terms, self.problem.view)
        others = gain_of_others(self.looker, d, own, rival.chosen, driven_by(*acting))
        return others is not None and rival.chosen.plain <= rival.needed(others)

    def undone(self, d: ChannelData) -> list[Term]:
        """Names that undo each other in a channel, which agrees better with the simulation without all of them.

        One has a side effect there that is not seen, and the next one was taken for mending it. One alone falls where
        it is just this that makes its name (`Effect.shown_by`): a second path whose way no range shows is none.
        """
        acting = [t for t in self.decision.best.terms if d.channel.name in self.decision.energy(t)]
        alone = len(acting) == 1 and acting[0].effect.shown_by is d.channel.role
        if not (alone or len(acting) > 1) or d.channel.role is Role.SCATTER:
            return []
        own = forward(self.decision.terms, self.problem.view)
        bare = forward([t for t in self.decision.terms if t not in acting], self.problem.view)
        cost = d.fit_scatter(d.residual(bare))[0] - d.fit_scatter(d.residual(own))[0]
        return acting if cost > UNDONE else []

    def instead_of(self, d: ChannelData, acting: Sequence[Term]) -> tuple[Law, float]:
        """A law in the place of names of a channel, and what it gains beyond them; nothing where it says nothing."""
        terms = self.decision.terms
        own = forward(terms, self.problem.view)
        bare = forward([t for t in terms if t not in acting], self.problem.view)
        law, chosen = self._free_law(d, bare)
        return law, chosen.plain - _worth_of(d, own, bare, acting) if chosen.z > LEAST_Z else -np.inf

    def _free_law(self, d: ChannelData, bare: State) -> tuple[Law, Chosen]:
        """The law that is found in a channel on top of a state."""
        place = locate(self.looker, d, bare)
        leading = [*(place.columns if place else []), *self.decision.leading(d)]
        return search_law(self.looker, d, bare, leading)

    def _law_beyond(self, d: ChannelData, acting: Sequence[Term], terms: Sequence[Term]) -> _Rival | None:
        """A law in the place of the acting names, beside the other terms, that does clearly better than they."""
        own = forward(terms, self.problem.view)
        bare = forward([t for t in terms if t not in acting], self.problem.view)
        law, chosen = self._free_law(d, bare)
        named = _worth_of(d, own, bare, acting)
        change = law.correction(self.looker.features, bare[d.channel.name])
        plain = plain_beyond(d, own[d.channel.name] - bare[d.channel.name], change)
        edges = lies_where_names_act(self.problem, d, acting, self.decision.terms)
        is_line = len(law.drivers) == 1 and [len(v) for v in chosen.values] == [1]

        def needed(others: float) -> float:
            return needed_by_law(named + others, plain, acting, law.drivers, at_edges=edges, is_line=is_line)

        sure = _sureness(d, bare, own) if len(acting) > 1 else np.inf
        return _Rival(law, chosen, needed) if is_rival(chosen, needed(0.0), sure) else None


def _worth_of(d: ChannelData, own: State, bare: State, acting: Sequence[Term]) -> float:
    """Log-likelihood that names gain in a channel, less the price of their parameters."""
    base = d.fit_scatter(d.residual(bare))[0]
    price = PRICE * sum(len(t.free()) for t in acting)
    named = d.fit_scatter(d.residual(own))[0] - base - price
    each = of_each_unit(d, own, bare) if all(map(may_differ, acting)) else None
    if each is None:
        return named
    # units are not alike: each may have the names in a strength of its own
    price += PRICE * (np.unique(d.unit).size - 1)
    return max(named, d.fit_scatter(d.residual(each))[0] - base - price)


def is_rival(chosen: Chosen, needed: float, sure: float = np.inf) -> bool:
    """Whether a law says something by itself, and clearly more than names do.

    A name that acts elsewhere costs a channel its price: a law of next to nothing says more there. Of what few blocks
    tell only, several names together are no surer than a law is: `sure` is their significance over blocks.
    """
    return chosen.z > min(LEAST_Z, sure) and chosen.plain > max(needed, BEATEN_BY)


def _sureness(d: ChannelData, bare: State, own: State) -> float:
    """Significance over a channel's blocks of what names gain, as that of a law is told (`Chosen.z`)."""
    before, after = (d.whiten(d.residual(state)) for state in (bare, own))
    gains = np.bincount(d.block, 0.5 * (before**2 - after**2))
    gains = gains[np.bincount(d.block) > 0]
    return float(gains.sum() / max(float(np.linalg.norm(gains - gains.mean())), 1e-300))


def _marks_of(chosen: Chosen) -> set[Axis]:
    """Categories in which every term of a law of several holds, and nowhere else."""
    products = [product for term in chosen.terms for product in (term.basis.waves or (term.basis.axes,))]
    marks = [{axis for axis in product if axis.kind == "is"} for product in products]
    return set.intersection(*marks) if len(chosen.terms) > 1 else set()
