"""The narrow-band filter's passband moves with angle, the laser line with temperature."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from arl_fixtures.reconcile.effect import Parameter, Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    excess,
    is_of,
    light_channels,
    lit_signals,
    per_view,
    percent,
    reference,
    shape,
    span,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_field import PIXEL, has_field, image_radius, middle_options
from arl_fixtures.reconcile.effects_illumination import field_cosine, field_rays
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

USUAL_INDEX = 1.9
"""Effective index of a filter's layers, usual is 1.5 to 2.3: beside a free tilt it changes the loss at 30° by a 50th
of itself, which no table tells."""
USUAL_CAVITIES = 2.0
"""Cavities of a filter of which a table shows no more than how a loss begins: slope and bend of any flank."""
USUAL_REACH = 0.6
"""Tangent of the field angle in the image's corner where no rays are known: a tilt takes up what it is wrong by."""

_OFFSET, _CAVITIES = shape("offset", "half-widths", -1.5, 1.5, 0.0, -0.6), shape("cavities", "1", 0.7, 5.0, 2.0)

_MOST_DRIFT = 2e-2
"""A line drifts by some 3e-4 of its length a kelvin. Rays that meet the filter k times less steeply than the field
tilt it k² times less, beside which it drifts by so much more."""

class FilterShift(LightFactor):
    """I *= T(y) / T(offset), T(y) = 1 / (1 + y^(2·cavities)), y = offset + tilt·(s(θ) + line_drift·ΔT).

    s(θ) = 1 − sqrt(1 − sin²θ / index²): a passband moves to shorter wavelengths with the angle, the line comes to lie
    on its long side. `tilt` is the wavelength over the half-width; the line's drift against the filter is tilt times
    `line_drift`, a relative change of wavelength per kelvin, so that temperature never acts without the angle.
    `offset`: where the line lies in the passband at normal incidence at the reference temperature.

    A filter that is turned in a beam (a logged angle of its own) has that angle in the place of the field's.

    A simulation that has the passband at the reference temperature (option `simulated`) lacks the drift alone:
    I *= T(x + drift·ΔT) / T(x), x = offset + tilt·s(θ); there the drift is what is nil, and the tilt a shape. Where
    only pixels tell the angle, `line` is how far the line is off at the reference temperature, which is a guess.
    """

    id = "optics.filter_shift"
    stage = Stage.OPTICS
    source = "Macleod, Thin-Film Optical Filters (2010), ch. 8: tilted filters; laser diodes 0.25 to 0.3 nm/K"
    confusable = ("optics.vignetting", "laser.thermal_rolloff", "beam.profile_shift", "detector.gain_temperature")

    def variants(self, view: View) -> Iterable[Variant]:
        """With the angle alone, and with the laser's (or the next best) temperature; none where neither is known.

        With the best temperature also as what a simulation lacks that has the passband but not its drift.
        """
        columns = temperature_drivers(view, "laser_temperature_c", "housing_temperature_c", limit=2)
        yield from self._by_its_tilt(view, columns[:1])
        if not field_rays(view) and has_field(view):
            yield from self._by_pixels(view, columns[:1])
        if not (field_rays(view) or "laser_temperature_c" in columns):
            return
        reach = _reach(view, field_rays(view)) if field_rays(view) else 1.0
        for channel in lit_signals(view):
            kinds = [(column, False, False) for column in columns]
            if field_rays(view):
                kinds += [("", False, False), ("", False, True), *((column, True, False) for column in columns[:1])]
            for column, simulated, usual in kinds:
                parameters: list[Parameter] = []
                if simulated:
                    parameters.append(self._drift(view, column))
                    parameters.append(
                        shape("tilt", "half-widths", 0.3 / reach, 8.0 / reach, 1.0 / reach, 3.0 / reach)
                    )
                elif field_rays(view):
                    parameters.append(amplitude("tilt", "half-widths", 0.0, 8.0 / reach, 0.3 / reach))
                if column and field_rays(view) and not simulated:
                    parameters.append(shape("line_drift", "1/K", -_MOST_DRIFT, _MOST_DRIFT, 2.7e-4, 2e-5))
                elif column and not simulated:
                    parameters.append(self._drift(view, column))
                parameters += [
                    shape("offset", "half-widths", -1.5, 1.5, -0.5, 0.3) if column else _OFFSET,
                    *(() if usual else (_CAVITIES,)),
                ]  # fmt: skip
                rays = field_rays(view)
                yield Variant(
                    effect=self.id,
                    options={
                        "channel": channel,
                        "temperature": column,
                        "reference": reference(view, column) if column else 0.0,
                        **({"simulated": True} if simulated else {}),
                        **({"cavities": USUAL_CAVITIES} if usual else {}),
                    },
                    parameters=tuple(parameters),
                    channels=light_channels(view, channel),
                    drivers=(column, *rays) if simulated else (*rays[:1], *((column,) if column else ()), *rays[1:]),
                )

    def _by_pixels(self, view: View, columns: Sequence[str]) -> Iterable[Variant]:
        """The same where no rays are known: with the angle alone, with a temperature, and as its drift alone."""
        reach = float(_shift(USUAL_REACH**2 / (1.0 + USUAL_REACH**2)))
        kinds = [("", False), *((column, simulated) for column in columns for simulated in (False, True))]
        for channel, (column, simulated) in itertools.product(lit_signals(view), kinds):
            drift = (shape("line_drift", "1/K", -_MOST_DRIFT, _MOST_DRIFT, 2.7e-4, 2e-5),) if column else ()
            parameters = (amplitude("tilt", "half-widths", 0.0, 200.0, 5.0), *drift)
            if simulated:
                tilt = shape("tilt", "half-widths", 0.3 / reach, 8.0 / reach, 1.0 / reach, 3.0 / reach)
                parameters = (self._drift(view, column), amplitude("line", "half-widths", -1.5, 1.5, 0.05), tilt)
            yield Variant(
                effect=self.id,
                options={
                    "channel": channel, "temperature": column, "reach": USUAL_REACH,
                    "reference": reference(view, column) if column else 0.0, **middle_options(view),
                    **({"simulated": True} if simulated else {}),
                },
                parameters=(*parameters, _OFFSET, _CAVITIES),
                channels=light_channels(view, channel),
                drivers=(column, *PIXEL) if simulated else (*PIXEL, *((column,) if column else ())),
            )  # fmt: skip

    def _by_its_tilt(self, view: View, columns: Sequence[str]) -> Iterable[Variant]:
        """The same of a filter that is turned in a beam: with its angle alone, and with a temperature."""
        turned = [n for n in view.covariates() if is_of(n, "filter") and unit_of(n) == "deg" and view.varies(n)]
        for name, channel, column in itertools.product(turned[:1], lit_signals(view), ("", *columns)):
            reach = _reach(view, (name,))
            yield Variant(
                effect=self.id,
                options={
                    "channel": channel, "temperature": column, "turned": name,
                    "reference": reference(view, column) if column else 0.0,
                },
                parameters=(
                    amplitude("tilt", "half-widths", 0.0, 8.0 / reach, 0.3 / reach),
                    *((self._drift(view, column),) if column else ()),
                    _OFFSET,
                    _CAVITIES,
                ),
                channels=light_channels(view, channel),
                drivers=(name, *((column,) if column else ())),
            )  # fmt: skip

    @staticmethod
    def _drift(view: View, column: str) -> Parameter:
        most = 8.0 / span(view, column)
        return amplitude("drift", "half-widths/K", -most, most, 0.03 * most)

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Transmission against that on the axis at the reference temperature."""
        offset = float(values["offset"])
        power = 2.0 * float(values["cavities"] if "cavities" in values else variant.options["cavities"])
        place = np.full(view.n, offset)
        if "tilt" in values:
            if "reach" in variant.options:
                tangent = float(variant.options["reach"]) * image_radius(variant, view)
                square = tangent**2 / (1.0 + tangent**2)
            elif "turned" in variant.options:
                square = np.sin(np.radians(view.number(str(variant.options["turned"])))) ** 2
            else:
                square = per_view(view, "field sine square", lambda: _sine_square(view))
            place = place + float(values["tilt"]) * _shift(square)
        known = place if variant.options.get("simulated") else np.full(view.n, offset)
        column = str(variant.options["temperature"])
        if column:
            drift = (
                float(values["drift"]) if "drift" in values else float(values["tilt"]) * float(values["line_drift"])
            )
            place = place + drift * excess(view, variant, column) + float(values.get("line", 0.0))
        passed, assumed = (1.0 / (1.0 + np.minimum(np.abs(y), 1e3) ** power) for y in (place, known))
        return np.asarray(np.clip(passed / assumed, 1e-6, 1e6))

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["temperature"]
        terms = "offset"
        if "reach" in variant.options:
            terms += (
                f" + tilt * (1 - sqrt(1 - sin(field angle)^2 / {USUAL_INDEX:g}^2)), tan(field angle) = "
                f"{variant.options['reach']:g} * distance from the middle / the corner's"
            )
        elif "turned" in variant.options:
            terms += f" + tilt * (1 - sqrt(1 - sin({variant.options['turned']})^2 / {USUAL_INDEX:g}^2))"
        elif any(parameter.name == "tilt" for parameter in variant.parameters):
            terms += f" + tilt * (1 - sqrt(1 - sin(field angle)^2 / {USUAL_INDEX:g}^2))"
        angle = terms
        if column:
            named = {parameter.name for parameter in variant.parameters}
            drift = "tilt * line_drift" if "line_drift" in named else "drift"
            terms += f" + {drift} * ({column} - {variant.options['reference']})" + " + line" * ("line" in named)
        known = "offset"
        if variant.options.get("simulated"):
            known, terms = "x", f"x{terms[len(angle) :]}, x = {angle}"
        order = f"{2.0 * float(variant.options['cavities']):g}" if "cavities" in variant.options else "(2 cavities)"
        return f"{channel} *= T(y) / T({known}), T = 1 / (1 + |y|^{order}), y = {terms}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Change of the signal over field and temperature."""
        column = variant.options["temperature"]
        angle = str(variant.options.get("turned", "the field angle"))
        with_what = f"with {angle}" if not column else f"with {angle.removeprefix('the ')} and {column}"
        change = percent(*self.change(variant, values, view))
        if variant.options.get("simulated"):
            return (
                f"The laser line drifts with {column} in the filter's passband, whose place at each angle the "
                f"simulation has at {variant.options['reference']:g} °C only: the signal differs {change}."
            )
        return f"The laser line wanders across the filter's passband {with_what}: the signal differs {change}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from vignetting and roll-off."""
        return (
            "Step the laser's cooler set-point at constant housing temperature and look at the edge of the field: a "
            "passband's loss there changes side with the line, vignetting does not move."
        )


def _sine_square(view: View) -> FloatArray:
    return np.clip(1.0 - field_cosine(view) ** 2, 0.0, 1.0)


def _reach(view: View, angles: Sequence[str]) -> float:
    """s of the outermost ray of the table, for the usual index."""
    square = np.sin(np.radians(max(max(map(abs, view.span(name))) for name in angles))) ** 2
    return float(np.clip(_shift(square), 2e-3, 0.15))


def _shift(square: float | FloatArray) -> FloatArray:
    """s(θ) from sin²θ, for the usual index."""
    return np.asarray(1.0 - np.sqrt(1.0 - np.asarray(square) / USUAL_INDEX**2))
