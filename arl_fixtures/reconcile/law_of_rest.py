"""What is said of a channel's rest that no name explains: functions, else tables where they stand out, else trees."""

from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.law_fit import joint, weighed
from arl_fixtures.reconcile.law_levels import told_closer
from arl_fixtures.reconcile.law_search import add_trees, is_law, search_law
from arl_fixtures.reconcile.law_work import ALL_ROWS, Work
from arl_fixtures.reconcile.locate import locate, located_law
from arl_fixtures.reconcile.pilot import Looker, Structure
from arl_fixtures.reconcile.rivals import STRUCTURE_GAIN, is_structure

TREES_ALONE = 1.5
"""How much more it must gain where neither a place nor a law is found in what it predicts."""


def law_of_rest(
    looker: Looker, data: ChannelData, state: State, left: Structure, *, beside: bool = False
) -> Law | None:
    """Law of what is left in a channel, None where nothing tells of a mismatch, or where it cannot be reckoned.

    Args:
        looker: of the problem.
        data: the channel.
        state: corrected simulation.
        left: physics-free structure that stays in the channel.
        beside: whether a name acts in the channel: a faint rest may then be what the name gets wrong.
    """
    try:
        return _law_of_rest(looker, data, state, left, beside=beside)
    except np.linalg.LinAlgError as error:  # costs this law, not the answer
        looker.failed[f"law of {data.channel.name}"] = f"was not found: {error}"
        return None


def _law_of_rest(looker: Looker, data: ChannelData, state: State, left: Structure, *, beside: bool) -> Law | None:
    certain, place = is_structure(left), locate(looker, data, state)
    if not (certain or place or np.any(data.residual(state))):
        return None
    leading = [*(place.columns if place else []), *left.leading()]
    law, chosen = search_law(looker, data, state, leading)
    if not (certain or place or is_law(chosen, beside=beside)):
        return None
    law = told_closer(looker, data, state, law, chosen)
    if place is not None and law.law_gain < place.gain / 2.0:
        tables = located_law(looker, data, state)
        if tables.terms:
            law = confirmed(tables, looker, data, state)
        else:  # what every step has anew: it has a place, but no law
            law.drivers = list(dict.fromkeys([*place.columns, *law.drivers]))
            law.gain = max(law.gain, place.gain)
    if not law.terms and place is None and left.gain < TREES_ALONE * STRUCTURE_GAIN:
        return None
    if certain:
        add_trees(law, looker, data, state, left)
        law.drivers = law.drivers or left.leading()[:3]
        law.gain = max(law.gain, left.gain)
    return law if law.drivers else None


def confirmed(tables: Law, looker: Looker, data: ChannelData, state: State) -> Law:
    """Tables that unseen blocks confirm; without them, only by which columns the channel's rest differs."""
    work = Work(data, state, looker.features, data.tau, ALL_ROWS)
    bases = [
        Basis(axes=(replace(place, values=()), *slope), prior=np.eye(replace(place, values=()).count), price=0.0)
        for place, *slope in (term.axes for term in tables.terms)
    ]
    fitted = joint(work, [weighed(work, basis, work.residual) for basis in bases])
    if fitted.held <= 0.0:
        tables.terms = []
    else:
        tables.confirmed = min(fitted.held / max(fitted.inside, 1e-9), 1.0)
    return tables
