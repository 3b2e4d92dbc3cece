"""Light that bounced twice, seen from one place: every upright strip of what a sweep shows lights the others."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effects_bounce import bounced
from arl_fixtures.reconcile.effects_cloud import cloud
from arl_fixtures.reconcile.effects_common import FloatArray, distances, per_table
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import IntArray, View

_PATCH_DEG = 1.0
_SAME_SURFACE, _WIDEST_GAP, _LEAST_RISE_DEG = 0.05, 4, 3.0
"""Relative step of the distance from one degree to the next up to which it is one surface, degrees that may lie
between its strips, and the least elevation that its light is taken to reach."""


def room(view: View, *, beyond: bool = False) -> tuple[FloatArray, FloatArray] | None:
    """Light that each row's target gets from all others, over its mean, and that light's extra one-way path.

    Of every row of the whole table: of the rendered bench where that is known, else of what a sweep shows, or the
    images of a camera that stands still; None where there is neither. With `beyond`, of what such images show and
    what goes on about them; None where it is not they that tell.
    """
    if beyond:
        return None if bounced(view) is not None or view.varies("stage_angle_deg") else cloud(view, beyond=True)
    rendered = bounced(view)
    if rendered is not None:
        return rendered
    return per_table(view, "room", lambda: _room(view)) if view.varies("stage_angle_deg") else cloud(view)


def _room(view: View) -> tuple[FloatArray, FloatArray] | None:
    found = scene(view)
    channel, far = view.channel(Role.INTENSITY), distances(view)
    if (
        found is None
        or not view.varies("azimuth_deg")
        or not channel
        or not far
        or not view.varies("stage_angle_deg")
    ):
        return None
    table = view.columns
    light, range_ = table.numbers[f"sim_{channel}"], table.numbers[f"sim_{far[0]}"]
    rise_deg = ray_column(view, "elevation_deg")
    range_ = range_ * np.cos(np.radians(rise_deg))
    good = np.isfinite(light) & np.isfinite(range_) & (range_ > 0.0)
    bins = np.floor(found.bearing / _PATCH_DEG).astype(np.int64)
    count = np.bincount(bins[good], minlength=int(bins.max()) + 1)
    seen = np.flatnonzero(count)
    bright = np.bincount(bins[good], light[good], count.size)[seen] / count[seen]
    away = np.bincount(bins[good], range_[good], count.size)[seen] / count[seen]
    rise = float(np.quantile(np.abs(rise_deg), 0.9))
    lit, detour = _facing_each_other(seen, bright, away, max(rise, _LEAST_RISE_DEG))
    if not lit.max() > 0.0:
        return None
    place = found.bearing / _PATCH_DEG - 0.5
    strength = np.interp(place, seen, lit)
    return strength / float(strength.mean()), np.interp(place, seen, detour)


def _facing_each_other(
    seen: IntArray, bright: FloatArray, away: FloatArray, rise_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Twice-bounced light of upright strips over what lights them directly, and its extra one-way path.

    A strip is as bright as it looks. It sends its light on with the cosines of both ends; over the distance of two
    far strips and their height squared, over the distance of near ones (Hottel's strips).

    Args:
        seen: number of the bearing's bin of each strip, ascending; bright: its signal; away: its level distance.
        rise_deg: half of the height that is lit, seen from the sensor.
    """
    angle = np.radians((seen + 0.5) * _PATCH_DEG)
    place = away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    slope = np.zeros(len(seen))
    gap = np.diff(angle)
    joined = (np.diff(seen) <= _WIDEST_GAP) & (np.abs(np.diff(away)) < _SAME_SURFACE * np.diff(seen) * away[1:])
    for part in np.split(np.arange(len(seen)), np.flatnonzero(~joined) + 1):
        if len(part) > 1:
            slope[part] = _slopes(angle[part], away[part])
    # along a strip the distance grows by `slope` a radian, its normal leans by as much
    incidence = np.arctan2(slope, away)
    normal = -np.stack([np.cos(angle - incidence), np.sin(angle - incidence)], axis=1)
    across = place[None, :, :] - place[:, None, :]
    near = np.where(np.diff(seen) <= _WIDEST_GAP, gap, np.radians(_PATCH_DEG))  # a strip reaches half-way to the next
    half = 0.5 * np.concatenate([near[:1], near]), 0.5 * np.concatenate([near, near[-1:]])
    width = (half[0] + half[1]) * away / np.cos(incidence)
    apart = np.sqrt(np.sum(across**2, axis=2) + (0.5 * width[None, :]) ** 2)
    arriving = np.maximum(np.einsum("ijk,ik->ij", across, normal) / apart, 0.0)
    leaving = np.maximum(-np.einsum("ijk,jk->ij", across, normal) / apart, 0.0)
    height = away[None, :] * np.tan(np.radians(rise_deg))
    spread = apart * np.hypot(apart, height)
    weight = bright[None, :] * (width * height[0])[None, :] * arriving * leaving / spread
    light = weight.sum(axis=1) * away**2 / np.cos(incidence)
    longer = (weight * 0.5 * (away[None, :] + apart - away[:, None])).sum(axis=1)
    return light, longer / np.maximum(weight.sum(axis=1), 1e-300)


def _slopes(angle: FloatArray, away: FloatArray) -> FloatArray:
    """Slope of the distance at each strip, from the side on which it bends less: a corner is of one of its walls.

    (As essentially non-oscillatory schemes take differences: Harten and others, J. Comput. Phys. 71 (1987) 231.)
    """
    step = np.diff(away) / np.diff(angle)
    bend = np.concatenate([[np.inf], np.abs(np.diff(step)), [np.inf]])  # about each strip but the ends
    left, right = np.concatenate([step[:1], step]), np.concatenate([step, step[-1:]])
    before, after = np.concatenate([bend[:1], bend[:-1]]), np.concatenate([bend[1:], bend[-1:]])
    smooth = bend < 2.0 * np.minimum(before, after)
    return np.where(smooth, 0.5 * (left + right), np.where(before < after, left, right))
