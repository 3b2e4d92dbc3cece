"""Laws of nothing new: a scatter within what a noise law is worth, a plate that answers to what it carries.

And names of two readings that are one temperature's.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from arl_fixtures.reconcile.acceptance import LEAST_SCATTER
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import is_of, is_of_bench
from arl_fixtures.reconcile.law import Features, Law
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.view import View

BACK_ACTION = 0.15
"""Part of a node's change that its plate may answer with: what bears a device has several times its heat capacity."""
ALIKE = 0.3
"""Part of it up to which what two thermometers read too much differs, where it is what they measure."""


def is_within_noise_law(law: Law, features: Features, state: State, *, acted: bool) -> bool:
    """Whether a law on a scatter is within what a noise law is worth: one read off a table where names act."""
    values = state[law.channel]
    add = law.correction(features, values)
    least = (2.0 if acted else 1.0) * LEAST_SCATTER
    return float(np.nanquantile(np.abs(add) / np.maximum(np.abs(values), 1e-300), 0.95)) < least


def is_back_action(law: Law, features: Features, state: State, terms: Sequence[Term], view: View) -> bool:
    """Whether a law on a plate is no more than the heat that a named node on it takes or leaves.

    A node's law holds its plate as it was simulated; a real one gives way, by the ratio of their heat capacities.
    """
    most = _given_back(law.channel, terms, view)
    return most > 0.0 and _peak(law.correction(features, state[law.channel])) < most


def without_back_actions(terms: Sequence[Term], view: View) -> tuple[Term, ...]:
    """Terms without those on a plate alone that are no more than what a node on it gives back."""
    kept = []
    for term in terms:
        rest = [t for t in terms if t is not term]
        channel, *others = term.variant.channels
        most = _given_back(channel, rest, view) if not others or _is_plate(channel) else 0.0
        if most == 0.0 or _peak(forward(terms, view)[channel] - forward(rest, view)[channel]) >= most:
            kept.append(term)
    return tuple(kept)


def read_alike(terms: Sequence[Term], view: View) -> list[Term]:
    """Errors of thermometers that several show alike, each its own by name: what they measure is another.

    Constants are left out: each thermometer may have been fitted.
    """
    own = [t for t in terms if t.effect.of_reading and len(t.variant.channels) == 1]
    if len(own) < 2:
        return []
    state, change = forward(terms, view), []
    for term in own:
        name = term.variant.channels[0]
        moved = state[name] - forward([t for t in terms if t is not term], view)[name]
        change.append(moved - np.nanmean(moved))
    alike: list[Term] = []
    for (a, by_a), (b, by_b) in combinations(zip(own, change, strict=True), 2):
        apart = _size(by_a - by_b)
        if a.variant.channels != b.variant.channels and a.unit == b.unit:
            alike += [a, b] if 0.0 < apart < ALIKE * max(_size(by_a), _size(by_b)) else []
    return alike


def _given_back(plate: str, terms: Sequence[Term], view: View) -> float:
    """The most by which a plate answers to terms on what it carries; nil where none acts there."""
    carried = [t for t in terms if _stands_on(t, plate)]
    if not carried:
        return 0.0
    moved, without = forward(terms, view), forward([t for t in terms if t not in carried], view)
    return BACK_ACTION * max(_peak(moved[name] - without[name]) for t in carried for name in t.variant.channels)


def _stands_on(term: Term, plate: str) -> bool:
    """Whether a term acts on a node that a plate carries: the term says so, or the node is a device's."""
    if "plate" in term.variant.options:
        return str(term.variant.options["plate"]).removeprefix("sim_") == plate
    node = term.variant.channels[0]
    return _is_plate(plate) and unit_of(node) == "°C" and not is_of_bench(node)


def _is_plate(channel: str) -> bool:
    return unit_of(channel) == "°C" and is_of(channel, "plate")


def _peak(change: FloatArray) -> float:
    """What answers is late and lasts: it is compared where it is largest."""
    return float(np.nanmax(np.abs(change)))


def _size(change: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(change**2)))
