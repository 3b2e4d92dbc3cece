"""The reflectance depends on the incidence angle."""

from __future__ import annotations

import json
from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_bounce import incidence_deg
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    light_channels,
    per_view,
    percent,
    shape,
    signals,
)
from arl_fixtures.reconcile.effects_oblique import seen_in_mixed
from arl_fixtures.reconcile.effects_pulled import means_by_light, pull_ranges
from arl_fixtures.reconcile.effects_surface import TOGETHER, light_share, surface_names, surfaces_of_a_kind
from arl_fixtures.reconcile.effects_targets import before, rows_before, target_column
from arl_fixtures.reconcile.pixel_calibration import calibrated_by_surface
from arl_fixtures.reconcile.view import View


class NonLambertian(LightFactor):
    """I *= 1 + oblique·sin²a + lobe·max(cos 2a, 0)^sharpness, 1 + rough·sin a·tan a, or 1 + facets·tan²a.

    Of targets of several reflectances also 1 + rough·sin a·tan a + gloss/reflectance·exp(−tan²a/slope²)·G/cos⁶a: what
    the face of a paint sends back, by facets that stand upright to the light, has not the paint's colour.

    On all surfaces, on those of a kind or on one. `oblique` > 0 is a rough surface that stays bright when seen
    obliquely, `lobe` a gloss about normal incidence: light comes back along its way, so the angle to the mirror
    direction is 2a. `rough` is the second term of Oren's and Nayar's law. Facets of small slopes (`facets` is their
    mean square) face the light where they stand up. Where reflectances were fitted to the recording, the change is
    nil on each surface's average.
    """

    id = "target.non_lambertian"
    stage = Stage.TARGET
    source = (
        "Oren, Nayar, SIGGRAPH 1994 (rough diffuse); Phong, CACM 18 (1975) 311 (lobe), for source and eye together"
    )
    confusable = ("optics.vignetting", "target.reflectance_error", "stage.eccentricity", "air.multipath")

    def variants(self, view: View) -> Iterable[Variant]:
        """All surfaces, those of a kind, and each of the four most seen."""
        if incidence_deg(view) is None:
            return
        drivers = tuple(
            name for name in ("incidence_deg", "azimuth_deg", "pixel_u", "stage_angle_deg") if view.varies(name)
        )
        for channel in signals(view):
            fitted = calibrated_by_surface(view.columns, channel)
            over: dict[str, Option] = {"fitted_over": _incidences(view)} if fitted else {}
            column, targets = target_column(view)
            for surface in ("", *surfaces_of_a_kind(view), *surface_names(view, 4), *targets):
                told: dict[str, Option] = {"column": column} if surface and column else {}
                pulled = () if told or over else means_by_light(view, channel)
                where = rows_before(column, surface) if told else {"surface": surface.split(TOGETHER)}
                ways: tuple[tuple[dict[str, Option], tuple[Parameter, ...]], ...] = (
                    ({}, _ROUGH_AND_GLOSSY),
                    ({"kind": "rough"}, _ROUGH),
                    ({"kind": "facets"}, _FACETS),
                    *((({"kind": "coated"}, _COATED),) if _has_paints(view) and not (surface or over) else ()),
                )
                for kind, parameters in ways:
                    yield Variant(
                        effect=self.id,
                        options={"channel": channel, "surface": surface, **kind, **over, **told},
                        parameters=parameters,
                        channels=tuple(dict.fromkeys((*light_channels(view, channel), *pulled))),
                        drivers=drivers[:1] if view.varies("incidence_deg") else drivers,
                        where=where if surface else {},
                    )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Reflectance against Lambert's law."""
        if variant.options.get("kind") == "coated":
            return np.maximum(1.0 + _coated(values, view), 0.02)
        bright = _excess(values, *per_view(view, "incidence terms", lambda: _terms(view)))
        if "fitted_over" in variant.options:
            bright = bright - self._mean_on_surfaces(variant, values, view)
        surface, channel = str(variant.options["surface"]), str(variant.options["channel"])
        names = surface.split(TOGETHER) if surface else []
        if "column" in variant.options:
            bright = bright * before(view, str(variant.options["column"]), surface)
        elif names:
            bright = bright * sum(light_share(view, channel, name) for name in names)
        if not {"column", "fitted_over"} & set(variant.options):
            at, seen = per_view(view, ("seen in mixed", channel), lambda: seen_in_mixed(view, channel))
            parts = [seen[name] for name in names or seen if name in seen]
            known = sum((share for share, _ in parts), np.zeros(at.size))
            mixed = sum((share * _excess(values, *_terms_of(angle)) for share, angle in parts), np.zeros(at.size))
            bright[at] = mixed if names else mixed + (1.0 - known) * bright[at]
        return np.maximum(1.0 + bright, 0.02)

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Multiplies the light; a pixel that sees two surfaces ranges nearer to the brighter one."""
        super().apply(variant, values, state, view)
        if {"column", "fitted_over"} & set(variant.options) or variant.options.get("kind") == "coated":
            return
        surface, channel = str(variant.options["surface"]), str(variant.options["channel"])
        if not set(means_by_light(view, channel)) & set(variant.channels):
            return
        at, seen = per_view(view, ("seen in mixed", channel), lambda: seen_in_mixed(view, channel))
        for name in surface.split(TOGETHER) if surface else seen:
            if name in seen:
                share, angle = seen[name]
                factor = np.ones(view.n)
                factor[at] = np.maximum(1.0 + share * _excess(values, *_terms_of(angle)), 0.02)
                pull_ranges(view, state, channel, name, factor)

    def _mean_on_surfaces(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """What a fit of each surface's reflectance to the recording took away; 0 on surfaces that were not in it."""
        over = {label: np.array(angles) for label, angles in json.loads(str(variant.options["fitted_over"])).items()}
        if not view.is_category("surface"):
            return np.zeros(view.n)
        codes, labels = view.codes("surface")
        means = np.zeros(len(labels) + 1)
        for k, label in enumerate(labels):
            if label in over:
                means[k] = float(np.mean(_excess(values, *_terms_of(over[label]))))
        return np.asarray(means[codes])

    def expression(self, variant: Variant) -> str:
        """The law."""
        on = f" on {_listed(variant)}" if variant.options["surface"] else ""
        if variant.options.get("kind") == "rough":
            return f"{variant.options['channel']} *= 1 + rough * sin(incidence_deg) * tan(incidence_deg){on}"
        if variant.options.get("kind") == "facets":
            return f"{variant.options['channel']} *= 1 + facets * tan(incidence_deg)^2{on}"
        if variant.options.get("kind") == "coated":
            return (
                f"{variant.options['channel']} *= 1 + rough * sin(incidence_deg) * tan(incidence_deg) "
                "+ gloss / reflectance * exp(-tan(incidence_deg)^2 / slope^2) * G / cos(incidence_deg)^6, "
                "G = min(1, 2 cos(incidence_deg)^2)"
            )
        return (
            f"{variant.options['channel']} *= 1 + oblique * sin(incidence_deg)^2 "
            f"+ lobe * cos(2 incidence_deg)^sharpness{on}"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Change of the signal."""
        where = f"of {_listed(variant)} " if variant.options["surface"] else ""
        change = percent(*self.change(variant, values, view))
        return f"The reflectance {where}depends on the angle of incidence: the signal differs {change}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from vignetting."""
        return (
            "Turn the panel about its own axis while the sensor stands still: a target's lobe follows the panel, "
            "vignetting follows the pixel."
        )


def _listed(variant: Variant) -> str:
    """The surfaces of a variant in words."""
    names = [f"'{name}'" for name in str(variant.options["surface"]).split(TOGETHER)]
    return (
        f"{variant.options.get('column', 'surface')} {names[0]}"
        if len(names) == 1
        else f"surfaces {', '.join(names[:-1])} and {names[-1]}"
    )


def _terms(view: View) -> tuple[FloatArray, FloatArray, FloatArray]:
    """sin² and tan² of the incidence and ln of the cosine of twice it; zero, or very small, where it is unknown."""
    angle = incidence_deg(view)
    return _terms_of(np.full(view.n, np.nan) if angle is None else angle[view.rows])


def _terms_of(incidence_deg: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    angle = np.radians(incidence_deg)
    sine = np.nan_to_num(np.sin(angle) ** 2)
    away = np.maximum(np.nan_to_num(np.cos(angle), nan=1.0), _GRAZING)
    mirror = np.log(np.maximum(np.nan_to_num(np.cos(2.0 * angle), nan=1e-6), 1e-6))
    return sine, sine / away**2, mirror


def _has_paints(view: View) -> bool:
    """Whether targets have several reflectances, which are all known."""
    return view.varies("reflectance") and float(view.span("reflectance")[0]) > 0.0


def _coated(values: Values, view: View) -> FloatArray:
    """What a rough paint under a face of facets adds to Lambert's law, of 1.

    D·G / (4·cos²a) over reflectance/π, D = exp(−tan²a/slope²) / (π·slope²·cos⁴a) (Cook, Torrance, ACM Trans. Graph. 1
    (1982) 7): source and eye are together, so that a facet faces both or neither; G is what facets shade.
    """
    sine, tangent, _ = per_view(view, "incidence terms", lambda: _terms(view))
    shaded = np.minimum(1.0, 2.0 / (1.0 + tangent))
    face = np.exp(-tangent / float(values["slope"]) ** 2) * (1.0 + tangent) ** 3 * shaded
    gloss = float(values["gloss"]) / np.maximum(np.nan_to_num(view.number("reflectance"), nan=np.inf), _BLACKEST)
    return np.asarray(float(values["rough"]) * np.sqrt(sine * tangent) + gloss * face)


def _excess(values: Values, sine: FloatArray, tangent: FloatArray, mirror: FloatArray) -> FloatArray:
    """What oblique light and the lobe, or facets, add to Lambert's law, of 1."""
    if "facets" in values:
        return np.asarray(float(values["facets"]) * tangent)
    if "rough" in values:
        return np.asarray(float(values["rough"]) * np.sqrt(sine * tangent))
    lobe = float(values["lobe"]) * np.exp(float(values["sharpness"]) * mirror)
    return np.asarray(float(values["oblique"]) * sine + lobe)


_GRAZING = 0.1
"""Cosine of the incidence (84°) beyond which facets stand in each other's shadow."""
_BLACKEST = 0.01
"""Reflectance below which no paint is."""
_COATED = (
    amplitude("rough", "1", -1.0, 3.0, 0.1),
    amplitude("gloss", "1", 0.0, 0.5, 0.01),
    shape("slope", "1", 0.03, 1.0, 0.2),
)
_ROUGH_AND_GLOSSY = (
    amplitude("oblique", "1", -2.0, 5.0, 0.1),
    amplitude("lobe", "1", -0.5, 5.0, 0.05),
    shape("sharpness", "1", 1.0, 200.0, 12.0),
)
_ROUGH = (amplitude("rough", "1", -0.5, 2.0, 0.05),)
_FACETS = (amplitude("facets", "1", 0.0, 1.0, 0.02),)
_QUANTILES = (np.arange(9) + 0.5) / 9


def _incidences(view: View) -> str:
    """Nine quantiles of each surface's incidence in the whole table, degrees, as JSON."""
    codes, labels = view.columns.categories["surface"]
    angle = incidence_deg(view)
    found: dict[str, list[float]] = {}
    if angle is None:
        return json.dumps(found)
    for k, label in enumerate(labels):
        seen = angle[np.isfinite(angle) & (codes == k)]
        if seen.size:
            found[label] = [round(float(x), 3) for x in np.quantile(seen, _QUANTILES)]
    return json.dumps(found)
