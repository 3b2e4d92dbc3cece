"""Light that spreads over an image: its mean, its range, and how stray light pulls the measured distance."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import GROUPS, FloatArray, distances, per_table, per_view, set_light
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


def has_frames(view: View) -> bool:
    """Whether rows form images: several pixels that share a stage angle of a step."""

    def make() -> bool:
        if not (view.varies("pixel_u") or view.varies("pixel_v")):
            return False
        return int(view.columns.group(*GROUPS["frame"]).max()) + 1 < view.columns.n

    return per_table(view, "has frames", make)


def brighter(view: View, state: State, channel: str) -> FloatArray:
    """How much brighter than simulated each row's image is as a whole, by earlier stages; 1 where unknown."""
    with np.errstate(invalid="ignore", divide="ignore"):
        now = view.frame_mean(state, channel) / view.mean_of_group(f"sim_{channel}", *view.columns.image_columns)
    return np.where(np.isfinite(now), now, 1.0)


def between_widths(width: float, narrowest: float, ratio: float) -> dict[int, float]:
    """Number to weight of the two widths `narrowest·ratio^k` about one: linear in its logarithm."""
    place = max(float(np.log(width / narrowest) / np.log(ratio)), 0.0)
    low = int(place)
    return {low: 1.0 - (place - low), low + 1: place - low}


def frame_range(view: View, distance: str, channel: str, over: str = "frame") -> FloatArray:
    """Signal-weighted mean of the simulated distance over each row's image, or over another of `GROUPS`."""

    def make() -> FloatArray:
        code = view.columns.group(*GROUPS[over])
        light = view.columns.numbers[f"sim_{channel}"]
        far = view.columns.numbers[f"sim_{distance}"]
        good = np.isfinite(light) & np.isfinite(far) & (light > 0.0)
        weight = np.bincount(code, np.where(good, light, 0.0))
        total = np.bincount(code, np.where(good, light * np.nan_to_num(far), 0.0))
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray((total / weight)[code][view.rows])

    return per_view(view, ("frame range", distance, channel, over), make)


def add_stray_light(
    view: View,
    state: State,
    channel: str,
    *,
    stray: FloatArray,
    far: dict[str, FloatArray],
    pull: float,
    kept: float,
    zero: float = 0.0,
) -> None:
    """Add light from elsewhere to a signal, and mix its range into the distances.

    Args:
        view: rows under work.
        state: signal and distances are replaced.
        channel: the signal.
        stray: light that comes in, in the signal's unit; NaN counts as none.
        far: distance channel to the range of the stray light.
        pull: how much a distance follows the mixture: 1 for a centroid, 0 for a detector of the first edge.
        kept: share of the own light that stays in place.
        zero: light that a calibration took for the signal's zero.
    """
    own = state[channel]
    came = np.maximum(np.nan_to_num(stray), 0.0)
    total = kept * own + came
    with np.errstate(invalid="ignore", divide="ignore"):
        share = came / np.where(total > 0.0, total, np.nan)
    for distance, ranges in far.items():
        moved = pull * share * (ranges - state[distance])
        state[distance] = state[distance] + np.where(np.isfinite(moved), moved, 0.0)
    set_light(view, state, channel, total - zero)


def ranged_by(view: View, channel: str) -> tuple[str, ...]:
    """Distances that stray light in this signal moves: all for the table's first signal, none for others."""
    return distances(view) if view.channel(Role.INTENSITY) == channel else ()
