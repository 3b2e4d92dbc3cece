"""A part of the window transmits less, always."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, LightFactor, amplitude, light_channels, shape, signals
from arl_fixtures.reconcile.view import View


class WindowContamination(LightFactor):
    """I *= 1 − loss·spot(u, v): an ellipse in the image with a soft rim, the same at every angle and temperature."""

    id = "optics.window_contamination"
    stage = Stage.OPTICS
    source = "DIN SAE SPEC 91571 (2026): dirt on sensor windows; two passes of light through the same spot"
    confusable = ("detector.pixel_response", "optics.vignetting", "beam.profile_change")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel, started on a raster of places whose spots touch."""
        axes = [name for name in ("pixel_u", "pixel_v") if view.varies(name)]
        if not axes:
            return
        for channel in signals(view):
            parameters = [amplitude("loss", "1", 0.0, 0.99, 0.05)]
            for axis in axes:
                low, high = view.span(axis)
                wide = high - low
                letter = axis[-1]
                places = (1 / 8, 3 / 8, 5 / 8, 7 / 8) if letter == "u" else (1 / 6, 1 / 2, 5 / 6)
                parameters.append(shape(f"centre_{letter}", "px", low, high, *(low + x * wide for x in places)))
                least = 0.5 if wide < 4.0 else 1.0
                parameters.append(shape(f"radius_{letter}", "px", least, max(0.6 * wide, 2.0 * least), 0.17 * wide))
            yield Variant(
                effect=self.id,
                options={"channel": channel},
                parameters=tuple(parameters),
                channels=light_channels(view, channel),
                drivers=tuple(axes),
            )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Transmission of the spot, both ways of the light."""
        square = np.zeros(view.n)
        for letter in "uv":
            if f"centre_{letter}" in values:
                away = view.number(f"pixel_{letter}") - float(values[f"centre_{letter}"])
                square = square + (away / float(values[f"radius_{letter}"])) ** 2
        inside = np.exp(-np.log(2.0) * np.minimum(np.nan_to_num(square, nan=1e3), 1e3) ** _RIM)
        return np.asarray(1.0 - float(values["loss"]) * inside)

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """The ellipse's box."""
        return {
            f"pixel_{x}": [
                float(values[f"centre_{x}"] - values[f"radius_{x}"]),
                float(values[f"centre_{x}"] + values[f"radius_{x}"]),
            ]
            for x in "uv"
            if f"centre_{x}" in values
        }

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel = variant.options["channel"]
        ellipse = " + ".join(
            f"((pixel_{x} - centre_{x}) / radius_{x})^2"
            for x in "uv"
            if any(p.name == f"centre_{x}" for p in variant.parameters)
        )
        return f"{channel} *= 1 - loss * 2^(-({ellipse})^{_RIM:g})"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss and place."""
        place = ", ".join(
            f"{x} = {values[f'centre_{x}']:.0f} ± {values[f'radius_{x}']:.0f}"
            for x in "uv"
            if f"centre_{x}" in values
        )
        return f"A spot on the window (pixels {place}) takes {values['loss'] * 100:.1f} % of the light, at all times."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from pixels."""
        return "Wipe the window and repeat one step: dirt goes, a pattern of the pixels stays."


_RIM = 2.0
