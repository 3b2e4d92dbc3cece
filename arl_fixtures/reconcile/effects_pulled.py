"""Ranges that are means by light: they move when one of two surfaces in a pixel gets brighter."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_table, per_view
from arl_fixtures.reconcile.effects_sides import part_of, sides_of
from arl_fixtures.reconcile.effects_surface import (
    at_centre,
    beyond_border,
    is_seen,
    light_share,
    mixed_rows,
    neighbours,
)
from arl_fixtures.reconcile.range_answer import answers
from arl_fixtures.reconcile.roles import Role, per_metre, unit_of
from arl_fixtures.reconcile.view import View

IntArray = NDArray[np.int64]
_LOOKED_AT, _APART, _BETWEEN = 20_000, 0.02, 0.02
_NEARER, _INSIDE = 0.8, 0.35
"""Share of the distance to the own surface within which the mean by light must lie for it to be that; how far from a
half a surface's share of a row's light may be for the row to tell."""
_SAME, _CLOSER, _FEWEST, _LEAST = 1e-3, 0.5, 8, 0.05
"""Relative difference up to which two ranges are one; share of the distance to a row's own surface within which the
mean by light must lie, rows that must say so, and what a row must see of the other surface to say it."""


def pulled_channels(view: View) -> tuple[str, ...]:
    """Distances that move when one of two surfaces in a pixel gets brighter."""
    return tuple(name for name in distances(view) if _mixes_ranges(view, name)) if view.labels("surface") else ()


def pulled_by(view: View, channel: str) -> tuple[str, ...]:
    """Distances that move when one of two surfaces gets brighter; of a comparator those that are means by light."""
    return means_by_light(view, channel) if answers(view) else pulled_channels(view)


def means_by_light(view: View, channel: str) -> tuple[str, ...]:
    """Distances whose simulation in mixed pixels is nearer to the mean by light of both surfaces than to one's own.

    A threshold that the first of two echoes crosses has distances between both as well, and no light moves them so.
    """
    key = "means by light", channel
    return per_table(view, key, lambda: tuple(n for n in pulled_channels(view) if _is_mean(view, n, channel)))


def _is_mean(view: View, name: str, channel: str) -> bool:
    whole = View(view.columns)
    mixed, own = np.flatnonzero(mixed_rows(whole))[:_LOOKED_AT], np.full(whole.n, np.nan)
    codes, labels = whole.codes("surface")
    for index, label in enumerate(labels):
        on = codes == index
        if on[mixed].any():
            own = np.where(on, light_share(whole, channel, label), own)
    share = own[mixed]
    centre, beyond, seen = (
        x[mixed] for x in (at_centre(whole, name), beyond_border(whole, name), whole.number(f"sim_{name}"))
    )
    mean = share * centre + (1.0 - share) * beyond
    with np.errstate(invalid="ignore"):
        at = np.isfinite(mean) & (np.abs(beyond - centre) > _APART * np.abs(centre)) & (np.abs(0.5 - share) < _INSIDE)
    if np.count_nonzero(at) < _FEWEST:
        return False
    return bool(np.median(np.abs(seen - mean)[at]) < _NEARER * np.median(np.abs(seen - centre)[at]))


def pull_ranges(view: View, state: State, channel: str, surface: str, factor: FloatArray) -> None:
    """Move the distance of pixels that see two surfaces towards the one whose light was multiplied.

    A distance that is the mean by light moves by (1 − 1/F) of the way to that surface, F being the change of the
    pixel's whole light. Only where the simulation's own distance lies between the surfaces: another reports the range
    of the middle ray, which no light moves.

    Args:
        view: rows under work.
        state: its distances are replaced.
        channel: signal that was multiplied; surface: whose light.
        factor: of the signal on every row.
    """
    for name in pulled_by(view, channel) if is_seen(view, surface) else ():
        at, there = per_view(view, ("pulled", channel, surface, name), partial(_pulled, view, channel, surface, name))
        if at.size:
            moved = state[name].copy()
            moved[at] += (1.0 - 1.0 / np.maximum(factor[at], 1e-3)) * (there - moved[at])
            state[name] = moved


def _pulled(view: View, channel: str, surface: str, name: str) -> tuple[IntArray, FloatArray]:
    """Rows that see a surface and another, and the range of the surface there."""
    share, own = light_share(view, channel, surface), view.selects("surface", surface)
    index = view.columns.categories["surface"][1].index(surface)
    column = "true_range_m" if "true_range_m" in view.columns.numbers else f"sim_{name}"
    unit = per_metre(unit_of(name)) if column == "true_range_m" else 1.0
    there = np.where(own, at_centre(view, name), np.nan)
    for codes, values in neighbours(view, column):
        there = np.where(np.isnan(there) & (codes == index), unit * values, there)
    at = np.flatnonzero(mixed_rows(view) & (share > 0.0) & np.isfinite(there))
    return at, there[at]


def _mixes_ranges(view: View, name: str) -> bool:
    """Whether the simulated distance of mixed pixels lies between those of their surfaces."""

    def look() -> bool:
        whole = View(view.columns)
        mixed = np.flatnonzero(mixed_rows(whole))[:_LOOKED_AT]
        if mixed.size == 0:
            return False
        centre, beyond, own = (
            x[mixed] for x in (at_centre(whole, name), beyond_border(whole, name), whole.number(f"sim_{name}"))
        )
        apart = np.abs(beyond - centre) > _APART * np.abs(centre)
        off = np.abs(own - centre)[apart] > _BETWEEN * np.abs(beyond - centre)[apart]
        return bool(off.size and np.mean(off) > 0.2) or _follow_light(whole, mixed, name)

    return per_table(view, ("mixes ranges", name), look)


def _follow_light(whole: View, mixed: IntArray, name: str) -> bool:
    """Whether the ranges of mixed rows that are called true are the simulated ones, means by light of two sides."""
    channel = whole.channel(Role.INTENSITY)
    if not channel or "true_range_m" not in whole.columns.numbers:
        return False
    own, true = whole.number(f"sim_{name}")[mixed], whole.number("true_range_m")[mixed] * per_metre(unit_of(name))
    view = View(whole.columns, mixed[np.abs(true - own) < _SAME * np.abs(own)])
    sides = sides_of(view)
    if sides is None:
        return False
    own, light, part = view.number(f"sim_{name}"), view.number(f"sim_{channel}"), part_of(sides, view, channel)
    (near, beyond), (_, other) = sides.seen(view, f"sim_{name}"), sides.seen(view, f"sim_{channel}")
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = near + part * other / light * (beyond - near)
        at = np.isfinite(mean) & (np.abs(beyond - near) > _APART * np.abs(near)) & (part > _LEAST)
    if np.count_nonzero(at) < _FEWEST:
        return False
    return bool(np.median(np.abs(own - mean)[at]) < _CLOSER * np.median(np.abs(own - near)[at]))
