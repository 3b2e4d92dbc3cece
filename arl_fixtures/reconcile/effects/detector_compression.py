"""The detector's response flattens towards high signal."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    rounded,
    set_response,
    shape,
    signals,
    top_signal,
    with_scatter,
)
from arl_fixtures.reconcile.view import View


class Compression(Effect):
    """A limiter, I' = I / (1 + x^sharpness)^(1/sharpness), or a full well, I' = I·(1 − exp(−x)) / x.

    x = strength·I / I_top, where I_top is the table's strongest simulated signal. Of the limiter sharpness 1 bends
    everywhere, large values are a straight line up to a knee at I_top / strength.
    """

    id = "detector.compression"
    stage = Stage.DETECTOR
    source = (
        "Rapp, Proc. 2nd European Conf. on Satellite Communications (1991) 179: smooth limiter with knee sharpness"
    )
    confusable = ("detector.pile_up", "target.reflectance_error", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """Two per intensity channel: a limiter whose knee is free, and a full well."""
        for channel in signals(view):
            for kind in ("limiter", "well"):
                knee = (shape("sharpness", "1", 0.5, 12.0, 1.5, 5.0),) if kind == "limiter" else ()
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "top": rounded(top_signal(view, channel)), "kind": kind},
                    parameters=(amplitude("strength", "1", 0.0, 20.0, 0.2), *knee),
                    channels=with_scatter(view, channel),
                    drivers=(f"sim_{channel}",),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Bends the signal; its scatter shrinks with the local slope."""
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

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, top = variant.options["channel"], variant.options["top"]
        if variant.options.get("kind") == "well":
            return f"{channel} = top / strength * (1 - exp(-strength * {channel} / top)), top = {top}"
        return (
            f"{channel} /= (1 + (strength * {channel} / top)^sharpness)^(1/sharpness), top = {variant.options['top']}"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss at the strongest signal and knee."""
        channel = str(variant.options["channel"])
        top, strength = float(variant.options["top"]), float(values["strength"])
        power = float(values.get("sharpness", 0.0))
        kept = np.exp(-np.log1p(strength**power) / power) if power else -np.expm1(-strength) / max(strength, 1e-9)
        lost = (1.0 - kept) * 100.0
        knee = top / max(strength, 1e-9)
        return (
            f"Strong signals are compressed: {lost:.1f} % are missing at {top:.0f}; saturation level {knee:.0f} "
            f"({channel})."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a target's certificate."""
        return (
            "Put a neutral-density filter in front of the window or move the bright target away: compression follows "
            "the signal, an error of the target's reflectance stays."
        )
