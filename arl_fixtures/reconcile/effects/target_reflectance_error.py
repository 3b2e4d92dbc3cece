"""One surface is brighter or darker than its certificate."""

from __future__ import annotations

from collections.abc import Iterable

from arl_fixtures.reconcile.effect import Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    distances,
    light_channels,
    set_light,
    signals,
)
from arl_fixtures.reconcile.effects_panels import panel_shares, unnamed_panels
from arl_fixtures.reconcile.effects_pulled import pull_ranges, pulled_by
from arl_fixtures.reconcile.effects_surface import light_share, surface_names
from arl_fixtures.reconcile.effects_targets import before, rows_before, target_column
from arl_fixtures.reconcile.view import View

_MOST = 16
"""Surfaces of which any may be off: a small one stands in the scene as a large one does."""


class ReflectanceError(LightFactor):
    """I *= 1 + error · (the surface's share of the pixel's light): 1 on the surface, in between at its border.

    A sensor before one target at a time has a column of targets instead, or of their reflectances: there the error
    is that of all rows before one of them. Where a known bench's surfaces have no names its rays tell what each adds.
    """

    id = "target.reflectance_error"
    stage = Stage.TARGET
    source = "manufacturers' certificates of diffuse panels state 1 to 3 % of the reflectance (8°/hemispherical)"
    confusable = ("detector.compression", "target.non_lambertian", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per surface, the most seen first."""
        for channel in signals(view):
            for surface in surface_names(view, _MOST):
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "surface": surface},
                    parameters=(amplitude("error", "1", -0.9, 4.0, 0.02),),
                    channels=tuple(dict.fromkeys((*light_channels(view, channel), *pulled_by(view, channel)))),
                    drivers=("surface",),
                    where={"surface": [surface]},
                )
            for panel in unnamed_panels(view):
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "surface": panel, "of": "bench"},
                    parameters=(amplitude("error", "1", -0.9, 4.0, 0.02),),
                    channels=tuple(dict.fromkeys((*light_channels(view, channel), *distances(view)))),
                    drivers=tuple(n for n in ("stage_angle_deg", "azimuth_deg", "pixel_u") if view.varies(n))[:2],
                )
            yield from self._of_targets(view, channel)

    def _of_targets(self, view: View, channel: str) -> Iterable[Variant]:
        column, targets = target_column(view)
        for target in targets:
            yield Variant(
                effect=self.id,
                options={"channel": channel, "surface": target, "column": column},
                parameters=(amplitude("error", "1", -0.9, 4.0, 0.02),),
                channels=light_channels(view, channel),
                drivers=(column,),
                where=rows_before(column, target),
            )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Brighter or darker by the surface's share of the light."""
        surface = str(variant.options["surface"])
        if "column" in variant.options:
            share = before(view, str(variant.options["column"]), surface)
        elif "of" in variant.options:
            share = panel_shares(view, surface)[0]
        else:
            share = light_share(view, str(variant.options["channel"]), surface)
        return 1.0 + float(values["error"]) * share

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Multiplies the light; a pixel that sees another surface too ranges nearer to the brighter one."""
        channel, surface = str(variant.options["channel"]), str(variant.options["surface"])
        factor = self.factor(variant, values, view)
        set_light(view, state, channel, state[channel] * factor)
        if "of" in variant.options:
            moment = 1.0 + float(values["error"]) * panel_shares(view, surface)[1]
            for name in distances(view):
                state[name] = state[name] * moment / factor
        elif "column" not in variant.options:
            pull_ranges(view, state, channel, surface, factor)

    def expression(self, variant: Variant) -> str:
        """The law."""
        on = variant.options.get("column", "the bench's surface" if "of" in variant.options else "surface")
        return f"{variant.options['channel']} *= 1 + error on {on} '{variant.options['surface']}'"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The error in percent."""
        error = float(values["error"])
        what = "brighter" if error > 0.0 else "darker"
        on = str(variant.options.get("column", "surface")).capitalize()
        return f"{on} '{variant.options['surface']}' is {abs(error) * 100:.2f} % {what} than the simulation assumes."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from compression."""
        return (
            "Swap this surface with another, or measure it with a reflectometer: an error of the target moves with "
            "the "
            "target, compression stays with the signal."
        )
