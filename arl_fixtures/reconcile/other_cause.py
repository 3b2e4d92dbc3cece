"""Whether what names leave of a channel has another cause: a law of columns that the names know nothing of.

Two causes may act in one channel, one in the library and one not. What a wrong name leaves of a single cause holds
the name's own columns, alone or times others. What another cause leaves holds none of them, and none that goes along
with them: then the name stands, and the rest is a finding of its own.
"""

from __future__ import annotations

from collections.abc import Sequence

from arl_fixtures.reconcile.acceptance import PRICE
from arl_fixtures.reconcile.cells import within_cells
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law_search import is_law, search_law
from arl_fixtures.reconcile.own_driver import cells_of, driven_by, says_of
from arl_fixtures.reconcile.pilot import Looker, Structure
from arl_fixtures.reconcile.roles import told_by
from arl_fixtures.reconcile.terms import Term, forward

ALONG = 0.1
"""Share of a law's mean square that may go along with what drives a name."""
TOLD = 0.6
"""Share of what is left that the law must tell."""
LIKELIER, LIKELIER_SHARE = 3.0, 0.03
"""Log-likelihood (and share of what the names gain) by which two causes must do better than a law of one, and the
first of these by which they may do worse than a law of both: a law's shape is never quite that of the cause."""


class OtherCauses:
    """Asked of each channel once for the same names.

    Args:
        looker: of the problem.
    """

    def __init__(self, looker: Looker) -> None:
        self._looker = looker
        self._known: dict[tuple[object, ...], bool] = {}
        self.found: set[str] = set()

    def of(self, d: ChannelData, left: Structure, terms: Sequence[Term], acting: Sequence[Term]) -> bool:
        """Whether what all terms leave of a channel has a cause that those acting in it know nothing of.

        Args:
            d: the channel; left: physics-free structure that stays in it.
            terms: all names; acting: those that change the channel.
        """
        key = (d.channel.name, *((term.label, *term.values.items()) for term in terms))
        if key not in self._known:
            view = self._looker.problem.view
            state, bare = forward(terms, view), forward([t for t in terms if t not in acting], view)
            self._known[key] = has_another_cause(self._looker, d, state, bare, left, acting)
        if self._known[key]:
            self.found.add(d.channel.name)
        return self._known[key]


def has_another_cause(
    looker: Looker, d: ChannelData, state: State, bare: State, left: Structure, acting: Sequence[Term]
) -> bool:
    """Whether a law of what is left stands, tells most of it, and has nothing of what drives the names.

    And whether names and law together are likelier than a law of all that the channel has: of one cause that is a
    product a name may take one factor and leave the other. A law whose terms hold what drives the names, or what
    drives the rest, each in terms of its own, tells of two causes itself.

    Args:
        looker: of the problem.
        d: the channel; state: corrected by all names; bare: by those that do not change the channel.
        left: physics-free structure that stays in it.
        acting: the names that change it.
    """
    law, chosen = search_law(looker, d, state, left.leading())
    if not acting or not is_law(chosen, beside=True) or law.law_gain < TOLD * left.gain:
        return False
    own = driven_by(*acting)
    if any(says_of(name, own) for name in law.drivers):
        return False
    if any(_goes_along(looker, d, law.correction(looker.features, state[d.channel.name]), t) for t in acting):
        return False
    named = d.fit_scatter(d.residual(state))[0] - d.fit_scatter(d.residual(bare))[0]
    named -= PRICE * sum(len(term.free()) for term in acting)
    alone = search_law(looker, d, bare, [*law.drivers, *left.leading()])[1]
    columns = [{told_by(name) for name in term.basis.columns} for term in alone.terms]
    other = {told_by(name) for name in law.drivers}
    tells_both = any(c <= own for c in columns) and all(c <= own or c <= other for c in columns)
    least = -LIKELIER if tells_both else max(LIKELIER, LIKELIER_SHARE * named)
    return named + chosen.plain > alone.plain + least


def _goes_along(looker: Looker, d: ChannelData, change: FloatArray, term: Term) -> bool:
    """Whether more than a little of a change is the same wherever one of a name's drivers is."""
    told = change[d.use] / d.scale
    told = told - float(told.mean())
    view = looker.problem.view
    cells = [cells_of(view, [name]) for name in term.variant.drivers if view.has(name)]
    apart = [within_cells(told, cell[d.use]) for cell in cells if cell is not None]
    return any(float(x @ x) < (1.0 - ALONG) * float(told @ told) for x in apart)
