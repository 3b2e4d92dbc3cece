"""One more round of the search beside the names that stand where others fell: they hid who comes after them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arl_fixtures.reconcile.gate import drop_fallen
from arl_fixtures.reconcile.patterns_beside import add_patterns
from arl_fixtures.reconcile.told_apart import alike

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision


ASKED = 3
"""Times that is asked, as long as what is found falls: it hid who comes after it once more. From the second time on
only of what tells steps apart where the names act within them, or the reverse: what a name's shape misses always has
some other name."""


def name_who_was_hidden(decision: Decision, at_first: frozenset[str]) -> None:
    """Ask again what else acts, without the effects that fell; what is found then must stand like any other name.

    What is known to be like a name that stands and like one that fell would mend the shape of the one as the other
    did: it is not asked either.

    Args:
        decision: with the names that are left; nothing is asked where there are none, which is a case of its own: the
            only name that could be found has then shown that it is not what it looks like.
        at_first: ids of the effects that the search had found.
    """
    standing = frozenset(t.effect.id for t in decision.best.terms)
    fallen = at_first - standing
    for times in range(ASKED):
        if not standing or not fallen:
            return
        refused = fallen | decision.refused | (_like(decision, standing) & _like(decision, fallen))
        found = _who_stands(decision, standing, refused, apart=times > 0)
        if found <= standing:
            return
        left = frozenset(t.effect.id for t in decision.best.terms)
        if left - standing:
            return
        fallen |= found - standing


def _who_stands(
    decision: Decision, standing: frozenset[str], refused: frozenset[str], *, apart: bool
) -> frozenset[str]:  # fmt: skip
    """Names of one more round, those that stood among them; the decision is with those that stand then.

    Where none of it does, all is as it was before: beside what fell again names may fall that stand without it.
    """
    chance = decision.found.screening
    if chance is None:
        return standing
    found = decision.search.further(decision.best, chance, refused, apart=apart)
    names = frozenset(t.effect.id for t in found.terms)
    if len(found.terms) == len(decision.best.terms):
        return standing
    before = decision.best, decision.patterns
    decision.best, decision.patterns = found, []
    decision.look()
    add_patterns(decision)
    while drop_fallen(decision):
        pass
    left = {t.effect.id for t in decision.best.terms}
    if left <= standing:
        decision.best, decision.patterns = before
        decision.keep(decision.best.terms)
        decision.look()
    return names


def _like(decision: Decision, names: frozenset[str]) -> set[str]:
    """Effects that are known to be like one of some."""
    some = [e for e in decision.effects if e.id in names]
    return {e.id for e in decision.effects if any(alike(e, other) for other in some)}
