"""A part of the window transmits less, always."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effect import Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, LightFactor, amplitude, light_channels, shape, signals
from arl_fixtures.reconcile.effects_illumination import ray_column
from arl_fixtures.reconcile.view import View


class WindowContamination(LightFactor):
    """I *= 1 − loss·spot(u, v): an ellipse, the same at every angle and temperature.

    Its rim is as soft as the dirt's: a film that thins out from its middle (rim 1) loses most of its area and half of
    its depth where it is taken for a disc, a drop seen by a narrow beam has a sharp one.

    u and v are a pixel's column and row; where a sensor has none (a scanner, a single beam that is steered), the
    direction of its ray in its own frame, azimuth and elevation in degrees, for the stain turns with the sensor.
    """

    id = "optics.window_contamination"
    stage = Stage.OPTICS
    several = True
    source = "DIN SAE SPEC 91571 (2026): dirt on sensor windows; two passes of light through the same spot"
    confusable = ("detector.pixel_response", "optics.vignetting", "beam.profile_change")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel, started on a raster of places whose spots touch."""
        axes = {letter: name for letter in "uv" if (name := _axis(view, letter))}
        if not axes:
            return
        for channel in signals(view):
            parameters = [amplitude("loss", "1", 0.0, 0.99, 0.05)]
            for letter, axis in axes.items():
                low, high = view.span(axis)
                wide = high - low
                pixels = axis.startswith("pixel_")
                unit = "px" if pixels else "°"
                count = (4 if letter == "u" else 3) if pixels else _places(wide, letter)
                starts = (low + (k + 0.5) / count * wide for k in range(count))
                parameters.append(shape(f"centre_{letter}", unit, low, high, *starts))
                least = (0.5 if wide < 4.0 else 1.0) if pixels else _NARROWEST * wide
                touching = 0.17 * wide if pixels else 0.6 * wide / count
                parameters.append(shape(f"radius_{letter}", unit, least, max(0.6 * wide, 2.0 * least), touching))
            parameters.append(replace(shape("rim", "1", *_RIMS, _RIM), last=True))
            yield Variant(
                effect=self.id,
                options={"channel": channel, **{x: axis for x, axis in axes.items() if axis in _RAYS.values()}},
                parameters=tuple(parameters),
                channels=light_channels(view, channel),
                drivers=tuple(axes.values()),
            )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Transmission of the spot, both ways of the light."""
        square = np.zeros(view.n)
        for letter, axis in _axes(variant, values):
            away = view.number(axis) - float(values[f"centre_{letter}"])
            if axis == "azimuth_deg":
                away = np.mod(away + 180.0, 360.0) - 180.0  # a scanner sees all around
            square = square + (away / float(values[f"radius_{letter}"])) ** 2
        rim = float(values.get("rim", _RIM))  # models of before had none
        inside = np.exp(-np.log(2.0) * np.minimum(np.nan_to_num(square, nan=1e3), 1e3) ** rim)
        return np.asarray(1.0 - float(values["loss"]) * inside)

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """The ellipse's box."""
        return {
            axis: [
                float(values[f"centre_{x}"] - values[f"radius_{x}"]),
                float(values[f"centre_{x}"] + values[f"radius_{x}"]),
            ]
            for x, axis in _axes(variant, values)
        }

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel = variant.options["channel"]
        ellipse = " + ".join(
            f"(({axis} - centre_{x}) / radius_{x})^2"
            for x, axis in _axes(variant, {p.name: 0.0 for p in variant.parameters})
        )
        return f"{channel} *= 1 - loss * 2^(-({ellipse})^rim)"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss and place."""
        place = ", ".join(
            f"{axis.removeprefix('pixel_').removesuffix('_deg')} = "
            f"{values[f'centre_{x}']:.0f} ± {values[f'radius_{x}']:.0f}{'°' if axis.endswith('_deg') else ''}"
            for x, axis in _axes(variant, values)
        )
        seen = "pixels " if place.startswith(("u", "v")) else ""
        return f"A spot on the window ({seen}{place}) takes {values['loss'] * 100:.1f} % of the light, at all times."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from pixels."""
        return "Wipe the window and repeat one step: dirt goes, a pattern of the pixels stays."


_RIM, _RIMS = 2.0, (0.7, 8.0)
"""Exponent of the rim to start from, and its range: below it, a spot has no end."""
_NARROWEST = 0.005
"""Share of a scanner's field of view that the smallest spot takes."""
_APART_DEG = 40.0
_RAYS = {"u": "azimuth_deg", "v": "elevation_deg"}
_FEWEST, _MOST = {"u": 4, "v": 3}, {"u": 9, "v": 3}


def _places(wide_deg: float, letter: str) -> int:
    """Places to start from: a stain is no wider because the scanner sees all around."""
    return min(max(int(np.ceil(wide_deg / _APART_DEG)), _FEWEST[letter]), _MOST[letter])


def _axis(view: View, letter: str) -> str:
    """Column that tells where on the window a row's light passes; empty where none varies.

    The ray's direction only where it says more than the pixel does: a lens that distorts says nothing of a stain.
    """
    pixel, other = f"pixel_{letter}", f"pixel_{'v' if letter == 'u' else 'u'}"
    if view.varies(pixel):
        return pixel
    if not view.varies(_RAYS[letter]):
        return ""
    if not view.varies(other):
        return _RAYS[letter]
    rays = ray_column(view, _RAYS[letter])
    line = view.columns.group(other)
    mean = np.bincount(line, rays) / np.maximum(np.bincount(line), 1)
    return _RAYS[letter] if np.var(rays - mean[line]) > 0.5 * np.var(rays) else ""


def _axes(variant: Variant, values: Values) -> list[tuple[str, str]]:
    """Letter and column of a spot's axes."""
    return [(x, str(variant.options.get(x, f"pixel_{x}"))) for x in "uv" if f"centre_{x}" in values]
