"""Terms of a law that are errors of the stage's angle: functions of one or two columns times what a turn changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effects_encoder import STAGE
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import KNOTS, PRICE_CURVE, PRICE_PRODUCT, Basis, curve_axis, curves_of
from arl_fixtures.reconcile.law_candidates import shared_price
from arl_fixtures.reconcile.law_crossed import crossed_of
from arl_fixtures.reconcile.law_work import Candidate, Work
from arl_fixtures.reconcile.roles import PER_TURN

LEAST_ROWS = 20
"""Rows that must show a turn."""


def turned_of(
    work: Work, names: Sequence[str], marks: Sequence[Axis], simple: Mapping[str, Sequence[Candidate]]
) -> Iterator[Basis]:
    """Functions of every column and of pairs of them, times the slope of the channel over the stage's angle.

    An angle that is off by a constant is a name; so this has no term without a column.

    Args:
        work: the rows.
        names: numeric columns, no two of them nearly the same; marks: functions of categories.
        simple: columns to their functions of one coefficient.
    """
    name = f"{PER_TURN}{work.data.channel.name})"
    if name not in work.features or np.count_nonzero(work.features[name]) < LEAST_ROWS:
        return
    slope = Axis(column=name, kind="linear", middle=0.0, width=1.0)
    for column, functions in simple.items():
        if not column.startswith(("~", "sim_")):
            for item in functions:
                yield replace(item.basis, axes=(*item.basis.axes, slope), price=item.basis.price + PRICE_PRODUCT)
    if STAGE in work.features:
        curve = curve_axis(STAGE, work.features[STAGE], KNOTS)
        for basis in curves_of(curve, PRICE_CURVE + PRICE_PRODUCT + shared_price(work, (STAGE,))) if curve else ():
            yield replace(basis, axes=(*basis.axes, slope))
    for basis in crossed_of(work, names, marks, beside=(slope,)):
        yield replace(basis, price=basis.price + PRICE_PRODUCT)
