"""Whether a free pattern of pixels says more than what else could explain it: a name, another place, a law."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import RINGS, Law
from arl_fixtures.reconcile.law_search import search_law
from arl_fixtures.reconcile.locate import locate
from arl_fixtures.reconcile.misfit import MISFIT_SHARE
from arl_fixtures.reconcile.patterns import Pattern, shared_part
from arl_fixtures.reconcile.pilot import Looker, Structure
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.region import rows_of_most
from arl_fixtures.reconcile.roles import BEARING_SIGNS, FIELD_COLUMNS, ORDERS, PER_TURN, PIXEL_COLUMNS, Role, told_by
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.whitener import Whitener

BEATEN_BY, BEATEN_SHARE, BEATEN_OWN = 4.0, 0.05, 6.0
"""By how much a law must do better than names before these are refused: log-likelihood, or share of their gain; and
the log-likelihood of a law of the names' own columns. A law pays for having been looked for: beside 45 right names of
benchmarks/concealed the likeliest law was less likely than these, but where they gained some thousands."""
BEATEN_PATTERN = 12.0
"""By how much a law must do better than a free pattern of pixels."""
BESIDE_RINGS = 0.7
"""Share of what a pixel's rows have in common that rings leave at most, for them to stand in a pattern's place."""
ELSEWHERE = 1.0
"""Log-likelihood by which another place must be likelier: bins of a radius that hold a pixel each say the same."""
BEATEN_PLAIN = 0.03
"""Share of what the names explain to independent rows by which a law without physics must at least be better."""
NEIGHBOURS = ("~edge", "~sweep", "~before", "~frame")
AT_EDGES = (*NEIGHBOURS, "mixed")
OF_BEARINGS = PIXEL_COLUMNS | {"stage_angle_deg", "incidence_deg", "surface"}
"""What a name follows that acts at some bearings of a scene more than at others."""
MIXED_SHARE = 2.0
"""The share for a law of neighbouring rows where the name mixes rows with their neighbours: it says the same."""
_MEDIAN_OF_SQUARE = 0.4549  # of a standard normal deviate
_PLACES = {
    *PIXEL_COLUMNS, *FIELD_COLUMNS, *BEARING_SIGNS,
    "stage_angle_deg", "surface", "reflectance", "distance", "incidence_deg",
}  # fmt: skip
"""What tells where in a scene a row looks: by these an edge is found that something moves."""
ACTS_ON, ACTS_AT_MOST, LEFT_THERE = 0.99, 0.3, 0.9
"""Share of a name's power in the rows on which it acts, the largest share of rows that these are, and the share of
what is left in excess of noise that must lie in them."""
LEAST_Z = 2.0
"""Significance over blocks below which what is gained on unseen ones is a single block's."""
STRUCTURE_Z, STRUCTURE_GAIN = 3.7, 12.0
"""A physics-free model must gain this much on unseen blocks before there is said to be a mismatch at all."""
PICTURE_SHARE = 0.3
"""Share of what an effect over the image explains that a free pattern of pixels must gain beside it."""


def is_structure(seen: Structure) -> bool:
    """Whether a channel's residual holds something that unseen blocks confirm.

    What sits in few blocks only has a low z for its gain: it must gain more. Below `LEAST_Z` it is a single block's.
    """
    return seen.z > LEAST_Z and seen.gain > STRUCTURE_GAIN * max(1.0, (STRUCTURE_Z / seen.z) ** 2)


def says_the_same(acting: Sequence[Term], columns: Sequence[str]) -> bool:
    """Whether a law describes by its columns what a name does: mix rows with those next to them, or move them there.

    What moves a scene tells of neighbours by its own drivers: a law of others tells of another cause.
    """
    if not any(c.startswith(NEIGHBOURS) for c in columns):
        return False
    if any(t.effect.mixes for t in acting):
        return True
    moved = [t for t in acting if t.effect.displaces]
    known = {_kind_of(c) for t in moved for c in t.variant.drivers} | _PLACES
    return bool(moved) and {_kind_of(c) for c in columns if not c.startswith(AT_EDGES)} <= known


def mends_the_same(acting: Sequence[Term], leading: Sequence[str]) -> bool:
    """Whether what names leave that mix rows with their neighbours, or move them, lies at edges again."""
    near = all(t.effect.mixes or t.effect.displaces for t in acting)
    return near and all(c.startswith(AT_EDGES) or c in BEARING_SIGNS for c in leading[:2])


def lies_where_names_act(problem: Problem, d: ChannelData, acting: Sequence[Term], terms: Sequence[Term]) -> bool:
    """Whether what is left of a channel lies in the few rows at edges which names mix or move.

    How the light of a pixel divides between two surfaces is known in part only, be it from neighbours or from rays
    that are not the simulation's own: a right name leaves that share of what it does, and in the same rows.
    """
    if not acting or not all(t.effect.mixes or t.effect.displaces for t in acting):
        return False
    state = forward(terms, problem.view)
    before = forward([t for t in terms if t not in acting], problem.view)
    name = d.channel.name
    power = (d.root_weight * d.expect * (state[name] - before[name])[d.use]) ** 2
    square = (d.root_weight * d.residual(state)) ** 2
    excess = square - float(np.median(square)) / _MEDIAN_OF_SQUARE
    acted = rows_of_most(power, ACTS_ON)
    few = len(acted) < ACTS_AT_MOST * len(power)
    return few and float(excess[acted].sum()) > LEFT_THERE * max(float(excess.sum()), 0.0)


def needed_by_law(
    named: float, plain: float, acting: Sequence[Term], columns: Sequence[str], *,
    at_edges: bool = False, is_line: bool = False,
) -> float:  # fmt: skip
    """Likelihood that a law must reach for names to be refused.

    Args:
        named: what the names gain, less their price; plain: the same if rows shared no errors.
        acting: the names; columns: of the law.
        at_edges: whether what the names leave lies in the rows of edges on which they act (`lies_where_names_act`).
        is_line: whether the law is one number times one function of one column: simpler than two names.
    """
    share = MIXED_SHARE if at_edges or says_the_same(acting, columns) else BEATEN_SHARE
    known = {_kind_of(c) for term in acting for c in term.variant.drivers}
    # a law of the names' own columns has the freer shape only, where one of others tells of another cause
    plain_columns = [c for c in columns if not (c in FIELD_COLUMNS or c in BEARING_SIGNS or _is_turn(c, acting))]
    own = {_kind_of(c) for c in plain_columns} <= known
    if set(columns) & set(FIELD_COLUMNS):
        own = own and bool(known & PIXEL_COLUMNS)
    if set(columns) & set(BEARING_SIGNS):
        own = own and bool(known & OF_BEARINGS)
    least, share = (BEATEN_OWN, max(share, 2.0 * BEATEN_SHARE)) if own else (BEATEN_BY, share)
    if is_line and not own and len(acting) > 1:
        return named
    if any(_follows_order(term) for term in acting) and not ORDERS & set(columns):
        return named  # what was set in that order says as much
    return named + max(least, share * named, BEATEN_PLAIN * plain)


def _is_turn(column: str, acting: Sequence[Term]) -> bool:
    """Whether a column tells how a scene changes as it is turned, of which names that turn it say as much."""
    turned = column.startswith((PER_TURN, *NEIGHBOURS))
    return turned and any(t.effect.displaces and "stage_angle_deg" in t.variant.drivers for t in acting)


def _follows_order(term: Term) -> bool:
    """Whether an effect grows with the order of the measurement, which stands for whatever was changed meanwhile."""
    return bool(ORDERS & {term.variant.options.get("age"), term.variant.options.get("driver")})


def _kind_of(column: str) -> str:
    """What a column tells of, all temperatures counted as one."""
    return "temperature_c" if column.endswith("temperature_c") else told_by(column)


def share_beside(problem: Problem, terms: Sequence[Term], term: Term) -> float:
    """Log-likelihood that a free pattern of pixels must gain beside an effect, so as not to mend its shape only.

    It is a share of what the free pattern could take from the effect's own change, as it is fitted: beside what steps
    and images share. Of an effect that is itself a picture (a spot, a beam) it takes up whatever the outline misses.
    """
    picture = bool(set(term.variant.drivers) & PIXEL_COLUMNS)
    others = [t for t in terms if t is not term]
    base, moved = forward(others, problem.view), forward([*others, term], problem.view)
    total = 0.0
    for d in problem.data:
        level = d.level("pixel")
        if level is None or d.channel.role is Role.SCATTER or moved[d.channel.name] is base[d.channel.name]:
            continue
        weight = d.root_weight**2 * level.scale
        change = d.expect * (moved[d.channel.name] - base[d.channel.name])[d.use]
        if not (term.effect.displaces or term.effect.mixes):  # what those leave at edges no image shares
            change = change - shared_part(d, change)
        gram = np.bincount(level.code, weight * level.scale, minlength=level.count)
        mean = np.bincount(level.code, weight * change, minlength=level.count) / np.maximum(gram, 1e-300)
        unit = np.zeros(level.count, dtype=np.int64)
        unit[level.code] = d.unit
        middle = np.bincount(unit, gram * mean) / np.maximum(np.bincount(unit, gram), 1e-300)
        total += 0.5 * float(np.sum(gram * (mean - middle[unit]) ** 2))
    return (PICTURE_SHARE if picture else MISFIT_SHARE) * total


def pictures_beside(terms: Sequence[Term], patterns: Sequence[Pattern]) -> set[str]:
    """Effects that are a picture over the pixels, on a channel whose pixels have a free pattern as well."""
    channels = {c for p in patterns for c in p.term.variant.channels}
    places = PIXEL_COLUMNS | {"surface"}  # a panel stays before the same pixels
    alike = [t for t in terms if set(t.variant.drivers) <= places and channels & set(t.variant.channels)]
    return {t.effect.id for t in alike}


def plain_gain(problem: Problem, terms: Sequence[Term], term: Term) -> float:
    """Half the drop of the sum of squares that a term brings to independent rows beside units' constants."""
    others = [t for t in terms if t is not term]
    base, moved = forward(others, problem.view), forward([*others, term], problem.view)
    return sum(
        plain_change(d, moved[d.channel.name] - base[d.channel.name])
        for d in problem.data
        if moved[d.channel.name] is not base[d.channel.name] and d.channel.role is not Role.SCATTER
    )


def plain_change(d: ChannelData, change: FloatArray) -> float:
    """Half the squares of a channel's change (of all rows) less units' constants, as rows count it that share no
    more than is stated."""
    here = d.expect * change[d.use]
    if d.calibrated:
        here = here - d.scale * d.constants(here)[d.unit]
    return 0.5 * float(np.sum(Whitener(d.root_weight, d.levels, {})(here) ** 2))


def plain_beyond(d: ChannelData, named: FloatArray, law: FloatArray) -> float:
    """What names' change says to independent rows beyond a law's, never less than nothing.

    Free scatters of pixels or steps hide most of what names gain; as far as a law changes as much they hide its gain,
    too.
    """
    return max(plain_change(d, named) - plain_change(d, law), 0.0)


def has_other_place(looker: Looker, terms: Sequence[Term], pattern: Pattern) -> bool:
    """Whether a channel of a pattern carries stronger structure on something other than its pixels.

    The radius at which a few dead pixels lie tells of nothing else, nor does what their light leaves where the share
    of answers says that they are dead.
    """
    state = forward(terms, looker.problem.view)
    own = PIXEL_COLUMNS | set(FIELD_COLUMNS) if pattern.term.effect.sparse else PIXEL_COLUMNS
    told = [d for d in looker.problem.data if d.channel.name in pattern.term.variant.channels]
    counted = [d for d in told if d.channel.role is Role.FRACTION] if pattern.term.effect.sparse else []
    for d in counted or told:
        if d.channel.role is not Role.SCATTER:
            place = locate(looker, d, state)
            if place is not None and place.gain > pattern.gain + ELSEWHERE and not set(place.columns) & own:
                return True
    return False


def is_outdone(
    looker: Looker, terms: Sequence[Term], pattern: Pattern, leading_of: Callable[[ChannelData], Sequence[str]]
) -> bool:
    """Whether a law of more than pixels explains a channel without a name clearly better than its pixels do.

    `leading_of` gives the columns that matter most to a channel: the law is looked for among these first.
    """
    problem = looker.problem
    untouched, state = problem.view.fresh_state(), forward(terms, problem.view)
    for d in problem.data:
        name = d.channel.name
        if name not in pattern.term.variant.channels or d.channel.role is Role.SCATTER:
            continue
        if not np.array_equal(state[name], untouched[name], equal_nan=True):
            continue
        law, chosen = search_law(looker, d, state, leading_of(d))
        gain = pattern.gain
        if pattern.term.effect.sparse:  # found by its answers, it darkens the light as well
            darker = forward([*terms, pattern.term], problem.view)
            gain = max(gain, d.fit_scatter(d.residual(darker))[0] - d.fit_scatter(d.residual(state))[0])
        if has_rings(law) and chosen.plain > BEATEN_PATTERN:
            left = d.measured - d.expect * (state[name] + law.correction(looker.features, state[name]))[d.use]
            shared = [d.fit_scatter(rest)[1].get("pixel", 0.0) for rest in (d.residual(state), left)]
            if shared[1] < BESIDE_RINGS * shared[0]:
                return True
        least = gain + max(BEATEN_PATTERN, BEATEN_SHARE * gain)
        if chosen.z > LEAST_Z and chosen.plain > least and not set(law.drivers) <= PIXEL_COLUMNS:
            return True
    return False


def has_rings(law: Law) -> bool:
    """Whether a law says by rings over the field how pixels differ: two numbers, not one per pixel."""
    return any(axis.kind in RINGS for term in law.terms for axis in term.axes)
