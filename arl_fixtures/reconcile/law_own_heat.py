"""Which of several temperatures that go along with each other a law is one of.

A chamber heats everything, and of the temperatures that are logged the one that fits best by a hair need not be what
acts. What was asked of the chamber acts on nothing; what happens to one surface is a matter of its own heat.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effects_common import is_of
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_choice import CLOSE, CLOSE_SHARE
from arl_fixtures.reconcile.law_fit import Chosen, joint
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.roles import unit_of

_OF_SURFACES = frozenset({"surface", "reflectance", "incidence_deg"})
_BEFORE = ("panel", "target", "wall", "board", "surface", "scene")


def of_own_heat(work: Work, chosen: Chosen) -> Chosen:
    """The law with the temperature of what it acts on, where that foretells as much as the one that was found."""
    for name in dict.fromkeys(c for term in chosen.terms for c in term.basis.columns):
        told = {c for term in chosen.terms for c in term.basis.columns}
        offers = ([_told_by(t.basis, name, other) for t in chosen.terms] for other in _nearer(work, name, told))
        trials = [joint(work, Candidates(work).add(bases)) for bases in offers]
        best = max(trials, key=lambda trial: trial.held, default=None)
        if best is not None and best.held > chosen.held - max(CLOSE, CLOSE_SHARE * chosen.held):
            chosen = best
    return chosen


def _nearer(work: Work, name: str, told: set[str]) -> list[str]:
    """Temperatures that are nearer to what a law of these columns acts on than one that it is of."""
    if unit_of(name) != "°C" or name.startswith(("~", "sim_")):
        return []
    logged = [
        c for c in work.features
        if unit_of(c) == "°C" and not c.startswith(("~", "sim_", "set_")) and np.isfinite(work.features[c]).all()
    ]  # fmt: skip
    before = [c for c in logged if is_of(c, *_BEFORE)]
    if told & _OF_SURFACES and before:
        return [] if name in before else before
    return [c for c in logged if c not in before] if name.startswith("set_") else []


def _told_by(basis: Basis, name: str, other: str) -> Basis:
    """A basis of another column in the place of one."""

    def moved(axes: tuple[Axis, ...]) -> tuple[Axis, ...]:
        return tuple(
            replace(a, column=other if a.column == name else a.column, beside=other if a.beside == name else a.beside)
            for a in axes
        )

    return replace(basis, axes=moved(basis.axes), waves=tuple(moved(product) for product in basis.waves))
