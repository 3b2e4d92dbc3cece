"""An internal reflection adds a mirrored image."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import amplitude, light_channels, per_table, shape, signals
from arl_fixtures.reconcile.effects_frame import add_stray_light, has_frames, ranged_by
from arl_fixtures.reconcile.effects_image import mirrored_image
from arl_fixtures.reconcile.effects_mirror import Mirror, mirrored, mirrored_blur, mirrored_range
from arl_fixtures.reconcile.effects_overlap import overlap_shape, within
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_BESIDE = {"u": (0.0, -1.5, 1.5, -3.0, 3.0), "v": (0.0, -1.5, 1.5)}  # whole pixels of shift: one look-up each
_SOFT_BESIDE = {"u": (0.0, -2.5, 2.5), "v": (0.0,)}  # a blur of 1.5 px reaches as far
_WIDEST_PX = 6.0
_KINDS: dict[str, dict[str, Option]] = {"": {}, "soft": {"soft": True}, "pulse": {"over": "pulse"}}
_FLIPS = {"point": (True, True), "columns": (True, False), "rows": (False, True)}


class Ghost(Effect):
    """I(u, v) += share·I(2·centre_u − u, 2·centre_v − v); the distance moves towards the mirrored pixel's.

    A ghost is seldom in focus: with `blur` the mirrored image is spread by a Gaussian of that standard deviation.
    A pulsed sensor reads of it only what comes back within the pixel's own pulse (`over` pulse).
    """

    id = "optics.ghost"
    stage = Stage.OPTICS
    source = "Hullin et al., ACM Trans. Graph. 30 (2011) 108: lens flares and ghosts from pairs of interfaces"
    mixes = True
    confusable = ("optics.veiling_glare", "air.multipath")

    def variants(self, view: View) -> Iterable[Variant]:
        """Mirrored about the optical axis, sharp or spread; about its column, about its row."""
        if not has_frames(view):
            return
        for channel in signals(view):
            moved = ranged_by(view, channel)
            kinds = [*((flip, "") for flip in _FLIPS), ("point", "soft")]
            if moved and np.ptp(view.span(f"sim_{moved[0]}")) > 0.0:
                kinds.append(("point", "pulse"))
            for flip, kind in kinds:
                across, along = _FLIPS[flip]
                if (across and not view.varies("pixel_u")) or (along and not view.varies("pixel_v")):
                    continue
                parameters: list[Parameter] = [amplitude("share", "1", 0.0, 0.5, 0.01)]
                beside = _SOFT_BESIDE if kind else _BESIDE
                for letter, used in (("u", across), ("v", along)):
                    if used:
                        middle = _axis(view, letter)
                        parameters.append(
                            shape(
                                f"centre_{letter}",
                                "px",
                                middle - 5.0,
                                middle + 5.0,
                                *(middle + x for x in (beside[letter] if flip == "point" else (0.0,))),
                            )
                        )
                if kind == "soft":
                    parameters.append(shape("blur", "px", 0.2, _WIDEST_PX, 1.5))
                if kind == "pulse":  # a filter that is steepest beside the peak follows more than a centroid
                    parameters += [shape("pull", "1", 0.0, 4.0, 1.0), overlap_shape(view, moved[0])]
                elif moved:
                    parameters.append(shape("pull", "1", 0.0, 1.5, 0.5))
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "flip": flip} | _KINDS[kind],
                    parameters=tuple(parameters),
                    channels=tuple(dict.fromkeys((*moved, *light_channels(view, channel)))),
                    drivers=tuple(name for name in ("pixel_u", "pixel_v") if view.varies(name)),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the mirrored pixel's light with its range."""
        channel, share = str(variant.options["channel"]), float(values["share"])
        across, along = _FLIPS[str(variant.options["flip"])]
        mirror = Mirror(float(values.get("centre_u", 0.0)), float(values.get("centre_v", 0.0)), across, along)
        blur = float(values.get("blur", 0.0))
        rendered = mirrored_image(view, mirror, blur)
        pulsed = variant.options.get("over") == "pulse"
        moved = ranged_by(view, channel) if pulsed or float(values.get("pull", 0.0)) > 0.0 else ()
        if rendered is not None:
            seen = rendered[0] * state[channel]
            far = {distance: rendered[1][distance] for distance in moved}
        elif blur > 0.0:
            seen = mirrored_blur(view, state, channel, mirror, blur)
            far = {distance: mirrored_range(view, distance, channel, mirror, blur) for distance in moved}
        else:
            seen = mirrored(view, state, channel, mirror)
            far = {distance: mirrored(view, state, distance, mirror) for distance in moved}
        if pulsed:
            seen = seen * within(far[moved[0]] - state[moved[0]], float(values["overlap"]))
        add_stray_light(
            view, state, channel, stray=share * seen, far=far, pull=float(values.get("pull", 0.0)), kept=1.0
        )

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel = variant.options["channel"]
        across, along = _FLIPS[str(variant.options["flip"])]
        u = "2 centre_u - pixel_u" if across else "pixel_u"
        v = "2 centre_v - pixel_v" if along else "pixel_v"
        spread = ", spread by `blur`" if variant.options.get("soft") else ""
        if variant.options.get("over") == "pulse":
            spread = " * exp(-(its distance - distance)^2 / (2 overlap^2))"
        added = f"share * {channel}[{u}, {v}]{spread}"
        return f"{channel} += {added}; distance moves by pull * (share of the ghost's light)"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Share and mirror."""
        about = ", ".join(f"{x} = {values[f'centre_{x}']:.1f}" for x in "uv" if f"centre_{x}" in values)
        focus = f", out of focus by {values['blur']:.1f} pixels" if "blur" in values else ""
        if "overlap" in values:
            unit = unit_of(ranged_by(view, str(variant.options["channel"]))[0])
            focus = f"; what lies within {values['overlap']:.2g} {unit} of a pixel's own range is read with its pulse"
        return (
            f"An internal reflection adds {values['share'] * 100:.2f} % of the image, mirrored about pixel {about}"
            f"{focus}."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What shows it."""
        return (
            "Put one bright target on one side of the field: a ghost appears on the other side and moves against it."
        )


def _axis(view: View, letter: str) -> float:
    """Pixel coordinate of the optical axis: where the ray's angle is zero, else the middle of the image."""

    def find() -> float:
        pixel = view.columns.numbers[f"pixel_{letter}"]
        name = "azimuth_deg" if letter == "u" else "elevation_deg"
        low, high = view.span(f"pixel_{letter}")
        if name in view.columns.numbers:
            angle = view.columns.numbers[name]
            near = np.isfinite(angle) & (np.abs(angle) < 10.0)
            if near.any() and np.ptp(angle[near]) > 0.0:
                slope, start = np.polyfit(angle[near], pixel[near], 1)
                if slope != 0.0 and low - 50.0 < start < high + 50.0:
                    return float(np.round(start * 2.0) / 2.0)
        return (low + high) / 2.0

    return per_table(view, ("axis", letter), find)
