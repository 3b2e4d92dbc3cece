"""A faint name in one channel, where what a law found in another one says as much of it by columns of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arl_fixtures.reconcile.acceptance import TWIN_GAIN
from arl_fixtures.reconcile.own_driver import driven_by
from arl_fixtures.reconcile.roles import told_by

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision


def drop_told_elsewhere(decision: Decision) -> bool:
    """Drop names beside an unknown whose columns say as much of their channel; tells if any fell.

    One cause acts in several channels. A chip that grows warmer in the sun, which is what is really missing, goes
    with the sun by chance: the name of the one is no better than the law of the other, of which another channel tells
    for sure.
    """
    gone = []
    moved = [(t, set(decision.energy(t))) for t in decision.best.terms] if decision.laws else []
    for d in decision.problem.data:
        name = d.channel.name
        acting = [t for t, names in moved if name in names]
        others = [law for law in decision.laws if law.channel != name and law.terms]
        if [names for _, names in moved if name in names] != [{name}] or not others:
            continue  # a name that acts elsewhere, too, is borne out there
        if any(law.channel == name for law in decision.laws):
            continue
        law, gain = decision.standing.instead_of(d, acting)
        columns = {told_by(c) for c in law.drivers}
        told = any(columns and columns <= {told_by(c) for c in other.drivers} for other in others)
        if told and not columns & driven_by(*acting) and gain > -TWIN_GAIN:
            gone += acting
    if gone:
        decision.keep(tuple(t for t in decision.best.terms if t not in gone))
        decision.look()
    return bool(gone)
