"""Optical power falls over cycles or operating hours."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effect import Option, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_age import age_drivers, age_options, age_scales, aged
from arl_fixtures.reconcile.effects_arrhenius import arrhenius
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    light_channels,
    lit_signals,
    per_view,
    rounded,
    set_light,
    shape,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_history import History, history, on_rows, time_column
from arl_fixtures.reconcile.effects_light_current import driving_currents, shifted
from arl_fixtures.reconcile.effects_one_laser import all_readouts, apply_to_all, with_all_readouts
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_FEWEST_STRESSED, _KEPT = 3, 0.05
"""Units that age at temperatures of their own, and how far each may leave its own, over what they differ by."""
FEWEST_UNITS, MOST_UNITS = 3, 16
"""Units of which each may age at its own pace: of two the one is told by a loss of its own."""


class PowerDecay(LightFactor):
    """I *= exp(−loss · age^exponent), age from 0 to 1 over the table; or age weighted by exp(−E/kT).

    * age: a column that counts it; of one that counts cycles also with the time within the cycle as a part of one.
    * each (where several units age): every unit loses its own share, by one exponent, or its threshold rises so.
    * stress (where each unit ages at a temperature of its own): loss · exp(−E/k·(1/T − 1/T_ref)) · age^exponent.
    * curve (where a drive current is swept): I(J) = exp(−loss·a^exponent) · I_sim(J − threshold_rise·a^exponent):
      what is lost in the cavity raises the threshold and lowers the slope.
    """

    id = "laser.power_decay"
    stage = Stage.LASER
    source = "Johnson, Prog. Quantum Electron. 2 (1973) 187 (diode degradation); Ea about 0.5 eV for 808 nm pump bars"
    confusable = ("optics.window_contamination", "laser.thermal_rolloff", "optics.window_frost")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per column that counts age, and one per time weighted by temperature."""
        return with_all_readouts(self._variants(view), view)

    def _variants(self, view: View) -> Iterable[Variant]:
        columns = age_drivers(view)
        warm = temperature_drivers(view, "laser_temperature_c", "housing_temperature_c", limit=2)
        for channel in lit_signals(view):
            currents = driving_currents(view, channel)
            for column in columns:
                plain: dict[str, Option] = {"channel": channel, "age": column, "temperature": ""}
                loss = amplitude("loss", "1", 0.0, 3.0, 0.05)
                exponent = shape("exponent", "1", 0.25, 3.0, 1.0)
                for scale in age_scales(view, column):
                    yield Variant(
                        effect=self.id,
                        options={**plain, **scale},
                        parameters=(loss, exponent),
                        channels=light_channels(view, channel),
                        drivers=(column,),
                    )
                yield from _each(view, plain, column, exponent)
                if column == "cycle" and view.varies("time_s"):
                    yield Variant(
                        effect=self.id,
                        options={**plain, **_running_options(view)},
                        parameters=(loss, exponent),
                        channels=light_channels(view, channel),
                        drivers=(column, "time_s"),
                    )
                stress = _stress(view)
                for rise, driven in _driven(view, currents):
                    if rise:
                        yield Variant(
                            effect=self.id,
                            options={**plain, **age_options(view, column), **driven},
                            parameters=(*rise, loss, exponent),
                            channels=light_channels(view, channel),
                            drivers=(column, *map(str, driven.values())),
                        )
                    if stress:
                        yield Variant(
                            effect=self.id,
                            options={**plain, **age_options(view, column), **stress, **driven},
                            parameters=(*rise, loss, exponent, shape("activation_energy", "eV", 0.05, 1.5, 0.5)),
                            channels=light_channels(view, channel),
                            drivers=(column, str(stress["stress"]), *map(str, driven.values())),
                        )
            housing = [name for name in warm if not name.startswith("laser_")]
            if housing and history(view, housing[0]) is not None:
                column = time_column(view)
                weighted: dict[str, Option] = {
                    "channel": channel,
                    "age": column,
                    "temperature": housing[0],
                    "reference": rounded(view.middle(housing[0])),
                    **age_options(view, column),
                }
                loss, energy = (
                    amplitude("loss", "1", 0.0, 3.0, 0.05),
                    shape("activation_energy", "eV", 0.1, 1.2, 0.5),
                )
                yield Variant(
                    effect=self.id,
                    options=weighted,
                    parameters=(loss, energy),
                    channels=light_channels(view, channel),
                    drivers=(column, housing[0]),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Moves the light-current curve where there is one, then multiplies the light."""
        if "current" in variant.options:
            channel, current = str(variant.options["channel"]), str(variant.options["current"])
            rise = _by_the_end(variant, values, view, "threshold_rise") * _worn(variant, values, view)
            light = state[channel] + shifted(view, channel, current, "", rise)
            set_light(view, state, channel, light * self.factor(variant, values, view))
        else:
            super().apply(variant, values, state, view)
        apply_to_all(self, variant, values, state, view)

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Relative power at the row's age, but for a threshold."""
        lost = _by_the_end(variant, values, view, "loss") * _worn(variant, values, view)
        return np.asarray(np.exp(-np.minimum(lost, 20.0)))

    def expression(self, variant: Variant) -> str:
        """The law."""
        return all_readouts(variant, self._expression(variant))

    def _expression(self, variant: Variant) -> str:
        channel, column = variant.options["channel"], variant.options["age"]
        if variant.options["temperature"]:
            warm = variant.options["temperature"]
            return (
                f"{channel} *= exp(-loss * W), W = time weighted by exp(-activation_energy / k {warm}), "
                f"1 = the record's length at {variant.options['reference']} °C"
            )
        if "within" in variant.options:
            column = f"{column} + {variant.options['within']} / {variant.options['period']:g}"
        grown = "a^exponent"
        if "stress" in variant.options:
            stress, origin = variant.options["stress"], variant.options["reference"]
            grown += f" * exp(activation_energy / k (1 / {origin} - 1 / {stress})) (temperatures in kelvin)"
        each = "[dut]" if "units" in variant.options else ""
        laws, rises = [], "current" in variant.options
        if rises:
            laws.append(f"{channel} = {channel}({variant.options['current']} - threshold_rise{each} * {grown})")
        if not (rises and each):  # each unit has a rise or a loss
            laws.append(f"{channel} *= exp(-loss{each} * {grown})")
        first, last = float(variant.options["first"]), float(variant.options["last"])
        return f"{', then '.join(laws)}, a = {column} from 0 (at {first:g}) to 1 (at {last:g})"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss from first to last."""
        losses = [float(values[name]) for name in _named(values, "loss")] or [0.0]
        rises = [float(values[name]) for name in _named(values, "threshold_rise")] or [0.0]
        lost = _from_to([float(-np.expm1(-loss)) * 100.0 for loss in losses], ".1f")
        which = ", each unit by its own share" if "units" in variant.options else ""
        column = str(variant.options["age"])
        low, high = view.span(column) if view.has(column) else (0.0, 0.0)
        low = min(low, float(variant.options["first"]))
        warm = variant.options["temperature"] or variant.options.get("stress", "")
        faster = f", faster while {warm} is high" if warm else ""
        if "stress" in variant.options:
            faster += f" (at {variant.options['reference']:g} °C)"
        what = f"The light fades by {lost} %"
        if max(rises) > 0.0:
            size, unit = (1e3, "mA") if max(rises) < 1.0 else (1.0, "A")
            rise = f"The laser's threshold rises by {_from_to([size * r for r in rises], '.3g')} {unit}"
            what = f"{rise} and its slope falls by {lost} %" if max(losses) > 0.0 else rise
        return f"{what} from {column} {low:.4g} to {high:.4g} {_plain(column)}{faster}{which}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a dirty window."""
        return (
            "Wipe the window and repeat one step at the temperature of the first: a worn laser stays weak. Compare "
            "pump "
            "time or drive current, which move before the power does."
        )


def _each(view: View, plain: dict[str, Option], column: str, exponent: Parameter) -> Iterable[Variant]:
    """Every unit's own loss, or rise of its threshold, of units that are few enough to tell each by its name."""
    units = view.labels("dut")
    if not FEWEST_UNITS <= len(units) <= MOST_UNITS:
        return
    loss = amplitude("loss", "1", 0.0, 3.0, 0.05)
    for rise, driven in _driven(view, driving_currents(view, str(plain["channel"]))):
        worn = rise[0] if rise else loss
        yield Variant(
            effect=PowerDecay.id,
            options={**plain, **age_options(view, column), "units": json.dumps(list(units)), **driven},
            parameters=(*(replace(worn, name=f"{worn.name}_{unit}") for unit in units), exponent),
            channels=light_channels(view, str(plain["channel"])),
            drivers=(column, "dut", *map(str, driven.values())),
            where={"dut": list(units)},
        )


def _named(values: Values, word: str) -> list[str]:
    """Names of the values that say how much of something there is by the end: one, or one of each unit."""
    return [name for name in values if name == word or name.startswith(f"{word}_")]


def _by_the_end(variant: Variant, values: Values, view: View, word: str) -> FloatArray | float:
    """How much of it there is by then, of each row's unit; of one that was not seen the mean of the others."""
    names = _named(values, word)
    if "units" not in variant.options or not names:
        return float(values[word]) if names else 0.0
    own = {name.removeprefix(f"{word}_"): float(values[name]) for name in names}
    codes, labels = view.codes("dut")
    mean = float(np.mean(list(own.values())))
    return np.array([*(own.get(label, mean) for label in labels), mean])[codes]


def _running_options(view: View) -> dict[str, Option]:
    """Options of an age that runs on within a cycle: cycles follow each other, each as long as the longest seen."""
    period = rounded(float(view.span("time_s")[1]))
    numbers = view.columns.numbers
    running = numbers["cycle"] + numbers["time_s"] / period
    low, high = float(np.nanmin(running)), float(np.nanmax(running))
    return {"first": rounded(low), "last": rounded(high), "within": "time_s", "period": period}


def _driven(view: View, currents: Sequence[str]) -> list[tuple[tuple[Parameter, ...], dict[str, Option]]]:
    """Without and, where a drive current is swept, with a threshold that rises: its parameter and option."""
    ways: list[tuple[tuple[Parameter, ...], dict[str, Option]]] = [((), {})]
    for current in currents[:1]:
        low, high = view.span(current)
        rise = amplitude("threshold_rise", unit_of(current), 0.0, high - low, 0.02 * (high - low))
        ways.append(((rise,), {"current": current}))
    return ways


def _stress(view: View) -> dict[str, Option]:
    """Options of a temperature that each unit keeps to itself while it ages, of three at least; else none."""
    if len(view.labels("dut")) < _FEWEST_STRESSED:
        return {}
    code = view.columns.group("dut")
    for name in view.temperatures():
        values = view.columns.numbers[name]
        good = np.isfinite(values)
        count = np.maximum(np.bincount(code[good]), 1)
        mean = np.bincount(code[good], values[good]) / count
        if np.ptp(mean) > 0.0 and float(np.std(values[good] - mean[code[good]])) < _KEPT * float(np.ptp(mean)):
            return {"stress": name, "reference": rounded(view.middle(name))}
    return {}


def _worn(variant: Variant, values: Values, view: View) -> FloatArray:
    """Age that has worn the laser on every row, 1 at the end: to a power, or weighted by the temperature."""
    if "stress" in variant.options:
        kept, origin = view.number(str(variant.options["stress"])), float(variant.options["reference"])
        rate = np.nan_to_num(arrhenius(kept, float(values["activation_energy"]), origin))
        return np.asarray(_age(variant, values, view) * rate)
    if not variant.options["temperature"]:
        return _age(variant, values, view)
    record = history(view, str(variant.options["temperature"]))
    if record is None:
        return np.zeros(view.n)
    length = float(variant.options["last"]) - float(variant.options["first"])
    origin = float(variant.options["reference"])
    return np.asarray(on_rows(view, _wear(record, float(values["activation_energy"]), origin)) / length)


def _age(variant: Variant, values: Values, view: View) -> FloatArray:
    """Age to the power of the exponent, on every row."""

    def logarithm() -> FloatArray:
        column = str(variant.options["age"])
        if "within" not in variant.options:
            return np.log(np.maximum(aged(view, variant, column), 1e-12))
        first, last = float(variant.options["first"]), float(variant.options["last"])
        within = view.number(str(variant.options["within"])) / float(variant.options["period"])
        running = (view.number(column) + within - first) / (last - first)
        return np.asarray(np.log(np.maximum(np.nan_to_num(running), 1e-12)))

    since = per_view(view, ("log age", variant.label), logarithm)
    return np.exp(float(values["exponent"]) * since)


def _from_to(values: Sequence[float], digits: str) -> str:
    least, most = (f"{x:{digits}}" for x in (min(values), max(values)))
    return most if len(values) == 1 else f"{least} to {most}"


def _plain(column: str) -> str:
    unit = unit_of(column)
    return "" if unit == "1" else unit


def _wear(record: History, energy_ev: float, origin_c: float) -> FloatArray:
    """Time at the reference temperature that would have worn as much, by Arrhenius' law."""
    weight = arrhenius(record.values, energy_ev, origin_c)
    done = np.cumsum(weight, axis=1) - weight[:, :1]
    return np.asarray(done * record.interval)
