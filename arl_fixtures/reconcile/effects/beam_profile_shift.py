"""The beam points elsewhere than the field of view expects."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    age_drivers,
    amplitude,
    excess,
    light_channels,
    percent,
    reference,
    signals,
    span,
    temperature_drivers,
    unit_per,
)
from arl_fixtures.reconcile.effects_illumination import azimuth, elevation, illumination, log_profile
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View


class ProfileShift(LightFactor):
    """I *= B(azimuth − d, elevation − e) / B(azimuth, elevation): fixed, or growing with a temperature or age."""

    id = "beam.profile_shift"
    stage = Stage.BEAM
    source = "geometry; size: Elias et al., Sensors 20 (2020) 643 (pointing of camera optics with temperature)"
    confusable = ("optics.filter_shift", "beam.profile_change", "mount.tilt", "optics.focal_drift")

    def variants(self, view: View) -> Iterable[Variant]:
        """A fixed shift, and one per driver."""
        for channel in signals(view):
            if illumination(view, channel) is None:
                continue
            temperatures = temperature_drivers(view, "laser_temperature_c", "housing_temperature_c", limit=2)
            for driver in ("", *temperatures, *age_drivers(view)[:2]):
                wide = span(view, driver) if driver else 1.0
                unit = unit_per(driver, "deg") if driver else "deg"
                yield Variant(
                    effect=self.id,
                    options={
                        "channel": channel,
                        "driver": driver,
                        "reference": reference(view, driver) if driver else 0.0,
                    },
                    parameters=tuple(
                        amplitude(name, unit, -10.0 / wide, 10.0 / wide, 0.3 / wide)
                        for name, column in (("shift_az", "azimuth_deg"), ("shift_el", "elevation_deg"))
                        if view.varies(column)
                    ),
                    channels=light_channels(view, channel),
                    drivers=(*((driver,) if driver else ()), *_rays(view)),
                )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Ratio of the shifted to the simulated profile."""
        channel = str(variant.options["channel"])
        profile = illumination(view, channel)
        if profile is None:
            return np.ones(view.n)
        az, el = azimuth(view), elevation(view)
        driver = str(variant.options["driver"])
        size = excess(view, variant, driver) if driver else 1.0
        turned = profile.log(
            az - float(values.get("shift_az", 0.0)) * size, el - float(values.get("shift_el", 0.0)) * size
        )
        return np.exp(np.clip(turned - log_profile(view, channel), -4.0, 4.0))

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, driver = variant.options["channel"], variant.options["driver"]
        grown = f" * ({driver} - {variant.options['reference']})" if driver else ""
        return (
            f"{channel} *= B(azimuth_deg - shift_az{grown}, elevation_deg - shift_el{grown}) / B(azimuth_deg, "
            "elevation_deg), B the simulated beam"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The shift in degrees, over the driver's range."""
        driver = str(variant.options["driver"])
        low, high = view.span(driver) if driver else (0.0, 1.0)
        parts = [
            f"{values[name] * (high - low):+.2f}° in {axis}"
            for name, axis in (("shift_az", "azimuth"), ("shift_el", "elevation"))
            if name in values
        ]
        when = f" from {low:.4g} to {high:.4g} {unit_of(driver)} of {driver}" if driver else ""
        change = percent(*self.change(variant, values, view))
        return f"The beam moves by {' and '.join(parts)}{when}; the signal changes {change}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a moved camera."""
        return (
            "Scan a stripe edge over the field at both ends of the range: a moved beam leaves the edge's pixel "
            "alone, "
            "a drift of the receiver's optics moves it."
        )


def _rays(view: View) -> tuple[str, ...]:
    return tuple(name for name in ("azimuth_deg", "elevation_deg") if view.varies(name))
