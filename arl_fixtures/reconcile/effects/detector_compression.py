"""The detector's response flattens towards high signal."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    in_mm,
    rounded,
    set_response,
    shape,
    signals,
    top_signal,
    with_scatter,
)
from arl_fixtures.reconcile.effects_counting import counts_photons
from arl_fixtures.reconcile.effects_frame import ranged_by
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View


class Compression(Effect):
    """A limiter, I' = I / (1 + x^sharpness)^(1/sharpness), or a full well, I' = I·(1 − exp(−x)) / x.

    x = strength·I / I_top, where I_top is the table's strongest simulated signal. Of the limiter sharpness 1 bends
    everywhere, large values are a straight line up to a knee at I_top / strength. A pulse whose top is flattened is
    timed elsewhere, to either side: the distance moves by shift · (1 − I'/I).
    """

    id = "detector.compression"
    stage = Stage.DETECTOR
    source = (
        "Rapp, Proc. 2nd European Conf. on Satellite Communications (1991) 179: smooth limiter with knee sharpness"
    )
    confusable = ("detector.pile_up", "target.reflectance_error", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """Per intensity channel: a limiter whose knee is free, a full well, a limiter that shifts the distance.

        What counts photons one by one has but a hard limit: dead time bends it.
        """
        for channel in signals(view):
            top = rounded(top_signal(view, channel))
            counted = counts_photons(view, channel)  # no charge and no voltage to be full of: a counter that is full
            knee = shape("sharpness", "1", *((4.0, 12.0, 6.0) if counted else (0.5, 12.0, 1.5, 5.0)))
            for kind, further in (("limiter", (knee,)), *(() if counted else (("well", ()),))):
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "top": top, "kind": kind},
                    parameters=(amplitude("strength", "1", 0.0, 20.0, 0.2), *further),
                    channels=with_scatter(view, channel),
                    drivers=(f"sim_{channel}",),
                )
            for distance in () if counted else ranged_by(view, channel)[:1]:
                size = per_metre(unit_of(distance))
                shift = shape("shift", unit_of(distance), -5.0 * size, 5.0 * size, 0.05 * size, -0.05 * size)
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "top": top, "kind": "limiter", "distance": distance},
                    parameters=(amplitude("strength", "1", 0.0, 20.0, 0.2), knee, shift),
                    channels=tuple(dict.fromkeys((*with_scatter(view, channel), distance))),
                    drivers=(f"sim_{channel}",),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Bends the signal; its scatter shrinks with the local slope, the distance moves by what is lost."""
        channel = str(variant.options["channel"])
        light = state[channel]
        filled = np.clip(values["strength"] * light / float(variant.options["top"]), 0.0, 1e4)
        if "sharpness" not in values:
            share = -np.expm1(-filled) / np.maximum(filled, 1e-12)
            set_response(state, channel, light * np.where(filled > 1e-9, share, 1.0), np.exp(-filled))
            return
        power = float(values["sharpness"])
        grown = np.log1p(filled**power)
        bent = np.exp(-grown / power)
        set_response(state, channel, light * bent, bent * np.exp(-grown))
        if "shift" in values:
            distance = str(variant.options["distance"])
            state[distance] = state[distance] + float(values["shift"]) * np.nan_to_num(1.0 - bent)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, top = variant.options["channel"], variant.options["top"]
        if variant.options.get("kind") == "well":
            return f"{channel} = top / strength * (1 - exp(-strength * {channel} / top)), top = {top}"
        law = f"{channel} /= (1 + (strength * {channel} / top)^sharpness)^(1/sharpness), top = {top}"
        distance = variant.options.get("distance")
        return f"{law}; {distance} += shift * (lost share of {channel})" if distance else law

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss at the strongest signal and knee."""
        channel = str(variant.options["channel"])
        top, strength = float(variant.options["top"]), float(values["strength"])
        power = float(values.get("sharpness", 0.0))
        kept = np.exp(-np.log1p(strength**power) / power) if power else -np.expm1(-strength) / max(strength, 1e-9)
        lost = (1.0 - kept) * 100.0
        knee = top / max(strength, 1e-9)
        text = f"Strong signals are compressed: {lost:.1f} % are missing at {top:.0f}; saturation level {knee:.0f} "
        if "shift" not in values:
            return f"{text}({channel})."
        moved = in_mm(float(values["shift"]) * (1.0 - kept), str(variant.options["distance"]))
        return f"{text}({channel}), and their flattened pulses are ranged {moved:+.2f} mm off there."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a target's certificate."""
        return (
            "Put a neutral-density filter in front of the window or move the bright target away: compression follows "
            "the signal, an error of the target's reflectance stays."
        )
