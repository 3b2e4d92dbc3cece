"""More scatter than the noise model says, everywhere or under a condition."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.effect import Effect, Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    amplitude,
    per_table,
    rounded,
    shape,
    temperature_drivers,
)
from arl_fixtures.reconcile.grouping import DEVICE_WORDS, DRIVES, UNIT_WORDS
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import View

BoolArray = NDArray[np.bool_]

_NO_CONDITION = ("mixed", "surface")
_MOST_STATES, _FEWEST = 5, 20
"""Names of a condition that are tried one by one, and rows that each of them needs."""
_NO_SWITCH = ("dut", "cycle", "step", "ramp", "pixel_u", "pixel_v", "n_frames")


class NoiseExcess(Effect):
    """σ *= 1 + factor·c, or σ² += (added·c)²; c is the condition.

    * everywhere: c = 1.
    * growing: c = 2^((T − highest) / doubling).
    * split: one factor below and one above a knee of a temperature, the image or the ramp.
    * rising: c = max(x − knee, 0) / (highest − knee) of the range or another condition, of its fall, or of its size
      where it goes both ways (the current of a cooler that heats as well).
    * while: c = 1 while something is switched on (a lamp, a heater) or a condition has one of its few names or values
      (a bias), else 0.
    """

    id = "readout.noise_excess"
    stage = Stage.READOUT
    source = "EMVA 1288 (2021): temporal dark noise and total SNR of image sensors"
    confusable = ("laser.pulse_energy_jitter", "detector.dark_offset", "bench.repeatability")

    def variants(self, view: View) -> Iterable[Variant]:
        """Per scatter channel: everywhere, growing with a temperature, while on, split by temperature or image."""
        columns = temperature_drivers(
            view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", limit=1
        )
        split = [name for name in (*columns, "pixel_u", "pixel_v", "ramp") if view.varies(name)]
        for channel in view.channels(Role.SCATTER):
            yield self._variant(view, channel.name, {"condition": "everywhere"}, ())
            for column in columns:
                options: dict[str, Option] = {"column": column, "highest": rounded(view.span(column)[1])}
                growth = shape("doubling", "K", 3.0, 200.0, 20.0)
                yield self._variant(view, channel.name, {"condition": "growing", **options}, (growth,))
            for column, level in _switches(view):
                yield self._variant(view, channel.name, {"condition": "while", "column": column, "level": level}, ())
            for column in _conditions(view, columns):
                low, high = view.span(column)
                for end in ("high", "low"):
                    start = low + (0.25 if end == "high" else 0.75) * (high - low)
                    knee = shape("knee", unit_of(column), low, high, start)
                    ends: dict[str, Option] = {
                        "column": column,
                        "end": end,
                        "reach": rounded(high if end == "high" else low),
                    }
                    yield self._variant(view, channel.name, {"condition": "rising", **ends}, (knee,))
                if min(-low, high) > _BOTH_WAYS * (high - low):  # a current that heats and cools
                    reach = rounded(max(-low, high))
                    ends = {"column": column, "end": "size", "reach": reach}
                    knee = shape("knee", unit_of(column), 0.0, reach, 0.0)
                    yield self._variant(view, channel.name, {"condition": "rising", **ends}, (knee,))
            for column in split:
                low, high = view.span(column)
                starts = [low + share * (high - low) for share in ((0.5,) if column == "ramp" else (0.5, 0.25, 0.75))]
                options = {"condition": "split", "column": column, "width": rounded(0.01 * (high - low))}
                knee = shape("knee", unit_of(column).replace("1", "px"), low, high, *starts)
                yield self._variant(view, channel.name, options, (knee,))

    def _variant(self, view: View, name: str, options: dict[str, Option], shapes: tuple[Parameter, ...]) -> Variant:
        values = view.columns.numbers[f"sim_{name}"]
        finite = values[np.isfinite(values)]
        usual = max(float(np.median(finite)), 1e-12) if finite.size else 1.0
        if options["condition"] == "split":
            sizes = (amplitude("factor_below", "1", 0.0, 20.0, 0.1), amplitude("factor_above", "1", 0.0, 20.0, 0.1))
        else:
            sizes = (
                amplitude("factor", "1", 0.0, 20.0, 0.1),
                amplitude("added", unit_of(name), 0.0, 50.0 * usual, 0.3 * usual),
            )
        return Variant(
            effect=self.id,
            options={"channel": name, **options},
            parameters=(*sizes, *shapes),
            channels=(name,),
            drivers=(str(options["column"]),) if "column" in options else (f"sim_{name}",),
        )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Widens the scatter."""
        name = str(variant.options["channel"])
        if variant.options["condition"] == "split":
            beyond = _beyond(variant, values, view)
            factor = float(values["factor_below"]) * (1.0 - beyond) + float(values["factor_above"]) * beyond
            state[name] = state[name] * (1.0 + factor)
            return
        under: FloatArray = np.ones(view.n)
        if variant.options["condition"] == "growing":
            warm = np.nan_to_num(view.number(str(variant.options["column"]))) - float(variant.options["highest"])
            under = np.exp2(np.clip(warm / float(values["doubling"]), -60.0, 4.0))
        elif variant.options["condition"] == "rising":
            under = _risen(variant, values, view)
        elif variant.options["condition"] == "while":
            under = _is_on(view, variant).astype(float)
        scaled = state[name] * (1.0 + float(values["factor"]) * under)
        state[name] = np.sqrt(scaled**2 + (float(values["added"]) * under) ** 2)

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """The noisier side of the knee, or where the switch is on."""
        if variant.options["condition"] == "while":
            switch = str(variant.options["column"])
            level = str(variant.options["level"])
            return {switch: [level] if view.is_category(switch) else [float(level)] * 2}
        if variant.options.get("end") == "size":
            return {}
        if variant.options["condition"] == "rising":
            ends = float(values["knee"]), float(variant.options["reach"])
            return {str(variant.options["column"]): [min(ends), max(ends)]}
        if variant.options["condition"] != "split":
            return {}
        column, knee = str(variant.options["column"]), float(values["knee"])
        low, high = view.span(column)
        return {column: [knee, high] if values["factor_above"] >= values["factor_below"] else [low, knee]}

    def expression(self, variant: Variant) -> str:
        """The law."""
        name, column = variant.options["channel"], variant.options.get("column", "")
        if variant.options["condition"] == "split":
            return f"{name} *= 1 + factor_below where {column} < knee, 1 + factor_above elsewhere"
        grown = ", c = 1"
        if variant.options["condition"] == "growing":
            grown = f", c = 2^(({column} - {variant.options['highest']}) / doubling)"
        elif variant.options["condition"] == "rising":
            column = f"|{column}|" if variant.options["end"] == "size" else column
            grown = f", c = max(({column} - knee) / ({variant.options['reach']} - knee), 0)"
        elif variant.options["condition"] == "while":
            grown = f", c = [{column} = {variant.options['level']}]"
        return f"{name}^2 = ({name} * (1 + factor * c))^2 + (added * c)^2{grown}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Factor and condition."""
        name, column = str(variant.options["channel"]), variant.options.get("column", "")
        state = {name: view.sim[name]}
        self.apply(variant, values, state, view)
        ratio = float(np.nanquantile(state[name] / view.sim[name], 0.95)) if view.n else 1.0
        condition = "everywhere"
        if variant.options["condition"] == "growing":
            condition = f"at the highest {column}, less below"
        if variant.options["condition"] == "while":
            condition = f"while {column} is {variant.options['level']}"
        if variant.options["condition"] == "rising":
            side = "below" if variant.options["end"] == "low" else "above"
            column = f"the size of {column}" if variant.options["end"] == "size" else column
            condition = f"where {column} is {side} {values['knee']:.4g}, the more the farther"
        if variant.options["condition"] == "split":
            above = values["factor_above"] >= values["factor_below"]
            condition = f"where {column} is {'above' if above else 'below'} {values['knee']:.4g}"
        return f"{name} is up to {ratio:.2f} times what the noise model says, {condition}."

    def next_experiment(self, variant: Variant) -> str:
        """What shows its origin."""
        return "Record dark frames (window covered) and frames of one bright target: read-out noise is in both alike."


def _switches(view: View) -> list[tuple[str, str]]:
    """Columns that say which of few states something is in, with the state that is tried: on, 1, any of its names."""
    found: list[tuple[str, str]] = []
    for name, (codes, labels) in view.columns.categories.items():
        if not view.is_category(name) or name in _NO_CONDITION or name.startswith((*UNIT_WORDS, *DEVICE_WORDS)):
            continue
        if sorted(labels) == ["false", "true"]:
            found.append((name, "true"))
        elif 1 < len(labels) <= _MOST_STATES and np.bincount(codes[codes >= 0]).min() >= _FEWEST:
            found += [(name, label) for label in labels]
    covariates = view.covariates()
    for name, values in view.columns.numbers.items():
        if not view.varies(name) or name in _NO_SWITCH:
            continue
        told, rows = np.unique(values[np.isfinite(values)], return_counts=True)
        if told.tolist() == [0.0, 1.0] and unit_of(name) == "1":
            found.append((name, "1"))
        elif name in covariates and _may_cause(name) and told.size < _FEWEST_LEVELS and rows.min() >= _FEWEST:
            found += [(name, f"{level:g}") for level in told]  # a bias, an exposure: set to few values
    return found


def _may_cause(name: str) -> bool:
    """Whether noise may hang on a covariate, beside temperatures: places, targets and times are no cause."""
    return name not in _NO_CAUSE and not name.endswith(("_c", "_std"))


_NO_CAUSE = ("azimuth_deg", "elevation_deg", "incidence_deg", "reflectance", "stage_angle_deg", "time_s", *_NO_SWITCH)
_MOST_CONDITIONS, _FEWEST_LEVELS = 5, 4
_BOTH_WAYS = 0.15
"""Share of a condition's span that must lie on either side of nil for its size to be a condition of its own."""


def _conditions(view: View, temperatures: tuple[str, ...]) -> list[str]:
    """Conditions that scatter may rise with beside the temperature: the range, what is no current or voltage, few."""

    def make() -> list[str]:
        names = [name for name in view.covariates() if _may_cause(name) and name not in temperatures]
        usual = sorted(names, key=lambda n: (n != "true_range_m", unit_of(n) in DRIVES, n))
        several = (n for n in usual if _has_levels(view, n))
        return list(itertools.islice(several, _MOST_CONDITIONS))

    return per_table(view, ("noise conditions", temperatures), make)


def _has_levels(view: View, name: str) -> bool:
    return np.unique(view.columns.numbers[name]).size >= _FEWEST_LEVELS


def _risen(variant: Variant, values: Values, view: View) -> FloatArray:
    """Share of the way from the knee to the end of a condition; 0 before the knee."""
    knee, reach = float(values["knee"]), float(variant.options["reach"])
    way = reach - knee if abs(reach - knee) > 1e-12 else 1e-12
    place = view.number(str(variant.options["column"]))
    if variant.options["end"] == "size":
        place = np.abs(place)
    return np.maximum(np.nan_to_num((place - knee) / way), 0.0)


def _is_on(view: View, variant: Variant) -> BoolArray:
    column = str(variant.options["column"])
    if view.is_category(column):
        return view.selects(column, str(variant.options["level"]))
    return np.isclose(view.number(column), float(variant.options["level"]), rtol=1e-5)


def _beyond(variant: Variant, values: Values, view: View) -> FloatArray:
    """0 below the knee, 1 above, smooth over a hundredth of the range."""
    place = np.nan_to_num(view.number(str(variant.options["column"])))
    return np.asarray(0.5 + 0.5 * np.tanh((place - float(values["knee"])) / float(variant.options["width"])))
