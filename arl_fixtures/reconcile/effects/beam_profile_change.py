"""The beam's width or shape changed."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    age_drivers,
    age_options,
    aged,
    amplitude,
    excess,
    light_channels,
    percent,
    reference,
    shape,
    signals,
    span,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation, illumination, log_profile
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_ANGLES = (("az", "azimuth_deg"), ("el", "elevation_deg"))


class ProfileChange(LightFactor):
    """A beam that is stretched, falls off at its edges, or is worn in its middle.

    * width: I *= B(az/(1+w_az), el/(1+w_el)) / B(az, el); a change of the power as a whole is the laser's.
    * edge: I *= exp(−edge_az·|az/edge|^order − edge_el·|el/edge|^order).
    * centre: I *= 1 − centre·exp(−(r/radius)²), r the distance from the axis over the half field of view.
    """

    id = "beam.profile_change"
    stage = Stage.BEAM
    source = "ISO 11146-1 (beam widths); top-hat diffuser ageing as an edge loss of order 2 to 4"
    confusable = ("optics.vignetting", "beam.profile_shift", "optics.filter_shift")

    def variants(self, view: View) -> Iterable[Variant]:
        """Width and edge, fixed or driven by a temperature or by age."""
        temperatures = temperature_drivers(view, "laser_temperature_c", "housing_temperature_c", limit=1)
        for channel in signals(view):
            if illumination(view, channel) is None:
                continue
            rays = tuple(column for _, column in _ANGLES if view.varies(column))
            for driver in ("", *temperatures, *age_drivers(view)[:1]):
                for kind in ("width", "edge", "centre"):
                    parameters = [
                        amplitude(f"{kind}_{axis}", "1", -0.5, 2.0, 0.05)
                        for axis, column in _ANGLES
                        if view.varies(column)
                    ]
                    if kind == "edge":
                        parameters.append(shape("order", "1", 1.5, 8.0, 3.0))
                    if kind == "centre":
                        parameters = [amplitude("centre", "1", -2.0, 0.95, 0.05), shape("radius", "1", 0.1, 0.7, 0.5)]
                    yield Variant(
                        effect=self.id,
                        options={"channel": channel, "kind": kind, "driver": driver, **_scale(view, driver)},
                        parameters=tuple(parameters),
                        channels=light_channels(view, channel),
                        drivers=(*((driver,) if driver else ()), *rays),
                    )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Ratio of the changed to the simulated profile."""
        channel = str(variant.options["channel"])
        profile = illumination(view, channel)
        if profile is None:
            return np.ones(view.n)
        az, el = azimuth(view), elevation(view)
        driver = str(variant.options["driver"])
        size = _size(view, variant, driver)
        if variant.options["kind"] == "centre":
            square = (az / profile.reach_az) ** 2 + (el / profile.reach_el) ** 2
            worn = float(values["centre"]) * np.exp(-square / float(values["radius"]) ** 2)
            return np.asarray(np.maximum(1.0 - worn * size, 0.02))
        if variant.options["kind"] == "edge":
            order = float(values["order"])
            loss = float(values.get("edge_az", 0.0)) * np.abs(az / profile.reach_az) ** order
            loss = loss + float(values.get("edge_el", 0.0)) * np.abs(el / profile.reach_el) ** order
            return np.asarray(np.exp(np.clip(-loss * size, -4.0, 4.0)))
        wide_az = np.maximum(1.0 + float(values.get("width_az", 0.0)) * size, 0.3)
        wide_el = np.maximum(1.0 + float(values.get("width_el", 0.0)) * size, 0.3)
        stretched = profile.log(az / wide_az, el / wide_el) - log_profile(view, channel)
        return np.asarray(np.exp(np.clip(stretched, -4.0, 4.0)))

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, driver = variant.options["channel"], variant.options["driver"]
        grown = f", both grow with {driver} (given for its whole range)" if driver else ""
        if variant.options["kind"] == "centre":
            return f"{channel} *= 1 - centre * exp(-((az / edge)^2 + (el / edge)^2) / radius^2){grown}"
        if variant.options["kind"] == "edge":
            return f"{channel} *= exp(-edge_az * |az / edge|^order - edge_el * |el / edge|^order){grown}"
        return f"{channel} *= B(azimuth / (1 + width_az), elevation / (1 + width_el)) / B(azimuth, elevation){grown}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Change of light over the field."""
        driver = str(variant.options["driver"])
        when = ""
        if driver:
            low, high = view.span(driver)
            when = f" from {low:.4g} to {high:.4g} {unit_of(driver)} of {driver}"
        kinds = {"width": "width", "edge": "fall-off at its edges", "centre": "middle"}
        what = kinds[str(variant.options["kind"])]
        return f"The beam's {what} changed{when}: the signal differs {percent(*self.change(variant, values, view))}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from the receiver."""
        return "Picture the beam on a screen with an infrared camera: the receiver's vignetting is not on it."


def _scale(view: View, driver: str) -> dict[str, float]:
    if not driver:
        return {}
    if driver in age_drivers(view):
        return age_options(view, driver, by_pixel=True)
    return {"reference": reference(view, driver), "range": span(view, driver)}


def _size(view: View, variant: Variant, driver: str) -> FloatArray | float:
    if not driver:
        return 1.0
    if "first" in variant.options:
        return aged(view, variant, driver)
    return excess(view, variant, driver) / float(variant.options["range"])
