"""Frames belong to an earlier stage angle, or are taken while the stage still settles."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    distances,
    per_view,
    set_light,
    shape,
    signals,
)
from arl_fixtures.reconcile.effects_pointing import scanned_channels, turn_stage
from arl_fixtures.reconcile.effects_scene import scene
from arl_fixtures.reconcile.view import View

_PLACES = np.linspace(0.0, 1.0, 6)
"""Shares of the way back to the stage position before at which the scene is looked up."""


class FrameLag(Effect):
    """The frames of a row do not all show its stage position.

    * late: X' = (1 − share)·X + share·X at the stage position `frames` earlier in time.
    * settling: frame k (from 0) is taken at `creep`·exp(−k / decay) of the way back to the position before.

    The mixture widens the scatter.
    """

    id = "acquisition.frame_lag"
    stage = Stage.BOOKKEEPING
    source = (
        "book-keeping: a frame buffer of n frames read n frames late (share 1: all frames of an angle are stale); "
        "settling of a first-order drive"
    )
    mixes = True
    confusable = ("stage.zero_offset", "mount.tilt", "target.edge_mixing")

    def variants(self, view: View) -> Iterable[Variant]:
        """One and two positions late; settling where a row averages several frames of a scene that is scanned."""
        if not view.varies("stage_angle_deg") or not (signals(view) or distances(view)):
            return
        drivers = ("stage_angle_deg", "time_s") if view.varies("time_s") else ("stage_angle_deg",)
        for frames in (1, 2):
            yield Variant(
                effect=self.id,
                options={"frames": frames},
                parameters=(amplitude("share", "1", 0.0, 1.0, 0.2),),
                channels=scanned_channels(view),
                drivers=drivers,
            )
        if view.has("n_frames") and view.middle("n_frames") >= 2.0 and scene(view) is not None:
            count = int(view.middle("n_frames"))
            yield Variant(
                effect=self.id,
                options={"frames": 1, "kind": "settling", "averaged": count},
                parameters=(
                    amplitude("creep", "1", 0.0, 1.0, 0.2),
                    shape("decay", "frames", 0.3, 5.0 * count, 0.3 * count),
                ),
                channels=scanned_channels(view),
                drivers=drivers,
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Mixes in what the same pixel saw before, or on the way."""
        if "creep" in values:
            _settle(variant, values, state, view)
            return
        share = float(values["share"])
        for name in (*signals(view), *distances(view)):
            own = state[name]
            before = view.acquired_before(state, name, frames=int(variant.options["frames"]))
            apart: FloatArray = np.where(np.isfinite(before), before - own, 0.0)
            state[name] = own + share * apart
            scatter = f"{name}_std"
            if scatter in state:
                state[scatter] = np.sqrt(state[scatter] ** 2 + share * (1.0 - share) * np.nan_to_num(apart) ** 2)

    def expression(self, variant: Variant) -> str:
        """The law."""
        if variant.options.get("kind") == "settling":
            return "X = mean over frames k of X at stage_angle_deg + creep * exp(-k / decay) * (angle before - angle)"
        return f"X = (1 - share) * X + share * X[{variant.options['frames']} stage position(s) earlier]"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Share of stale frames, or how far the stage was from its place."""
        if "creep" in values:
            return (
                f"The stage still settles while frames are taken: at the first it is {values['creep'] * 100:.0f} % "
                f"of the way back to the position before, {values['decay']:.1f} frames later a third of that."
            )
        return (
            f"{values['share'] * 100:.0f} % of the frames of an angle still belong to the stage position "
            f"{variant.options['frames']} earlier."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a stage zero."""
        return (
            "Sweep the angles in the other direction, or wait longer before each frame set: a lag turns round or "
            "goes."
        )


def _settle(variant: Variant, values: Values, state: State, view: View) -> None:
    """Mean over the frames of what is seen on the way, straight lines between the places looked up."""
    frame = np.arange(float(variant.options["averaged"]))
    way = float(values["creep"]) * np.exp(-frame / float(values["decay"]))
    near = np.stack([np.interp(way, _PLACES, corner) for corner in np.eye(len(_PLACES))])  # of each frame, each place
    shares, pairs = near.mean(axis=1), near @ near.T / len(frame)
    seen = per_view(view, "on the way", lambda: _on_the_way(view))
    for name in (*distances(view), *signals(view)):
        own = state[name]
        light = name in signals(view)
        places = [own * change if light else own + change for change in seen[name]]
        mean = own + sum(share * (place - own) for share, place in zip(shares, places, strict=True))
        if light:
            set_light(view, state, name, mean)
        else:
            state[name] = mean
        scatter = f"{name}_std"
        if scatter in state:
            off = [place - mean for place in places]
            wide = sum(pairs[i, j] * off[i] * off[j] for i, j in np.argwhere(pairs > 0.0))
            state[scatter] = np.sqrt(state[scatter] ** 2 + np.maximum(np.nan_to_num(wide), 0.0))


def _on_the_way(view: View) -> dict[str, list[FloatArray]]:
    """By channel, at each of `_PLACES`: ratio of a signal and difference of a distance to the row's own position."""
    place = view.acquired_place(1)
    before = view.take_number("stage_angle_deg", place)
    back = np.nan_to_num(before - view.number("stage_angle_deg"))
    names = (*signals(view), *distances(view))
    seen: dict[str, list[FloatArray]] = {name: [] for name in names}
    for share in _PLACES:
        there = {name: view.sim[name] for name in names}
        if share > 0.0:
            turn_stage(view, there, share * back)
        for name in names:
            with np.errstate(invalid="ignore", divide="ignore"):
                change = there[name] / view.sim[name] if name in signals(view) else there[name] - view.sim[name]
            seen[name].append(np.where(np.isfinite(change), change, 1.0 if name in signals(view) else 0.0))
    return seen
