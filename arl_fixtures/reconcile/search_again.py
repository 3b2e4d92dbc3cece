"""One more round of the search beside the names that stand where others fell: they hid who comes after them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arl_fixtures.reconcile.gate import drop_fallen
from arl_fixtures.reconcile.patterns_beside import add_patterns
from arl_fixtures.reconcile.told_apart import alike

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision


def name_who_was_hidden(decision: Decision, at_first: frozenset[str]) -> None:
    """Ask again what else acts, without the effects that fell; what is found then must stand like any other name.

    Where none of it does, all is as it was before: beside what fell again names may fall that stand without it.

    What is known to be like a name that stands and like one that fell would mend the shape of the one as the other
    did: it is not asked either.

    Args:
        decision: with the names that are left; nothing is asked where there are none, which is a case of its own: the
            only name that could be found has then shown that it is not what it looks like.
        at_first: ids of the effects that the search had found.
    """
    standing = frozenset(t.effect.id for t in decision.best.terms)
    chance = decision.found.screening
    if not standing or standing == at_first or chance is None:
        return
    fallen = at_first - standing
    refused = fallen | decision.refused | (_like(decision, standing) & _like(decision, fallen))
    found = decision.search.further(decision.best, chance, refused)
    if len(found.terms) == len(decision.best.terms):
        return
    before = decision.best, decision.patterns
    decision.best, decision.patterns = found, []
    decision.look()
    add_patterns(decision)
    while drop_fallen(decision):
        pass
    left = {t.effect.id for t in decision.best.terms}
    if left < standing:
        decision.best, decision.patterns = before
        decision.keep(decision.best.terms)
        decision.look()


def _like(decision: Decision, names: frozenset[str]) -> set[str]:
    """Effects that are known to be like one of some."""
    some = [e for e in decision.effects if e.id in names]
    return {e.id for e in decision.effects if any(alike(e, other) for other in some)}
