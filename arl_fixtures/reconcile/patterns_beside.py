"""Patterns of pixels beside the names: which are taken, what spots may replace, which a law tells as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from arl_fixtures.reconcile.dead import bring_back, dead_first, leave_out_dead, leave_out_their_scatter
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.law_of_rest import law_of_rest
from arl_fixtures.reconcile.misfit import MISFIT_SHARE
from arl_fixtures.reconcile.patterns import PATTERN_GAIN, Pattern, find_patterns, is_calibration
from arl_fixtures.reconcile.rivals import has_other_place, is_outdone, pictures_beside, share_beside
from arl_fixtures.reconcile.roles import FIELD_COLUMNS, PIXEL, PIXEL_COLUMNS, Role
from arl_fixtures.reconcile.search import LEVEL_FURTHER
from arl_fixtures.reconcile.spots import spots_instead
from arl_fixtures.reconcile.steadiness import is_unsteady
from arl_fixtures.reconcile.terms import Term, forward

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision


def add_patterns(decision: Decision) -> None:
    """Take the strongest pattern of pixels that stands beside the names, and drop names that had its likeness."""
    # a stain is as smooth as what no pixel's gain is
    any_found = find_patterns(decision.problem, decision.effects, decision.best.terms, smooth=True)
    found = [p for p in any_found if not p.smooth]
    if add_spots(decision, any_found):
        found = find_patterns(decision.problem, decision.effects, decision.best.terms)
    for pattern in dead_first(decision.problem, decision.effects, decision.best.terms, found)[:2]:
        calibration = is_calibration(decision.problem, pattern, decision.best.terms)
        shares = _shares(decision, pattern, decision.best.terms)
        if calibration or decision.patterns or pattern.gain <= max(shares, default=0.0):
            continue
        if is_unsteady(decision.found.looker, [*decision.best.terms, pattern.bare], pattern.bare):
            continue
        if shares or not has_other_place(decision.found.looker, decision.best.terms, pattern):
            decision.patterns.append(pattern)
    if decision.patterns:
        leave_out_their_scatter(decision.problem, decision.patterns)
        decision.look()
        pictures = pictures_beside(decision.best.terms, decision.patterns)
        best = (
            decision.search.prune(decision.best, decision.found.screening, certain=pictures)
            if pictures
            else decision.best
        )
        if len(best.terms) < len(decision.best.terms):  # it had the likeness of the pattern
            decision.best, decision.patterns = best, []
            add_patterns(decision)


def find_smooth(decision: Decision) -> None:
    """What pixels share and their neighbours, too, where nothing that was found says anything of it.

    As no pixel's gain is that of its neighbour, it is a law's; a pattern only where no law is found.
    """
    if decision.patterns:
        return
    lawful, terms = {law.channel for law in decision.laws}, decision.best.terms
    state = forward(decision.terms, decision.problem.view)
    for pattern in find_patterns(decision.problem, decision.effects, terms, smooth=True):
        told = [
            d for d in decision.problem.data
            if d.channel.name in pattern.term.variant.channels and d.channel.role is not Role.SCATTER
        ]  # fmt: skip
        if not pattern.smooth or lawful & {d.channel.name for d in told}:
            continue
        shares = _shares(decision, pattern, terms)
        if is_calibration(decision.problem, pattern, terms) or pattern.gain <= max(shares, default=0.0):
            continue
        looks = [(d, decision.after[d.channel.name]) for d in told if shares]  # without names there is none: asked
        laws = [law_of_rest(decision.found.looker, d, state, look, beside=True) for d, look in looks]
        decision.laws += [law for law in laws if law]
        if not any(laws):
            decision.patterns.append(pattern)
        return


def _shares(decision: Decision, pattern: Pattern, terms: Sequence[Term]) -> list[float]:
    """What a pattern must gain beside each of these terms that acts in its channels."""
    channels = set(pattern.term.variant.channels)
    return [
        share_beside(decision.problem, decision.best.terms, t) for t in terms if channels & set(t.variant.channels)
    ]  # fmt: skip


def add_spots(decision: Decision, patterns: Sequence[Pattern]) -> bool:
    """Take spots in the place of the first pattern of gains, where they say as much; tells whether it did.

    Of pixels that live: one that died is no spot on a window, however well a small one covers it.
    """
    died = any(p.term.effect.sparse for p in patterns) and leave_out_dead(decision.problem, decision.effects)
    if died:
        dense = [e for e in decision.effects if not e.sparse]
        patterns = find_patterns(decision.problem, dense, decision.best.terms, smooth=True)
    added = _add_spots(decision, patterns)
    if died:
        bring_back(decision.problem)
    return added


def _add_spots(decision: Decision, patterns: Sequence[Pattern]) -> bool:
    pattern = next((p for p in patterns if p.is_dense), None)
    if pattern is None or decision.patterns or decision.found.screening is None or decision.asked_for_spots:
        return False
    others = [t for t in decision.best.terms if not t.effect.several]  # a spot beside spots is another one
    if pattern.gain <= max(_shares(decision, pattern, others), default=0.0):
        return False
    decision.asked_for_spots = True  # those that fell would come back as long as the pattern stands
    threshold = decision.found.screening.threshold(LEVEL_FURTHER)
    spots = spots_instead(decision.search, decision.best, pattern, threshold)
    if spots is None:
        return False
    decision.problem.refit_scatter(spots.state, lost=float(len(spots.keys)))
    decision.keep(spots.terms)
    decision.look()
    return True


def drop_shadowed(decision: Decision) -> bool:
    """Drop patterns of pixels that a law explains as well: its pixels merely see different conditions.

    Tells whether any fell: the laws are then to be found anew.
    """
    kept = [p for p in decision.patterns if not any(_shadows(decision, law, p) for law in decision.laws)]
    kept = [p for p in kept if not is_outdone(decision.found.looker, decision.best.terms, p, decision.leading)]
    fell = len(kept) != len(decision.patterns)
    decision.patterns = kept
    return fell


def _shadows(decision: Decision, law: Law, pattern: Pattern) -> bool:
    """Whether pixels share next to nothing any more where a law is found without the pattern."""
    if law.channel not in pattern.term.variant.channels:
        return False
    if law.gain > pattern.gain:
        return True
    d = next(d for d in decision.problem.data if d.channel.name == law.channel)
    state = forward(decision.best.terms, decision.problem.view)
    alone = law_of_rest(decision.found.looker, d, state, decision.found.looker.look(d, state))
    if alone is None:
        return False
    numbers = PIXEL_COLUMNS | {PIXEL, *FIELD_COLUMNS}  # a table over these is the pattern in other words
    of_more = [t for t in alone.terms if not {name for a in t.axes for name in a.columns} <= numbers]
    if len(of_more) < len(alone.terms):
        alone = replace(alone, terms=of_more, trees=[])
    add = alone.correction(decision.found.looker.features, state[law.channel])
    left = d.measured - d.expect * (state[law.channel] + add)[d.use]
    shared = d.fit_scatter(left)[0] - d.fit_scatter(left, without=("pixel",))[0]
    return shared < max(PATTERN_GAIN, MISFIT_SHARE * pattern.gain)
