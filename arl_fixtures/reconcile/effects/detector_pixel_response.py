"""A fixed pattern of pixel gains."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import set_response, signals, with_scatter
from arl_fixtures.reconcile.view import View


class PixelResponse(Effect):
    """I *= 1 + gain, one gain for every pixel of every DUT: a field, drawn towards zero by the engine."""

    id = "detector.pixel_response"
    stage = Stage.DETECTOR
    source = "EMVA 1288 (2021), sec. 8: photo response non-uniformity as a variance component"
    confusable = ("optics.window_contamination", "readout.column_pattern", "optics.vignetting")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel of a sensor with pixels or zones."""
        pixels = tuple(name for name in ("pixel_u", "pixel_v") if view.varies(name))
        pixels = pixels or tuple(name for name in ("zone",) if view.varies(name))
        if not pixels:
            return
        levels = (*(("dut",) if view.labels("dut") else ()), *pixels)
        for channel in signals(view):
            yield Variant(
                effect=self.id,
                options={"channel": channel},
                parameters=(
                    Parameter(name="gain", unit="1", low=-0.8, high=2.0, null=0.0, typical=0.02, per=levels),
                ),
                channels=with_scatter(view, channel),
                drivers=pixels,
            )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Multiplies the response of every pixel."""
        gain = np.maximum(1.0 + np.nan_to_num(np.asarray(values["gain"], dtype=np.float64)), 0.01)
        channel = str(variant.options["channel"])
        set_response(state, channel, state[channel] * gain, gain)

    def expression(self, variant: Variant) -> str:
        """The law."""
        return f"{variant.options['channel']} *= 1 + gain[pixel]"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Spread of the gains."""
        gains = np.asarray(values["gain"], dtype=np.float64)
        spread = 100.0 * float(np.std(gains) if gains.size > 1 else gains)
        return (
            f"The pixels' gains differ by {spread:.2f} % (standard deviation), the same at every angle and "
            "temperature."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from dirt."""
        return (
            "Take a flat field (uniform panel over the whole image) and wipe the window: a pattern of the pixels "
            "stays."
        )
