"""A share of the frame's light spreads over the whole frame."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import GROUPS, amplitude, light_channels, rounded, shape, signals
from arl_fixtures.reconcile.effects_frame import add_stray_light, frame_range, has_frames, ranged_by
from arl_fixtures.reconcile.effects_halo import NEAREST_PX, halo, widest_halo
from arl_fixtures.reconcile.effects_image import whole_image
from arl_fixtures.reconcile.effects_overlap import can_overlap, overlap_shape, overlapping
from arl_fixtures.reconcile.effects_phasor import add_phasor, ambiguity_shape, image_phasor
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_FEW_PIXELS = 400
"""Pixels of an image, on average, of which the mean is not well known from them."""


def _is_strewn(view: View) -> bool:
    """Whether a stage sweeps an image of which the table holds few pixels."""
    if not view.varies("stage_angle_deg"):
        return False
    images = int(view.columns.group(*GROUPS["frame"]).max()) + 1
    return view.columns.n < _FEW_PIXELS * images


class VeilingGlare(Effect):
    """I' = (1 − share)·I + share·mean(I of the image); the distance moves towards the image's mean range.

    Of whole images also with a halo's light instead of the mean: what scatters in a lens falls off about its source.
    With ranges also with the light that comes back within the row's own pulse (a pulsed sensor reads no other), and
    with its phase (a camera that correlates a modulation adds phasors).
    Of an image of which the table holds few pixels, also with the mean over the sweep: as it turns they see what the
    whole image sees at once.
    """

    id = "optics.veiling_glare"
    stage = Stage.OPTICS
    source = "Schäfer, Lenzen, Garbe, Opt. Express 22 (2014) 29835: scattering model of a time-of-flight camera"
    mixes = True
    confusable = ("detector.dark_offset", "detector.compression", "air.multipath", "optics.defocus")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel of an imaging sensor."""
        share = amplitude("share", "1", 0.0, 0.5, 0.01)
        for channel in signals(view):
            moved = ranged_by(view, channel)
            pull = (shape("pull", "1", 0.0, 1.5, 1.0, 0.0),) if moved else ()
            overs: list[tuple[dict[str, Option], tuple[Parameter, ...]]] = [({}, pull)] if has_frames(view) else []
            if overs and _is_strewn(view) and whole_image(view) is None:
                overs.append(({"over": "sweep"}, pull))
            light = rounded(float(np.nanmean(view.columns.numbers[f"sim_{channel}"])))
            if moved and _is_strewn(view):
                low, high = view.span(f"sim_{moved[0]}")
                far = shape("far", unit_of(moved[0]), low, high, low + 0.75 * (high - low))
                overs.append(({"over": "scene", "light": light}, (far,)))
            widest = widest_halo(view)
            if overs and widest > 2.0 * NEAREST_PX:
                reach = shape("reach", "px", NEAREST_PX, widest, 2.0 * NEAREST_PX, widest)
                overs.append(({"over": "halo"}, (*pull, reach)))
            if moved and has_frames(view) and can_overlap(view, moved[0]):
                overs.append(({"over": "pulse"}, (shape("pull", "1", 0.0, 4.0, 1.0), overlap_shape(view, moved[0]))))
                overs.append(({"over": "phase"}, (ambiguity_shape(view, moved[0]),)))
            if moved:  # the distances tell of light whose mean was taken for the signal's zero
                known = [one for one in overs if one[0].get("over") not in ("sweep", "halo", "pulse", "phase")]
                overs += [({**over, "zero": light}, shapes) for over, shapes in known]
            for over, shapes in overs:
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, **over},
                    parameters=(share, *shapes),
                    channels=tuple(dict.fromkeys((*moved, *light_channels(view, channel)))),
                    drivers=(f"sim_{channel}",),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the mean light of the whole image (as far as it is known) with the image's mean range."""
        channel, share = str(variant.options["channel"]), float(values["share"])
        zero = share * float(variant.options.get("zero", 0.0))
        if variant.options.get("over") == "scene":
            add_stray_light(
                view, state, channel,
                stray=np.full(view.n, share * float(variant.options["light"])),
                far={distance: np.full(view.n, float(values["far"])) for distance in ranged_by(view, channel)},
                pull=1.0,
                kept=1.0 - share,
                zero=zero,
            )  # fmt: skip
            return
        if variant.options.get("over") == "halo":
            light, far = halo(view, state, channel, ranged_by(view, channel), float(values["reach"]))
            add_stray_light(
                view, state, channel, stray=share * light, far=far, pull=float(values.get("pull", 0.0)),
                kept=1.0 - share,
            )  # fmt: skip
            return
        if variant.options.get("over") == "pulse":
            moved = ranged_by(view, channel)
            light, mean_range = overlapping(view, state, channel, moved[0], float(values["overlap"]))
            add_stray_light(
                view, state, channel, stray=share * light, far=dict.fromkeys(moved, mean_range),
                pull=float(values.get("pull", 0.0)), kept=1.0 - share,
            )  # fmt: skip
            return
        if variant.options.get("over") == "phase":
            moved, ambiguity = ranged_by(view, channel), float(values["ambiguity"])
            stray = share * image_phasor(view, state, channel, moved[0], ambiguity)
            add_phasor(view, state, channel, moved, stray=stray, kept=1.0 - share, ambiguity=ambiguity)
            return
        over, whole = "frame", whole_image(view)
        mean = view.frame_mean(state, channel)
        if "over" in variant.options:
            over, whole = "step", None
            now = np.nanmean(state[channel]) / np.nanmean(view.sim[channel])
            mean = now * view.mean_of_group(f"sim_{channel}", *GROUPS[over])
        add_stray_light(
            view,
            state,
            channel,
            stray=share * (mean if whole is None else mean * whole[0]),
            far={
                distance: frame_range(view, distance, channel, over) if whole is None else whole[1][distance]
                for distance in ranged_by(view, channel)
            },
            pull=float(values.get("pull", 0.0)),
            kept=1.0 - share,
            zero=zero,
        )

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, over = variant.options["channel"], variant.options.get("over", "image")
        zero = f" - share * {variant.options['zero']}" if "zero" in variant.options else ""
        if over == "scene":
            return (
                f"{channel} = (1 - share) * {channel} + share * {variant.options['light']}{zero}; "
                "distance += (share of stray light) * (far - distance)"
            )
        if over == "halo":
            about = f"{channel} within `reach` pixels by a Gaussian"
            return (
                f"{channel} = (1 - share) * {channel} + share * mean({about}); "
                "distance += pull * (share of stray light) * (its mean distance - distance)"
            )
        if over == "pulse":
            near = f"{channel} of the image * exp(-(its distance - distance)^2 / (2 overlap^2))"
            return (
                f"{channel} = (1 - share) * {channel} + share * mean({near}); "
                "distance += pull * (share of stray light) * (its mean distance - distance)"
            )
        if over == "phase":
            return (
                f"{channel} and distance are length and angle of (1 - share) * z + share * mean(z of the image), "
                f"z = {channel} * exp(2 pi i distance / ambiguity)"
            )
        return (
            f"{channel} = (1 - share) * {channel} + share * mean({channel} of the {over}){zero}; "
            "distance += pull * (share of stray light) * (mean distance of the image - distance)"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The share in percent."""
        if "reach" in values:
            return (
                f"{values['share'] * 100:.2f} % of the light is scattered about its place, by {values['reach']:.1f} "
                "pixels (standard deviation), and veils what is dark there."
            )
        if "overlap" in values:
            unit = unit_of(ranged_by(view, str(variant.options["channel"]))[0])
            return (
                f"{values['share'] * 100:.2f} % of the light is scattered over the whole image; what comes from "
                f"within {values['overlap']:.2g} {unit} of a pixel's own range is read with its pulse."
            )
        if "ambiguity" in values:
            unit = unit_of(ranged_by(view, str(variant.options["channel"]))[0])
            return (
                f"{values['share'] * 100:.2f} % of the light is scattered over the whole image and adds to that of "
                f"each pixel with its phase, which goes round once in {values['ambiguity']:.2g} {unit}."
            )
        return (
            f"{values['share'] * 100:.2f} % of the light is scattered over the whole image and veils its dark parts."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from an offset."""
        return (
            "Cover the bright target and look at a dark one: glare falls with the frame's light, a dark offset stays."
        )
