"""Ice or condensate on the window around the dew and ice point: absorbs, scatters, remembers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effect import Option, Parameter, Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    light_channels,
    per_view,
    rounded,
    shape,
    signals,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_history import History, history, low_pass, on_rows, reservoir, settles_at
from arl_fixtures.reconcile.effects_illumination import field_cosine
from arl_fixtures.reconcile.effects_moist_air import dew_points, moistures, vapour_hpa
from arl_fixtures.reconcile.view import View


class WindowFrost(LightFactor):
    """I *= exp(−(depth + lean·h) · F / cos(θ)^slant), F the film, h from −1 (lower) to +1 (upper image edge).

    θ is the field angle: through ice one looks the further the more aslant, up to slant = 1 for a rough film, less as
    the film bends the rays upright. Plain films (slant 0) are tried first.

    * balance: dF/dt = e(onset) − e(T), e the vapour pressure: grows in proportion to the supersaturation below the
      dew or frost point `onset`, goes in proportion to the deficit above, `melt` times as fast; F ≥ 0.
    * dew point (where one is logged, or a relative humidity): the balance with e(dew point + margin) for e(onset),
      moist air as it came.
    * Where a bench soaks, T steps early on its way between two steps' rows; else it goes in a straight line.
    * covered: of a film of small crystals the share of the window that they cover counts, 1 − exp(−F / full): more
      ice on a white window takes no more light, and a thick film shows for long after it has begun to go.
    * settled: F follows max(onset − T, 0) within a time constant, from none: film and vapour near equilibrium.
    """

    id = "optics.window_frost"
    stage = Stage.OPTICS
    weather = True
    single = True
    source = (
        "Na, Webb, Int. J. Heat Mass Transfer 47 (2004) 925: growth by supersaturation; Magnus formula (WMO-No. 8)"
    )
    confusable = ("laser.thermal_rolloff", "detector.gain_temperature", "laser.power_decay")

    def variants(self, view: View) -> Iterable[Variant]:
        """A mass balance and a settled film, on the temperature nearest to the window."""
        columns = temperature_drivers(
            view, "window_temperature_c", "housing_temperature_c", limit=1, never=("laser_", "tof_", "fpga_")
        ) or temperature_drivers(view, limit=1)
        for channel in signals(view):
            for column in columns:
                low, high = view.span(column)
                if low > _WARMEST_C or high < _COLDEST_C:
                    continue
                record = history(view, column)
                onset = shape("onset", "°C", max(low, _COLDEST_C), min(high, _WARMEST_C) + 0.1, 2.0, 10.0)
                deep = max(onset.starts[0] - low, 0.02 * (high - low))
                options: dict[str, Option] = {"channel": channel, "temperature": column, **_heights(view)}
                memory: tuple[Parameter, ...] = ()
                if record is not None:
                    most = max(float(_film(record, onset.starts[0], 1.0).max()), 1e-6)
                    unit = _film_unit(record)
                    depths = _depths(f"1/({unit})", most)
                    rest = shape("melt", "1", 0.02, 50.0, 1.0), *_soak(record)
                    yield self._variant(view, {**options, "kind": "balance"}, (*depths, onset, *rest))
                    yield from self._from_moist_air(view, options)
                    first = replace(onset, starts=onset.starts[:1])
                    full = shape("full", unit, 0.01 * most, 2.0 * most, 0.1 * most)
                    told = {**options, "kind": "balance", "covers": True}
                    yield self._variant(view, told, (*_depths("1", 1.0), first, *rest, full))
                    if float(_axis_cosine(view).min()) < _NARROW:
                        slant = shape("slant", "1", 0.0, 2.0, 1.0)
                        told = {**options, "kind": "balance", "aslant": True}
                        yield self._variant(view, told, (*depths, first, *rest, slant))
                    jump = settles_at(view, column)
                    if jump is not None:
                        told = {**options, "settles_at": jump}
                        yield self._variant(view, {**told, "kind": "balance"}, (*depths, first, *rest))
                        yield from self._from_moist_air(view, told)
                    longest = record.interval * record.values.shape[1]
                    unit = record.unit
                    memory = (shape("lag", unit, 1e-3 * longest, longest, 0.01 * longest),)
                yield self._variant(
                    view,
                    {**options, "kind": "settled"},
                    (*_depths("1/K", deep), onset, *memory),
                )

    def _from_moist_air(self, view: View, options: dict[str, Option]) -> Iterable[Variant]:
        for air in moistures(view):
            record, dew = _record(view, options), dew_points(view, air)
            if record is None or dew is None:
                continue
            most = float(_film(record, dew, 1.0).max())
            if most > 0.0:
                margin, melt = shape("margin", "K", -8.0, 8.0, 0.0, 4.0), shape("melt", "1", 0.02, 50.0, 1.0)
                depths = _depths(f"1/({_film_unit(record)})", most)
                yield self._variant(
                    view, {**options, "kind": "dew point", **air}, (*depths, margin, melt, *_soak(record))
                )

    def _variant(self, view: View, options: dict[str, Option], parameters: tuple[Parameter, ...]) -> Variant:
        column, channel = str(options["temperature"]), str(options["channel"])
        drivers = [
            name
            for name in (column, str(options.get("humidity", options.get("dew", "ramp"))), "elevation_deg", "pixel_v")
            if name == column or view.varies(name)
        ]
        return Variant(
            effect=self.id,
            options=options,
            parameters=parameters,
            channels=light_channels(view, channel),
            drivers=tuple(drivers[:3]),
        )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Transmission of the film, both ways of the light."""
        column = str(variant.options["temperature"])
        onset, before = float(values.get("onset", 0.0)), float(values.get("before", 0.0))
        record = _record(view, variant.options)
        dew = dew_points(view, variant.options)
        if record is not None and dew is not None:
            film = on_rows(view, _film(record, dew + float(values["margin"]), float(values["melt"]), before))
        elif record is None:
            film = np.nan_to_num(np.maximum(onset - view.number(column), 0.0))
        elif variant.options["kind"] == "balance":
            film = on_rows(view, _film(record, onset, float(values["melt"]), before))
        else:
            cold = np.maximum(onset - record.values, 0.0)
            clean = np.concatenate([np.zeros_like(cold[:, :1]), cold], axis=1)  # a window that has no film yet
            film = on_rows(view, low_pass(clean, record.interval / float(values["lag"]))[:, 1:])
        if "full" in values:
            film = -np.expm1(-film / float(values["full"]))
        if "slant" in values:
            film = film * _axis_cosine(view) ** -float(values["slant"])
        depth = float(values["depth"])
        if values["lean"] != 0.0:
            height = per_view(view, ("height", variant.options["upper"]), lambda: _height(variant, view))
            film = film * (depth + float(values["lean"]) * height)
        else:
            film = film * depth
        return np.exp(-np.clip(film, -1.0, 20.0))

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """Temperatures below the onset."""
        column = str(variant.options["temperature"])
        return {column: [view.span(column)[0], _warmest_film(variant, values, view)]}

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["temperature"]
        if variant.options["kind"] == "dew point":
            dew = variant.options["dew"]
            if "humidity" in variant.options:
                dew = f"dew point of {variant.options['humidity']} at {dew}"
            moist = f"e({dew} + margin)"
            film = f"dF/dt = {moist} - e({column}), times melt where negative, F >= 0, e the vapour pressure"
        elif variant.options["kind"] == "balance":
            film = f"dF/dt = e(onset) - e({column}), times melt where negative, F >= 0, e the vapour pressure"
        else:
            film = f"F = max(onset - {column}, 0), delayed by lag"
        soaks = variant.options.get("settles_at")
        held = f"; {column} steps at {soaks} of the way from a step's rows to the next one's" if soaks else ""
        aslant = " / cos(field angle)^slant" if "aslant" in variant.options else ""
        share = "(1 - exp(-F / full))" if "covers" in variant.options else "F"
        return f"{channel} *= exp(-(depth + lean * height) * {share}{aslant}); {film}{held}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss and onset."""
        low, _ = self.change(variant, values, view)
        column = variant.options["temperature"]
        text = (
            f"Ice or condensate on the window takes up to {-low:.1f} % of the light below "
            f"{_warmest_film(variant, values, view):.1f} °C "
            f"of {column}"
        )
        lean = float(values["lean"])
        if abs(lean) > 0.2 * float(values["depth"]):
            text += ", more at the top" if lean > 0.0 else ", more at the bottom"
        if variant.options["kind"] == "dew point":
            text += f", as {variant.options.get('humidity', variant.options['dew'])} says when the air is moist"
        if variant.options["kind"] != "settled":
            text += "; it melts later than it forms, so heating differs from cooling"
        return f"{text}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a cold laser."""
        return (
            "Repeat the coldest step with dry air or nitrogen blown at the window: frost goes, everything else stays."
        )


_COLDEST_C, _WARMEST_C = -20.0, 25.0
_NARROW, _GRAZING = 0.85, 0.1
"""Cosine of the outermost field angle from which on a film is as thick as in the middle, and the least one."""
_COLD_START_C = 5.0
"""Temperature of its first row below which a record began when there may have been ice."""


def _depths(unit: str, film: float) -> tuple[Parameter, Parameter]:
    """How much a film takes in the middle of the image, and how much more at its upper edge."""
    return (
        amplitude("depth", unit, 0.0, 30.0 / film, 0.1 / film),
        amplitude("lean", unit, -15.0 / film, 15.0 / film, 0.02 / film),
    )


def _film_unit(record: History) -> str:
    """Unit of a film: vapour pressure that exceeds saturation, over time."""
    return "hPa h" if record.unit == "s" else "hPa step"


def _axis_cosine(view: View) -> FloatArray:
    """Cosine of every row's field angle; nobody looks through a window more aslant than `_GRAZING`."""
    return per_view(view, "through the window", lambda: np.maximum(field_cosine(view), _GRAZING))


def _warmest_film(variant: Variant, values: Values, view: View) -> float:
    """Temperature below which film forms; by a dew point the highest one that was logged."""
    dew = dew_points(view, variant.options)
    if dew is not None:
        return float(dew.max()) + float(values["margin"])
    return float(values["onset"])


def _soak(record: History) -> tuple[Parameter, ...]:
    """How long it had been as cold as the first row says, for records that begin in the cold."""
    if float(np.median(record.values[:, 0])) > _COLD_START_C:
        return ()
    longest = 0.5 * record.interval * record.values.shape[1]
    return (shape("before", record.unit, 0.0, longest, 0.2 * longest),)


def _film(record: History, onset: FloatArray | float, melt: float, before: float = 0.0) -> FloatArray:
    """Film in hectopascal-hours (hectopascal-steps without time); `before` the record it grew as at its start."""
    hours = record.interval / (3600.0 if record.unit == "s" else 1.0)
    surplus = vapour_hpa(onset) - vapour_hpa(record.values)
    grown = np.where(surplus > 0.0, surplus, melt * surplus) * hours
    grown[:, 0] += np.maximum(surplus[:, 0], 0.0) * hours * before / record.interval
    return reservoir(grown)


def _record(view: View, options: Mapping[str, Option]) -> History | None:
    """History of the temperature, which changes right after a step's rows where it was steady in the next ones."""
    jump = options.get("settles_at")
    return history(view, str(options["temperature"]), None if jump is None else float(str(jump)))


def _heights(view: View) -> dict[str, Option]:
    """Lower and upper end of the field of view, for `height` from 0 to 1 (image rows count downwards)."""
    if view.varies("elevation_deg"):
        low, high = view.span("elevation_deg")
        return {"height": "elevation_deg", "lower": rounded(low), "upper": rounded(high)}
    if view.varies("pixel_v"):
        low, high = view.span("pixel_v")
        return {"height": "pixel_v", "lower": high, "upper": low}
    across = _zones_across(view)
    if across:
        return {"height": "zone", "across": across, "lower": across - 1.0, "upper": 0.0}
    return {"height": "", "lower": 0.0, "upper": 1.0}


def _zones_across(view: View) -> int:
    """Zones in a row of a square of them, numbered row by row as range modules do; 0 where there is none."""
    zones = view.columns.numbers.get("zone")
    if zones is None or not np.all(np.isfinite(zones)):
        return 0
    known = np.unique(zones)
    across = int(np.rint(np.sqrt(known.size)))
    return across if across > 1 and np.array_equal(known, np.arange(across**2)) else 0


def _height(variant: Variant, view: View) -> FloatArray:
    """Place of the pixel between the lower (−1) and the upper (+1) edge of the image."""
    name = str(variant.options["height"])
    if not name:
        return np.zeros(view.n)
    low, high = float(variant.options["lower"]), float(variant.options["upper"])
    place = view.number(name)
    if "across" in variant.options:
        place = place // float(variant.options["across"])
    share = np.nan_to_num((place - low) / (high - low), nan=0.5)
    return np.clip(2.0 * share - 1.0, -1.5, 1.5)
