"""Terms of a law that were found, made better: where they hold, what multiplies them, and where they are nil."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.law import Axis, axes_of
from arl_fixtures.reconcile.law_basis import PRICE_MARK, PRICE_ZERO, Basis
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_choice import FURTHER_GAIN, LEAST_GAIN
from arl_fixtures.reconcile.law_fit import Chosen, joint, weighed
from arl_fixtures.reconcile.law_pool import UNSHIFTED, distinct, is_mark, marks_of, recurs
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.pilot import Looker

MOST_FACTORED, MOST_OFFERS = 4, 6
PRICE_FACTOR = 4.0
"""Further price of a term that one more column multiplies."""
AS_WELL = 1.5
"""Log-likelihood on unseen blocks by which a law fits as well as another one whose zero says less."""


def narrowed(work: Work, chosen: Chosen, factors: Sequence[Axis]) -> Chosen:
    """Each term only in one category (one device, one surface), or times a function of one more column.

    A factor stays where unseen blocks gain by it; the best few by evidence are tried.
    """
    for place in range(len(chosen.terms)):
        best, basis = chosen, chosen.terms[place].basis
        left = joint(work, [t for k, t in enumerate(chosen.terms) if k != place]).left
        bases: list[Basis] = []
        for factor in factors:
            mark = is_mark(factor, work)
            if factor.column in basis.columns or not (mark or len(chosen.values[place]) <= MOST_FACTORED):
                continue
            if not all(recurs(work, axis, factor) for axis in basis.axes if axis.kind == "table" and axis.is_open):
                continue
            waves = tuple((*product, factor) for product in basis.waves)
            axes = basis.axes if waves else (*basis.axes, factor)
            price = basis.price + (PRICE_MARK if mark else PRICE_FACTOR)
            bases.append(replace(basis, axes=axes, waves=waves, price=price))
        offers = Candidates(work, left).add(bases)
        for item in sorted(offers, key=lambda item: -item.gain)[:MOST_OFFERS]:
            trial = joint(work, [*chosen.terms[:place], item, *chosen.terms[place + 1 :]])
            if trial.beyond(best) > FURTHER_GAIN:
                best = trial
        chosen = best
    return chosen


def from_nil(work: Work, chosen: Chosen) -> Chosen:
    """Products of a line and of what is steady within steps with the line's own nil, where that fits as well.

    What steps share hides where such a product is nil, and the middle of the rows is nowhere special: a path of no
    length has no loss in air of any kind.
    """
    for place, term in enumerate(chosen.terms):
        basis = term.basis
        lines = [axis for axis in basis.axes if axis.kind == "linear" and not work.is_shared((axis.column,))]
        others = tuple(axis for axis in basis.axes if axis not in lines)
        if len(lines) != 1 or not others or basis.waves:
            continue
        if not work.is_shared(tuple(name for axis in others for name in axis.columns)):
            continue
        (line,) = lines
        for ratio in axes_of(line.column, work.features[line.column], ()):
            if ratio.kind == "ratio":
                item = weighed(work, replace(basis, axes=(ratio, *others)), work.residual)
                trial = joint(work, [*chosen.terms[:place], item, *chosen.terms[place + 1 :]])
                if trial.held > chosen.held - AS_WELL:
                    chosen = trial
    return chosen


def completed(work: Work, chosen: Chosen) -> Chosen:
    """Each product also without one of its factors: the zero of a factor need not lie in the middle of the rows."""
    for term in list(chosen.terms):
        for number, axis in enumerate(term.basis.axes):
            if len(term.basis.axes) < 2 or axis.is_open or axis.kind in UNSHIFTED:
                continue
            axes = (*term.basis.axes[:number], *term.basis.axes[number + 1 :])
            basis = replace(term.basis, axes=axes, price=PRICE_ZERO)
            if any(t.basis.axes == axes for t in chosen.terms):
                continue
            item = weighed(work, basis, chosen.left)
            trial = joint(work, [*chosen.terms, item]) if item.gain > 0.0 else chosen
            if trial.beyond(chosen) > LEAST_GAIN:
                chosen = trial
    return chosen


def factors_of(work: Work, looker: Looker, leading: Sequence[str]) -> list[Axis]:
    """Marks of categories, lines and hinges of the columns that tell something of their own."""
    view = looker.problem.view
    numeric = [n for n in work.features if not n.startswith(("~", "sim_")) and not view.is_category(n)]
    factors = marks_of(work, looker)
    for name in distinct(work, [*(n for n in leading if n in numeric), *numeric]):
        values = work.features[name]
        if len(np.unique(values[np.isfinite(values)])) > 2:
            factors += [a for a in axes_of(name, values, ()) if a.kind in {"linear", "above", "below"}]
    return factors
