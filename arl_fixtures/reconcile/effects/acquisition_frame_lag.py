"""Frames belong to an earlier stage angle."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, amplitude, distances, signals
from arl_fixtures.reconcile.effects_scene import scanned_channels
from arl_fixtures.reconcile.view import View


class FrameLag(Effect):
    """X' = (1 − share)·X + share·X at the stage position `frames` earlier in time; the mixture widens the scatter."""

    id = "acquisition.frame_lag"
    stage = Stage.BOOKKEEPING
    source = "book-keeping: a frame buffer of n frames read n frames late; share 1 = all frames of an angle are stale"
    confusable = ("stage.zero_offset", "mount.tilt", "target.edge_mixing")

    def variants(self, view: View) -> Iterable[Variant]:
        """One and two positions late."""
        if not view.varies("stage_angle_deg") or not (signals(view) or distances(view)):
            return
        for frames in (1, 2):
            yield Variant(
                effect=self.id,
                options={"frames": frames},
                parameters=(amplitude("share", "1", 0.0, 1.0, 0.2),),
                channels=scanned_channels(view),
                drivers=("stage_angle_deg", "time_s") if view.varies("time_s") else ("stage_angle_deg",),
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Mixes in what the same pixel saw before."""
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
        return f"X = (1 - share) * X + share * X[{variant.options['frames']} stage position(s) earlier]"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Share of stale frames."""
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
