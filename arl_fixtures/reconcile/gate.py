"""The adequacy gate: a name stands only if, with it, the columns predict next to nothing of what is left.

A wrong name is worse than none. What would fall is first tried with the freedom that its effect has besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.acceptance import TWIN_GAIN, worth
from arl_fixtures.reconcile.consequences import read_alike
from arl_fixtures.reconcile.fit import finish, fit
from arl_fixtures.reconcile.in_place import charged, others_in_place, without_name
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.patterns_beside import add_patterns
from arl_fixtures.reconcile.rivals import plain_gain
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.steadiness import is_asked, is_unsteady
from arl_fixtures.reconcile.terms import Term, default_values, forward
from arl_fixtures.reconcile.told_apart import LIKE_SHARE

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

LEAST_BESIDE = 5.0
"""Log-likelihood, less its price, that a name must gain beside the law of what else is in its channel."""
LEAST_OUTSIDE = 4.0
"""Log-likelihood that a name must gain in channels where it stands, to stand though it does not in others."""


def drop_fallen(decision: Decision) -> bool:
    """Drop the names of channels in which too much stays predictable, or which a law without physics beats.

    And names whose strength is another one under other conditions, errors of readings that several show alike,
    and names that undo each other. Tells whether any fell.
    """
    if not decision.best.terms:
        return False
    bad = {d.channel.name for d in decision.problem.data if decision.standing.is_left(d)}
    bad |= {
        d.channel.name for d in decision.problem.data if d.channel.name not in bad and decision.standing.is_beaten(d)
    }
    unsteady = [t for t in decision.best.terms if is_unsteady(decision.found.looker, decision.terms, t)]
    alike = read_alike(decision.best.terms, decision.problem.view)
    undone = {d.channel.name: decision.standing.undone(d) for d in decision.problem.data}
    void = [t for t in decision.best.terms if any(t in terms for terms in undone.values())]
    gone = (*unsteady, *alike, *void)
    # beside names that fall for reasons of their own what is left tells nothing yet
    spares = decision.standing.told_in_steps if gone else decision.standing.comes_and_goes
    kept = tuple(
        t for t in decision.best.terms
        if t not in gone and not (bad and _mostly_in(decision, t, bad - spares(t)))
    )  # fmt: skip
    if len(kept) == len(decision.best.terms):
        return False
    if _widen(decision, kept) or _exchange(decision, unsteady):
        return True
    mismatches = [_mismatch_of(decision, t) for t in gone]
    decision.fallen |= {name: law for name, law in mismatches if not undone[name]}
    decision.refused |= {t.effect.id for t in unsteady}
    for d in decision.problem.data:
        d.follow(forward(kept, decision.problem.view))
    decision.keep(kept)
    # a name may only have mended one that does not stand
    decision.best = decision.search.prune(decision.best, decision.found.screening)
    _with_patterns_anew(decision)
    return True


def drop_needless(decision: Decision) -> bool:
    """Drop names that tell next to nothing beside the laws of their channels, whose change they had a little of.

    Tells whether any fell: the laws are then to be found anew.
    """
    lawful = {law.channel for law in decision.laws}
    acting = [t for t in decision.best.terms if lawful & set(t.variant.channels)]
    needless = [t for t in acting if _gain_beside_laws(decision, t) < LEAST_BESIDE]
    if not needless:
        return False
    decision.keep([t for t in decision.best.terms if t not in needless])
    return True


def _gain_beside_laws(decision: Decision, term: Term) -> float:
    """What a name gains beside all else that was found, less the price of its parameters."""
    own, rest = decision.final_state(), decision.final_state(without=term)
    changed = [d for d in decision.problem.data if own[d.channel.name] is not rest[d.channel.name]]
    gains = (d.fit_scatter(d.residual(own))[0] - d.fit_scatter(d.residual(rest))[0] for d in changed)
    return charged(term, sum(gains))


def _widen(decision: Decision, kept: Sequence[Term]) -> bool:
    """Give a name that would fall the freedom that its effect has besides; tells whether it gains by it."""
    for index, term in enumerate(decision.best.terms):
        if term in kept:
            continue
        for variant in term.effect.wider(term.variant, decision.problem.view):
            wide = replace(term, variant=variant, values={**default_values(variant), **term.values})
            terms = tuple(wide if k == index else t for k, t in enumerate(decision.best.terms))
            found = finish(decision.problem, fit(decision.problem, terms, rounds=8))
            if worth(found, finish(decision.problem, decision.best)) > TWIN_GAIN:
                decision.best = found
                _with_patterns_anew(decision)
                return True
    return False


def _exchange(decision: Decision, unsteady: Sequence[Term]) -> bool:
    """Put what cannot be told from an unsteady name, and is steady, in its place; tells whether it did.

    A name alone: among several an unsteady one shows that it is not these.
    """
    if len(decision.best.terms) != 1 or not unsteady:
        return False
    decision.refused.add(unsteady[0].effect.id)
    without, gain = without_name(decision, 0)
    for ranked, deficit, alike in others_in_place(decision, 0, without, gain):
        other, beside = ranked.fit.terms[-1], [*ranked.fit.terms, *(p.term for p in decision.patterns)]
        alike = alike and -deficit < max(TWIN_GAIN, LIKE_SHARE * gain)  # what says far more is another mismatch
        if not alike or ranked.gain <= 0.0 or other.effect.id in decision.refused or not is_asked(other):
            continue
        if not is_unsteady(decision.found.looker, beside, other):
            decision.best = finish(decision.problem, ranked.fit)
            _with_patterns_anew(decision)
            return True
    return False


def _with_patterns_anew(decision: Decision) -> None:
    """Patterns were found beside names that do not stand any more."""
    decision.patterns = []
    decision.look()
    add_patterns(decision)


def _mismatch_of(decision: Decision, term: Term) -> tuple[str, Law]:
    """Channel that a term moves most, and a law without terms: what passed for a name is a mismatch for sure."""
    energy = decision.energy(term)
    name = max(energy, key=lambda n: energy[n], default=term.variant.channels[0])
    drivers = [c for c in term.variant.drivers if c in decision.found.looker.features] or list(term.variant.drivers)
    relative = any(d.channel.name == name and d.channel.role is not Role.DISTANCE for d in decision.problem.data)
    gain = plain_gain(decision.problem, decision.best.terms, term)
    return name, Law(channel=name, relative=relative, terms=[], drivers=drivers, gain=gain)


def _mostly_in(decision: Decision, term: Term, names: set[str]) -> bool:
    """Whether a name acts mostly in some channels, or only these gain by it."""
    energy = decision.energy(term)
    total, there = sum(energy.values()), sum(v for k, v in energy.items() if k in names)
    if not there:
        return False
    return there > 0.5 * total or _gain_outside(decision, term, names) < LEAST_OUTSIDE


def _gain_outside(decision: Decision, term: Term, names: set[str]) -> float:
    """Drop of half the sum of squares that a term brings in other channels, beside the other terms."""
    states = (
        forward(some, decision.problem.view)
        for some in ([t for t in decision.terms if t is not term], decision.terms)
    )
    others = [d for d in decision.problem.data if d.channel.name not in names]
    before, after = (sum(float(np.sum(d.whiten(d.residual(s)) ** 2)) for d in others) for s in states)
    return 0.5 * (before - after)
