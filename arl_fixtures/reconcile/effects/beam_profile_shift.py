"""The beam points elsewhere than the field of view expects."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effect import Parameter, Stage, Values, Variant
from arl_fixtures.reconcile.effects_age import age_drivers
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    excess,
    light_channels,
    lit_signals,
    percent,
    reference,
    shape,
    span,
    temperature_drivers,
    unit_per,
)
from arl_fixtures.reconcile.effects_illumination import Across, Field, field_options, field_rays
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

MOST_RECEIVER = 8.0
"""Power of the cosine with which lens and wall fall off at most; an ideal lens has 4, a wall that is alike 3."""


class ProfileShift(LightFactor):
    """I *= B(azimuth − d, elevation − e) / B(azimuth, elevation): fixed, or growing with a temperature or age.

    Along an axis for which the table gives no ray B is a function of the pixel, and the shift is in pixels. What the
    simulation shows over the field is the beam's fall-off times that of lens and wall, which stays: where the name
    would fall otherwise, B is freed of (cos(azimuth) · cos(elevation))^receiver.
    """

    id = "beam.profile_shift"
    stage = Stage.BEAM
    source = "geometry; size: Elias et al., Sensors 20 (2020) 643 (pointing of camera optics with temperature)"
    confusable = ("optics.filter_shift", "beam.profile_change", "mount.tilt", "optics.focal_drift")

    def variants(self, view: View) -> Iterable[Variant]:
        """A fixed shift, and one per driver."""
        options = field_options(view)
        field = Field(options)
        axes = field.varying(view)
        for channel in lit_signals(view):
            if field.profile(view, channel) is None:
                continue
            temperatures = temperature_drivers(view, "laser_temperature_c", "housing_temperature_c", limit=2)
            for driver in ("", *temperatures, *age_drivers(view)[:2]):
                wide = span(view, driver) if driver else 1.0
                yield Variant(
                    effect=self.id,
                    options={
                        "channel": channel,
                        "driver": driver,
                        "reference": reference(view, driver) if driver else 0.0,
                        **options,
                    },
                    parameters=tuple(_shift(axis, driver, wide) for axis in axes),
                    channels=light_channels(view, channel),
                    drivers=(*((driver,) if driver else ()), *(axis.column for axis in axes)),
                )

    def wider(self, variant: Variant, view: View) -> Iterable[Variant]:
        """With a fall-off that stays, where the table gives the rays and these do not turn round."""
        rays = len(field_rays(view)) == len(Field(variant.options).varying(view))
        if rays and "receiver" not in variant.options:
            stays = shape("receiver", "1", 0.0, MOST_RECEIVER, 2.0)
            options = {**variant.options, "receiver": "stays"}
            yield replace(variant, options=options, parameters=(*variant.parameters, stays))

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Ratio of the shifted to the simulated profile."""
        channel = str(variant.options["channel"])
        field = Field(variant.options)
        profile = field.profile(view, channel)
        if profile is None:
            return np.ones(view.n)
        driver = str(variant.options["driver"])
        size = excess(view, variant, driver) if driver else 1.0
        moved = tuple(
            place - shift / axis.half * size
            for place, shift, axis in zip(field.places(view), field.along(values, "shift"), field.axes, strict=True)
        )
        turned = profile.log(*moved)
        stays = float(values.get("receiver", 0.0))
        if stays:
            turned = turned - stays * (_fall_off(*moved) - _fall_off(*field.places(view)))
        return np.exp(np.clip(turned - field.log_profile(view, channel), -4.0, 4.0))

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, driver = variant.options["channel"], variant.options["driver"]
        grown = f" * ({driver} - {variant.options['reference']})" if driver else ""
        axes = Field(variant.options).axes
        moved = ", ".join(f"{axis.column} - {_name(axis)}{grown}" for axis in axes)
        law = f"{channel} *= B({moved}) / B({', '.join(axis.column for axis in axes)}), B the simulated beam"
        stays = " over (cos(azimuth_deg) * cos(elevation_deg))^receiver" if "receiver" in variant.options else ""
        return law + stays

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """The shift in degrees or pixels, over the driver's range."""
        driver = str(variant.options["driver"])
        low, high = view.span(driver) if driver else (0.0, 1.0)
        parts = [
            f"{values[_name(axis)] * (high - low):+.2f}{' pixels along ' if axis.is_pixel else '° in '}"
            f"{axis.column.removesuffix('_deg')}"
            for axis in Field(variant.options).axes
            if _name(axis) in values
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


def _fall_off(azimuth_deg: FloatArray, elevation_deg: FloatArray) -> FloatArray:
    """ln of what a lens of exponent 1 sees of a direction."""
    return np.asarray(np.log(np.cos(np.radians(azimuth_deg)) * np.cos(np.radians(elevation_deg))))


def _name(axis: Across) -> str:
    return f"shift_{axis.short}"


def _shift(axis: Across, driver: str, wide: float) -> Parameter:
    """The shift along an axis, per unit of the driver: up to 10°, or half of the image's half width."""
    unit = "px" if axis.is_pixel else "deg"
    most, typical = (0.5 * axis.half, 0.01 * axis.half) if axis.is_pixel else (10.0, 0.3)
    return amplitude(
        _name(axis), unit_per(driver, unit) if driver else unit, -most / wide, most / wide, typical / wide
    )
