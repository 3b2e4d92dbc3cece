"""Borders of surfaces beside a scanner's beam: how far away along its ring, and which ray lies beyond them.

A beam is wider than the step from ray to ray where a scanner samples finely: then several rays at a border see both
of its sides, each as much as its distance from the border says. The part of a Gaussian footprint beyond a straight
border is a normal law's tail.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import erfc

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import distances, per_table, set_light
from arl_fixtures.reconcile.effects_echoes import climbed
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.roles import Role, per_metre, unit_of
from arl_fixtures.reconcile.view import View

_LEAST_PART = 1e-4
"""Of a footprint that must lie beyond a border to count."""
_DIGITS, _FEWEST_IN_RING, _FEWEST_BORDERS = 2, 20, 6
"""Decimals of degrees by which rings are told apart, rays that make one, and borders that tell of a footprint."""


class Border(NamedTuple):
    """Of every row of the whole table: degrees to the next border on one side, inf without; the row beyond, or −1."""

    away_deg: FloatArray
    beyond: IntArray


def beam_borders(view: View) -> tuple[Border, Border] | None:
    """The next border on either side of each ray; None where no scanner's rings show some."""
    return per_table(view, "beam borders", lambda: _find(View(view.columns)))


def usual_step_deg(view: View) -> float:
    """Median step from ray to ray along a ring, degrees."""
    return per_table(view, "step along rings", lambda: _step(View(view.columns)))


def footprint_beyond(away_deg: FloatArray, width_deg: float) -> FloatArray:
    """Part of a Gaussian beam of standard deviation `width_deg` that lies beyond a border."""
    return np.asarray(0.5 * erfc(away_deg / (np.sqrt(2.0) * width_deg)))


def see_footprint(
    view: View, state: State, share: float, width_deg: float, pulse_m: float, *, locked: bool
) -> None:  # fmt: skip
    """Give rows near borders a share of what a footprint sees: an echo's peak, and the light within its pulse.

    Args:
        view: rows under work; state: corrected so far, is changed.
        share: how much of it.
        width_deg, pulse_m: standard deviations of the footprint and of an echo.
        locked: of the echo of the middle's surface, not of the strongest one.
    """
    found, channel, first = beam_borders(view), view.channel(Role.INTENSITY), distances(view)[0]
    if found is None:
        return
    parts = [footprint_beyond(border.away_deg[view.rows], width_deg) for border in found]
    places = [border.beyond[view.rows] for border in found]
    own = np.maximum(1.0 - sum(parts), 0.0)
    here = np.flatnonzero(own < 1.0 - _LEAST_PART)

    def both_sides(name: str) -> FloatArray:
        return np.stack([state[name][here], *(view.take(state, name, place)[here] for place in places)], axis=1)

    light = both_sides(channel) if channel else np.ones((here.size, 3))
    echoes = np.stack([own, *parts], axis=1)[here] * np.nan_to_num(light)
    ranges = {name: both_sides(name) for name in distances(view)}
    echoes = np.where(np.isfinite(ranges[first]), echoes, 0.0)
    middle = np.zeros(here.size, dtype=np.int64) if locked else np.argmax(echoes, axis=1)
    for name, there in ranges.items():
        start = np.take_along_axis(np.nan_to_num(there), middle[:, None], axis=1)[:, 0]
        width = pulse_m * per_metre(unit_of(name))
        peak = climbed(echoes, np.nan_to_num(there), start, width)
        moved = state[name].copy()
        moved[here] += share * (peak - moved[here])
        state[name] = moved
        if name == first:
            within = np.nansum(echoes * np.exp(-0.5 * ((there - peak[:, None]) / width) ** 2), axis=1)
    if channel:
        seen = state[channel].copy()
        seen[here] += share * (within - seen[here])
        set_light(view, state, channel, seen)


def _rings(view: View) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows in the order of their rings and azimuths, the ring of each, and its azimuth times the ring's radius."""
    return per_table(view, "rings", lambda: _make_rings(view))


def _make_rings(view: View) -> tuple[IntArray, IntArray, FloatArray]:
    azimuth, rise = (ray_column(view, name) for name in ("azimuth_deg", "elevation_deg"))
    level = np.unique(np.round(rise, _DIGITS), return_inverse=True)[1].astype(np.int64)
    image = view.columns.group(*view.columns.image_columns)
    ring = np.unique(image * (int(level.max()) + 1) + level, return_inverse=True)[1].astype(np.int64)
    along = azimuth * np.cos(np.radians(rise))
    order = np.lexsort((along, ring))
    return order, ring[order], along[order]


def _find(view: View) -> tuple[Border, Border] | None:
    pixels = view.varies("pixel_u") or view.varies("pixel_v")
    if pixels or view.varies("stage_angle_deg") or not view.varies("azimuth_deg") or not view.labels("surface"):
        return None
    order, ring, along = _rings(view)
    if view.n < _FEWEST_IN_RING * (int(ring.max()) + 1):
        return None
    codes = view.columns.categories["surface"][0][order]
    change = np.flatnonzero((np.diff(codes) != 0) & (np.diff(ring) == 0))
    if len(change) < _FEWEST_BORDERS:
        return None
    middle = 0.5 * (along[change] + along[change + 1])
    after = np.searchsorted(change, np.arange(view.n))
    found = []
    for nearest, step in ((after, 1), (after - 1, 0)):
        there = np.clip(nearest, 0, len(change) - 1)
        seen = (nearest >= 0) & (nearest < len(change)) & (ring[change[there]] == ring)
        away, beyond = np.full(view.n, np.inf), np.full(view.n, -1, dtype=np.int64)
        away[order] = np.where(seen, np.abs(middle[there] - along), np.inf)
        beyond[order] = np.where(seen, order[change[there] + step], -1)
        found.append(Border(away, beyond))
    return found[0], found[1]


def _step(view: View) -> float:
    _, ring, along = _rings(view)
    return float(np.median(np.diff(along)[np.diff(ring) == 0]))
