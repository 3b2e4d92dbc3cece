"""What one device alone shows: a place in its images or its sweep where it differs, and others do not.

All devices together hardly tell it: over them it is a third as large, and no column's mean shows it, for each device
has its constant. Within the device's own steps it is a place like any other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.features import category_id
from arl_fixtures.reconcile.law import Axis, Law, LawTerm
from arl_fixtures.reconcile.law_of_rest import confirmed
from arl_fixtures.reconcile.locate import located_law, where_it_acts
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.roles import Role

FEWEST_BLOCKS = 2
"""Blocks of a device from which one half of them may foretell the other."""
LEAST_GAIN = 20.0
"""Log-likelihood of the places of one device: each device is a look of its own."""
SIMPLER = 4.0
"""Log-likelihood by which a second column, or light instead of a share, must do better."""


def law_of_one_unit(looker: Looker, data: ChannelData, state: State) -> Law | None:
    """Tables over the places where one device differs from the others; None where none does.

    Args:
        looker: of the problem.
        data: the channel; its units must be the values of one column, of devices.
        state: corrected simulation.
    """
    column, *more = looker.problem.groups.unit_columns or ("",)
    labels = looker.problem.view.columns.categories.get(column)
    if data.units < 2 or more or labels is None or data.channel.role is Role.SCATTER:
        return None
    best: Law | None = None
    for unit in range(data.units):
        rows = np.flatnonzero(data.unit == unit)
        if np.unique(data.block[rows]).size < FEWEST_BLOCKS:
            continue
        part = data.part(rows)
        part.rebuild(part.fit_scatter(part.residual(state))[1])
        law = _nil_elsewhere(looker, part, located_law(looker, part, state))
        if law.gain < max(LEAST_GAIN, best.gain if best else 0.0):
            continue
        label = labels[1][int(labels[0][looker.problem.view.rows[data.use[rows[0]]]])]
        own = Axis(column=column, kind="is", at=category_id(label), label=label)
        best = _with(confirmed(_narrowed(looker, part, state, law), looker, part, state), own)
    return best


def _nil_elsewhere(looker: Looker, part: ChannelData, law: Law) -> Law:
    """A law of tables that say nothing of most rows: what a device shows in a place, it does not undo elsewhere."""
    terms = []
    for term in law.terms:
        table, *slope = term.axes
        seen = table.bin_of(looker.features[table.column][part.use])
        middle = float(np.median(np.asarray(table.values)[seen])) if not slope else 0.0
        terms.append(replace(term, axes=(replace(table, values=tuple(v - middle for v in table.values)), *slope)))
    return replace(law, terms=terms)


def _with(law: Law, own: Axis) -> Law:
    """A law that holds where a mark is."""
    terms = [replace(term, axes=(*term.axes, own)) for term in law.terms]
    return replace(law, terms=terms, drivers=[*law.drivers, own.column])


def _narrowed(looker: Looker, part: ChannelData, state: State, law: Law) -> Law:
    """The first place also by a second column, and as an amount of light for a share, where that is likelier."""
    name, best = part.channel.name, law
    place = where_it_acts(looker, part, state, law.terms[0].axes[0]) if len(law.terms[0].axes) == 1 else None
    if place is not None:
        term = LawTerm(axes=(place.slope, place.table), value=1.0, error=1.0 / max(place.z, 1.0))
        both = list(dict.fromkeys([place.slope.column, place.table.column]))
        narrower = replace(law, terms=[term], drivers=both, gain=law.gain + place.gain)
        best = _likelier(looker, part, state, best, narrower)
    if part.channel.role is Role.INTENSITY:
        middle = float(np.median(part.scale))
        light = Axis(column=f"sim_{name}", kind="inverse", middle=middle, width=middle)
        terms = [replace(term, axes=(*term.axes, light)) for term in best.terms]
        best = _likelier(looker, part, state, best, replace(best, terms=terms))
    return best


def _likelier(looker: Looker, part: ChannelData, state: State, law: Law, other: Law) -> Law:
    """The law that leaves less, with the strength at which it does so; the first where both leave the same."""
    fitted = [_fitted(looker, part, state, one) for one in (law, other)]
    return fitted[int(fitted[1][1] > fitted[0][1] + SIMPLER)][0]


def _fitted(looker: Looker, part: ChannelData, state: State, law: Law) -> tuple[Law, float]:
    """A law times the number by which it agrees best, and the log-likelihood of what it then leaves."""
    name, residual, weight = part.channel.name, part.residual(state), part.root_weight**2
    change = part.expect * law.correction(looker.features, state[name])[part.use]
    strength = float(weight @ (change * residual)) / max(float(weight @ change**2), 1e-300)
    terms = [replace(term, value=strength * term.value, error=strength * term.error) for term in law.terms]
    return replace(law, terms=terms), part.fit_scatter(residual - strength * change)[0]
