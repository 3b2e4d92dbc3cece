"""Light that bounced twice lengthens the path."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, amplitude, distances, light_channels, shape
from arl_fixtures.reconcile.effects_frame import add_stray_light, has_frames
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import View

_REACH_PX = (2, 5, 9)


class Multipath(Effect):
    """I += share·(light of the surroundings); the distance moves by (share of that light)·detour.

    Surroundings are the whole image (light that fills the room), or the columns within nine pixels (a bright panel
    beside a dark one). The detour is always longer than the direct way: distances grow, most for weak pixels.
    """

    id = "air.multipath"
    stage = Stage.AIR
    source = (
        "Naik, Kadambi, Rhemann, Izadi, Raskar, Kang, CVPR 2015: light transport model of multi-path interference"
    )
    confusable = ("optics.veiling_glare", "timing.range_walk", "optics.ghost")

    def variants(self, view: View) -> Iterable[Variant]:
        """The whole image and the near columns."""
        channel = view.channel(Role.INTENSITY)
        if not channel or not distances(view) or not has_frames(view):
            return
        unit = unit_of(distances(view)[0])
        size = 1e3 if unit == "mm" else 1.0
        for source in ("image", "near") if view.varies("pixel_u") else ("image",):
            yield Variant(
                effect=self.id,
                options={"surroundings": source},
                parameters=(
                    amplitude("share", "1", 0.0, 0.5, 0.01),
                    shape("detour", unit, 0.01 * size, 5.0 * size, 0.4 * size),
                ),
                channels=tuple(dict.fromkeys((*distances(view), *light_channels(view, channel)))),
                drivers=(f"sim_{channel}", *(name for name in ("azimuth_deg", "pixel_u") if view.varies(name)))[:2],
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the detoured light."""
        channel = view.channel(Role.INTENSITY)
        if variant.options["surroundings"] == "image":
            around = view.frame_mean(state, channel)
        else:
            around = _beside(view, state, channel)
        add_stray_light(
            view,
            state,
            channel,
            stray=float(values["share"]) * around,
            far={name: state[name] + float(values["detour"]) for name in distances(view)},
            pull=1.0,
            kept=1.0,
        )

    def expression(self, variant: Variant) -> str:
        """The law."""
        around = "of the image" if variant.options["surroundings"] == "image" else "of the columns beside"
        return f"signal += share * S; distance += detour * share * S / (signal + share * S), S = mean signal {around}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Share and detour."""
        return (
            f"{values['share'] * 100:.2f} % of the surroundings' light arrives over a detour of "
            f"{values['detour']:.2f} "
            f"{unit_of(distances(view)[0])} and lengthens the distances of weak pixels."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from range walk."""
        return "Cover the bright panel beside the dark one with black cloth: multipath goes, range walk stays."


def _beside(view: View, state: State, channel: str) -> FloatArray:
    """Mean signal of the columns at 2, 5 and 9 pixels to both sides, as far as the table holds them."""
    total, count = np.zeros(view.n), np.zeros(view.n)
    for reach in _REACH_PX:
        for du in (-reach, reach):
            value = view.neighbour(state, channel, du=du, dv=0)
            good = np.isfinite(value)
            total += np.where(good, value, 0.0)
            count += good
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
