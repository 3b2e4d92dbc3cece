"""Products of two columns of which neither shows alone: a coil's current times the turn of a wave plate.

The search of pairs begins with columns that tell something by themselves. What two columns do only together is looked
for among all of them at once: functions of one column each, every product of two weighed by its own power, and the
strongest given to the pool, where they pay for having been chosen among so many.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import PRICE_ONE, PRICE_PRODUCT, Basis, price_of, waves_of
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.roles import unit_of

MOST_CROSSED = 8
MOST_COLUMNS = 32
PRICE_CROSSED = 4.0
"""Further price of a product whose columns do nothing alone: one of a thousand."""
TURNS = (1.0, 2.0, 4.0)
"""Waves over a full turn that an angle may act with: an axis off its middle, a doublet, a wave plate."""
LEAST_SPAN_DEG = 60.0
NEAR_NIL = 0.5
"""Lowest value, as a share of its span, of a column whose nil is where an effect of it would be nil."""


def crossed_of(
    work: Work, names: Sequence[str], marks: Sequence[Axis], beside: tuple[Axis, ...] = ()
) -> Iterator[Basis]:
    """The strongest products of functions of two columns.

    Args:
        work: the rows.
        names: numeric columns, no two of them nearly the same.
        marks: functions of categories.
        beside: further factors of all products.
    """
    functions = _functions(work, names, marks)
    if len(functions) < 2:
        return
    rows = np.concatenate([np.stack([axis(work.features) for axis in wave]) for _, wave in functions])
    owner = np.repeat(np.arange(len(functions)), [len(wave) for _, wave in functions])
    direction = np.prod([work.direction, *(axis(work.features) for axis in beside)], axis=0)
    push = (rows * (direction * work.residual)) @ rows.T
    power = (rows**2 * direction**2) @ (rows**2).T
    told = np.zeros((len(functions), len(functions)))
    np.add.at(told, (owner[:, None], owner[None, :]), push**2 / np.maximum(power, 1e-9 * power.max() + 1e-300))
    columns = [wave[0].column for _, wave in functions]
    steady = {name: work.is_shared((name,)) for name in set(columns)}
    pairs = [
        (told[i, j], i, j) for i in range(len(functions)) for j in range(i)
        if columns[i] != columns[j] and (beside or not (steady[columns[i]] and steady[columns[j]]))
    ]  # fmt: skip
    taken: set[tuple[str, str]] = set()
    for _, i, j in sorted(pairs, reverse=True):
        if (columns[i], columns[j]) in taken:
            continue
        taken.add((columns[i], columns[j]))
        price = price_of((columns[i], columns[j])) + PRICE_ONE + PRICE_PRODUCT + PRICE_CROSSED
        found = _product(functions[i][1], functions[j][1], price)
        waves = tuple((*product, *beside) for product in found.waves)
        yield replace(found, axes=found.axes if waves else (*found.axes, *beside), waves=waves)
        if len(taken) == MOST_CROSSED:
            return


def _product(first: Sequence[Axis], second: Sequence[Axis], price: float) -> Basis:
    if len(first) == len(second) == 1:
        return Basis(axes=(first[0], second[0]), price=price)
    return Basis(waves=tuple((a, b) for a in first for b in second), price=price + len(first) * len(second) - 1.0)


def _functions(work: Work, names: Sequence[str], marks: Sequence[Axis]) -> list[tuple[str, list[Axis]]]:
    """Functions of one column each, sine and cosine of a wave together."""
    functions: list[tuple[str, list[Axis]]] = []
    for name in names[:MOST_COLUMNS]:
        x = work.features[name]
        low, high = float(np.nanmin(x)), float(np.nanmax(x))
        if not high > low:
            continue
        width = high - low
        functions.append((name, [Axis(column=name, kind="linear", middle=0.5 * (low + high), width=width)]))
        if unit_of(name) not in {"°C", "deg", "s"} and -width < low < NEAR_NIL * width:
            functions.append((name, [Axis(column=name, kind="linear", middle=0.0, width=width)]))
        if unit_of(name) == "deg" and high - low > LEAST_SPAN_DEG:
            functions += [(name, [product[0] for product in waves_of(name, n / 360.0)]) for n in TURNS]
    return [*functions, *((mark.column, [mark]) for mark in marks)]
