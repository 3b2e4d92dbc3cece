"""The beam's width or shape changed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Option, Parameter, Stage, Values, Variant
from arl_fixtures.reconcile.effects_age import age_drivers, age_scales, aged
from arl_fixtures.reconcile.effects_arrhenius import arrhenius
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    excess,
    light_channels,
    lit_signals,
    percent,
    reference,
    rounded,
    shape,
    span,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_illumination import Across, Field, Illumination, field_options
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_FIXED, _DRIVEN = ("width", "edge", "centre", "blur"), ("width", "spread", "edge", "centre")
_SHARPENED, _SPREAD = 0.2, 0.4
"""Standard deviations over the half field of view, by which a blur may have shrunk and grown."""


class ProfileChange(LightFactor):
    """A beam that is stretched, falls off at its edges, or is worn in its middle.

    * width: I *= B(az/(1+w_az), el/(1+w_el)) / B(az, el); a change of the power as a whole is the laser's.
      By Arrhenius' law also by ((1+w_az)(1+w_el))^−thinned: what is spread is missing in the middle.
    * spread: a width of which the power stays the same, so that thinned is 1.
    * edge: I *= exp(−edge_az·|az/edge|^order − edge_el·|el/edge|^order).
    * blur: every ray spread by a Gaussian of variance v, I *= 1 + ½·v_az·B_az,az/B + ½·v_el·B_el,el/B.
    * centre: I *= 1 − centre·exp(−(r/radius)²), r the distance from the axis over the half field of view.

    With a temperature all grow in proportion; the width also by Arrhenius' law (a cement that softens).

    Along an axis for which the table gives no ray, the pixel's place over the image's half width takes its place.
    """

    id = "beam.profile_change"
    stage = Stage.BEAM
    source = "ISO 11146-1 (beam widths); top-hat diffuser ageing as an edge loss of order 2 to 4"
    confusable = ("optics.vignetting", "beam.profile_shift", "optics.filter_shift")

    def variants(self, view: View) -> Iterable[Variant]:
        """Width and edge, fixed or driven by a temperature or by age."""
        temperatures = temperature_drivers(view, "laser_temperature_c", "housing_temperature_c", limit=1)
        field = Field(field_options(view))
        axes = field.varying(view)
        for channel in lit_signals(view):
            profile = field.profile(view, channel)
            if profile is None:
                continue
            drivers = ("", *temperatures, *age_drivers(view)[:1])
            scales = [(d, {**scale, **field_options(view)}) for d in drivers for scale in _scales(view, d)]
            # what spreads the beam sits in the housing; a laser that is kept at its temperature tells nothing of it
            housing = temperature_drivers(view, "housing_temperature_c", limit=1)
            highest: list[dict[str, Option]] = [{"grows": rounded(view.span(name)[1])} for name in housing]
            scales += [(d, {**scale, **field_options(view)}) for d, scale in zip(housing, highest, strict=True)]
            for driver, scale in scales:
                for kind in ("width",) if "grows" in scale else _DRIVEN if driver else _FIXED:
                    parameters = [amplitude(f"{kind}_{axis.short}", "1", -0.5, 2.0, 0.05) for axis in axes]
                    if kind == "edge":
                        parameters.append(shape("order", "1", 1.5, 8.0, 3.0))
                    if kind == "blur":
                        parameters = [_variance(axis, profile) for axis in axes]
                    if kind == "centre":
                        parameters = [amplitude("centre", "1", -2.0, 0.95, 0.05), shape("radius", "1", 0.1, 0.7, 0.5)]
                    if "grows" in scale:
                        parameters.append(shape("thinned", "1", 0.0, 1.0, 0.5))
                        parameters.append(shape("activation_energy", "eV", 0.05, 1.5, 0.35))
                    yield Variant(
                        effect=self.id,
                        options={"channel": channel, "kind": kind, "driver": driver, **scale},
                        parameters=tuple(parameters),
                        channels=light_channels(view, channel),
                        drivers=(*((driver,) if driver else ()), *(axis.column for axis in axes)),
                    )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Ratio of the changed to the simulated profile."""
        channel = str(variant.options["channel"])
        field = Field(variant.options)
        profile = field.profile(view, channel)
        if profile is None:
            return np.ones(view.n)
        x, y = field.places(view)
        driver = str(variant.options["driver"])
        size, kind = _size(view, variant, values, driver), str(variant.options["kind"])
        if kind == "centre":
            square = (x / profile.reach_az) ** 2 + (y / profile.reach_el) ** 2
            worn = float(values["centre"]) * np.exp(-square / float(values["radius"]) ** 2)
            return np.asarray(np.maximum(1.0 - worn * size, 0.02))
        if kind == "edge":
            order = float(values["order"])
            edge_x, edge_y = field.along(values, "edge")
            loss = edge_x * np.abs(x / profile.reach_az) ** order + edge_y * np.abs(y / profile.reach_el) ** order
            return np.asarray(np.exp(np.clip(-loss * size, -4.0, 4.0)))
        if kind == "blur":
            bends = zip(field.along(values, "blur"), field.curvature(view, channel), strict=True)
            return np.asarray(np.clip(1.0 + size * sum(0.5 * v * bend for v, bend in bends), 0.02, 50.0))
        wide_x, wide_y = (np.maximum(1.0 + wider * size, 0.3) for wider in field.along(values, kind))
        stretched = profile.log(x / wide_x, y / wide_y) - field.log_profile(view, channel)
        thinned = 1.0 if kind == "spread" else float(values.get("thinned", 0.0))
        stretched = stretched - thinned * np.log(wide_x * wide_y)
        return np.asarray(np.exp(np.clip(stretched, -4.0, 4.0)))

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, driver = variant.options["channel"], variant.options["driver"]
        grown = f", both grow with {driver} (given for its whole range)" if driver else ""
        if "grows" in variant.options:
            highest = variant.options["grows"]
            grown = (
                f", both times exp(-activation_energy / k (1 / {driver} - 1 / {highest})) (temperatures in kelvin)"
            )
        x, y = (axis.short for axis in Field(variant.options).axes)
        if variant.options["kind"] == "centre":
            return f"{channel} *= 1 - centre * exp(-(({x} / edge)^2 + ({y} / edge)^2) / radius^2){grown}"
        if variant.options["kind"] == "edge":
            return f"{channel} *= exp(-edge_{x} * |{x} / edge|^order - edge_{y} * |{y} / edge|^order){grown}"
        if variant.options["kind"] == "blur":
            return f"{channel} *= 1 + (blur_{x} * d2B/d{x}2 + blur_{y} * d2B/d{y}2) / (2 B){grown}"
        kind = variant.options["kind"]
        wide = f"(1 + {kind}_{x}), {y} / (1 + {kind}_{y})"
        power = "-1" if kind == "spread" else "-thinned" if "grows" in variant.options else ""
        thinned = f" * ((1 + {kind}_{x}) * (1 + {kind}_{y}))^{power}" if power else ""
        return f"{channel} *= B({x} / {wide}) / B({x}, {y}){thinned}{grown}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Change of light over the field."""
        driver = str(variant.options["driver"])
        when = ""
        if driver:
            low, high = view.span(driver)
            when = f" from {low:.4g} to {high:.4g} {unit_of(driver)} of {driver}"
        kinds = {
            "width": "width",
            "spread": "width",
            "edge": "fall-off at its edges",
            "centre": "middle",
            "blur": "sharpness",
        }
        what = kinds[str(variant.options["kind"])]
        return f"The beam's {what} changed{when}: the signal differs {percent(*self.change(variant, values, view))}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from the receiver."""
        return "Picture the beam on a screen with an infrared camera: the receiver's vignetting is not on it."


def _variance(axis: Across, profile: Illumination) -> Parameter:
    """Variance of a blur along an axis: the law is of second order, and a beam can be sharpened by little."""
    reach = profile.reach_el if axis.column in ("elevation_deg", "pixel_v") else profile.reach_az
    unit = "half-widths^2" if axis.is_pixel else "deg^2"
    low, high = -((_SHARPENED * reach) ** 2), (_SPREAD * reach) ** 2
    return amplitude(f"blur_{axis.short}", unit, low, high, 0.01 * reach**2)


def _scales(view: View, driver: str) -> list[dict[str, Option]]:
    """What a driver is counted from: an age from its first value, and from nil where a record begins later."""
    if not driver:
        return [{}]
    if driver not in age_drivers(view):
        return [{"reference": reference(view, driver), "range": span(view, driver)}]
    return [{**scale} for scale in age_scales(view, driver, by_pixel=True)]


def _size(view: View, variant: Variant, values: Values, driver: str) -> FloatArray | float:
    if not driver:
        return 1.0
    if "first" in variant.options:
        return aged(view, variant, driver)
    if "grows" in variant.options:
        energy, highest = float(values["activation_energy"]), float(variant.options["grows"])
        rate = arrhenius(view.number(driver), energy, highest, most=3.0)
        return np.asarray(np.nan_to_num(rate))
    return excess(view, variant, driver) / float(variant.options["range"])
