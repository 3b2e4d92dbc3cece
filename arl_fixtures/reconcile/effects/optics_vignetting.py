"""Fall-off with the field angle, in both directions of light."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Option, Parameter, Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    light_channels,
    per_view,
    shape,
    signals,
)
from arl_fixtures.reconcile.effects_field import PIXEL, has_field, image_radius, middle_options
from arl_fixtures.reconcile.effects_illumination import field_cosine, field_rays
from arl_fixtures.reconcile.view import View


class Vignetting(LightFactor):
    """I *= cos(θ)^exponent (natural), or the overlap of two round apertures that part with tan θ (mechanical).

    The larger one has the radius 1 + parting·knee: up to tan θ = knee nothing is cut off.
    Where a table does not say where its pixels look, tan θ grows with the distance from the image's middle and is
    `reach` in its corner.
    """

    id = "optics.vignetting"
    stage = Stage.OPTICS
    source = "Aggarwal, Hua, Ahuja, ICCV 2001: on cosine-fourth and vignetting effects in real lenses"
    confusable = ("beam.profile_change", "optics.filter_shift", "target.non_lambertian")

    def variants(self, view: View) -> Iterable[Variant]:
        """Natural and mechanical, one pair per intensity channel; natural by pixels where no rays are known."""
        if not field_rays(view):
            if has_field(view):
                for channel in signals(view):
                    parameters = amplitude("exponent", "1", -4.0, 16.0, 1.0), shape("reach", "1", 0.05, 2.0, 0.4)
                    yield self._variant(view, channel, "by pixels", parameters)
            return
        for channel in signals(view):
            yield self._variant(view, channel, "natural", (amplitude("exponent", "1", -4.0, 16.0, 1.0),))
            steepest = float(np.nanmax(np.sqrt(1.0 / _cosine(view) ** 2 - 1.0)))
            knee = shape("knee", "1", 0.0, 0.8 * steepest, *(share * steepest for share in (0.02, 0.3, 0.6)))
            yield self._variant(view, channel, "mechanical", (amplitude("parting", "1", 0.0, 3.0, 1.0), knee))

    def _variant(self, view: View, channel: str, kind: str, parameters: tuple[Parameter, ...]) -> Variant:
        options: dict[str, Option] = {"channel": channel, "kind": kind}
        if kind == "by pixels":
            options |= middle_options(view)
        names = PIXEL if kind == "by pixels" else field_rays(view)
        return Variant(
            effect=self.id,
            options=options,
            parameters=parameters,
            channels=light_channels(view, channel),
            drivers=tuple(name for name in names if view.varies(name)),
        )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Relative illumination of the two ways together."""
        if variant.options["kind"] == "by pixels":
            tangent = float(values["reach"]) * image_radius(variant, view)
            return np.asarray((1.0 + tangent**2) ** (-0.5 * float(values["exponent"])))
        cosine = _cosine(view)
        if variant.options["kind"] == "natural":
            return np.asarray(cosine ** float(values["exponent"]))
        distance = float(values["parting"]) * np.sqrt(1.0 / cosine**2 - 1.0)
        return np.maximum(overlap(distance, 1.0 + float(values["parting"]) * float(values["knee"])), 1e-3)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel = variant.options["channel"]
        if variant.options["kind"] == "by pixels":
            return f"{channel} *= cos(theta)^exponent, tan(theta) = reach * distance from the middle / the corner's"
        if variant.options["kind"] == "natural":
            return f"{channel} *= (cos(azimuth_deg) * cos(elevation_deg))^exponent"
        return (
            f"{channel} *= overlap of apertures of radius 1 and 1 + parting * knee at distance parting * tan(theta), "
            "theta the field angle"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss at the edge of the field."""
        low, _ = self.change(variant, values, view)
        return f"The optics pass less light away from the axis: {low:+.1f} % at the edge of the field of view."

    def next_experiment(self, variant: Variant) -> str:
        """What tells receiver and beam apart."""
        return (
            "Image a uniformly lit diffuse panel with the laser off (or a flat-field lamp): vignetting of the "
            "receiver "
            "stays, a change of the beam does not."
        )


def _cosine(view: View) -> FloatArray:
    """Cosine of the field angle of every row."""
    return per_view(
        view,
        "field cosine",
        lambda: np.maximum(field_cosine(view), 0.02),
    )


def overlap(distance: FloatArray, radius: float) -> FloatArray:
    """Share of a unit disc that lies within a disc of `radius` ≥ 1 whose centre is `distance` away."""
    d = np.clip(distance, radius - 1.0 + 1e-9, radius + 1.0 - 1e-9)
    one = np.arccos(np.clip((d**2 + 1.0 - radius**2) / (2.0 * d), -1.0, 1.0))
    two = np.arccos(np.clip((d**2 + radius**2 - 1.0) / (2.0 * d * radius), -1.0, 1.0))
    kite = 0.5 * np.sqrt(
        np.maximum((-d + 1.0 + radius) * (d + 1.0 - radius) * (d - 1.0 + radius) * (d + 1.0 + radius), 0.0)
    )
    area = one + radius**2 * two - kite
    return np.where(distance <= radius - 1.0, 1.0, np.where(distance >= radius + 1.0, 0.0, area / np.pi))
