"""Optical power falls as the laser gets warmer, by heat sink or by its own heat."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Option, Parameter, Stage, State, Values, Variant
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
    set_light,
    shape,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_light_current import driving_currents, shifted
from arl_fixtures.reconcile.effects_logged import step_mean
from arl_fixtures.reconcile.effects_one_laser import all_readouts, apply_to_all, with_all_readouts
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import View

_FEWEST_STEPS = 5
_CURVES = ("curve", "junction")

_HOTTEST_K = 80.0
"""What a diode's junction is warmer than its case at most: it fails beyond."""

class ThermalRolloff(LightFactor):
    """Power over temperature, a knee where the cooler gives up, or the whole light-current curve.

    * slope: I *= 1 − slope·(exp(growth·ΔT) − 1) / growth: linear for growth = 0, faster and faster above, as the
      power over a threshold current that grows exponentially with temperature.
    * knee: I *= exp(−slope·max(T − knee, 0)): the cooler holds the laser until the housing is too warm.
    * curve (where a drive current varies): I(J) = exp(−loss·ΔT) · I_sim(J − threshold_shift·ΔT).
    * own heat (likewise): the same with h = (J / J_top)^exponent for ΔT, what the laser turns into heat at a current
      (times its duty cycle where that varies); a diode's voltage falls with its junction's temperature, by
      voltage_drop·h.
    * junction (where both vary): the curve with θ = ΔT + heating·(J / J_top)^exponent for ΔT, and a threshold that
      grows exponentially, threshold_shift·(exp(growth·θ) − 1) / growth.
    """

    id = "laser.thermal_rolloff"
    stage = Stage.LASER
    source = "Coldren, Corzine, Mashanovitch, Diode Lasers and Photonic Integrated Circuits (2012), sec. 2.6: T0, T1"
    confusable = ("detector.gain_temperature", "optics.filter_shift", "laser.power_decay")

    def variants(self, view: View) -> Iterable[Variant]:
        """By the laser's temperature first, then the housing's; the curve where a drive current varies."""
        return with_all_readouts(self._variants(view), view)

    def _variants(self, view: View) -> Iterable[Variant]:
        columns = temperature_drivers(view, "laser_temperature_c", "heatsink_temperature_c", "housing_temperature_c")
        for channel in lit_signals(view):
            currents = driving_currents(view, channel)
            for current in currents[:1]:
                yield self._by_own_heat(view, channel, current, columns[0] if columns else "")
            for column in columns[:2]:
                low, high = view.span(column)
                wide = high - low
                slope = amplitude("slope", "1/K", 0.0, 4.0 / wide, 0.05 / wide)
                growth = shape("growth", "1/K", 0.0, 8.0 / wide, 0.0, 3.0 / wide)
                if currents:
                    reach = float(np.subtract(*view.span(currents[0])[::-1]))
                    each = f"{unit_of(currents[0])}/K"
                    shift = amplitude("threshold_shift", each, 0.0, reach / wide, 0.02 * reach / wide)
                    loss = amplitude("loss", "1/K", -1.0 / wide, 3.0 / wide, 0.05 / wide)
                    origin = shape("reference", "°C", low, high, low, reference(view, column))
                    kind: dict[str, Option] = {"kind": "curve", "temperature": column, "current": currents[0]}
                    yield self._variant(view, channel, kind, (shift, loss, origin), (column, currents[0]))
                    hottest = min(4.0 * wide, _HOTTEST_K)
                    heating = shape("heating", "K", 0.0, hottest, 0.05 * hottest, 0.25 * hottest)
                    power, growth = (
                        shape("exponent", "1", 0.7, 3.0, 1.5),
                        shape("growth", "1/K", 0.0, 4.0 / wide, 0.5 / wide),
                    )
                    kind = {**kind, "kind": "junction", "top": rounded(view.span(currents[0])[1]), **_duty(view)}
                    yield self._variant(
                        view, channel, kind, (shift, loss, heating, power, growth, origin), (column, currents[0])
                    )
                plain: dict[str, Option] = {
                    "kind": "slope",
                    "temperature": column,
                    "reference": reference(view, column),
                }
                yield self._variant(view, channel, plain, (slope, growth), (column,))
            for column in [name for name in columns if not name.startswith("laser_")][:1]:
                low, high = view.span(column)
                slope = amplitude("slope", "1/K", 0.0, 20.0 / (high - low), 0.2 / (high - low))
                highest = _warmest_knee(view, column)
                knee = shape("knee", "°C", low, highest, min(low + 0.7 * (high - low), highest))
                yield self._variant(view, channel, {"kind": "knee", "temperature": column}, (slope, knee), (column,))

    def _by_own_heat(self, view: View, channel: str, current: str, column: str) -> Variant:
        low, high = view.span(current)
        voltages = [c.name for c in view.columns.channels if unit_of(c.name) == "V" and c.role is Role.OTHER]
        shift = amplitude("threshold_shift", unit_of(current), 0.0, high - low, 0.01 * (high - low))
        loss = amplitude("loss", "1", 0.0, 3.0, 0.02)
        drop = [amplitude("voltage_drop", "V", 0.0, 1.0, 0.005)] if voltages else []
        power = shape("exponent", "1", 0.7, 3.0, 1.0, 2.0)
        return Variant(
            effect=self.id,
            options={
                "channel": channel, "kind": "own heat", "temperature": column, "current": current,
                "top": rounded(high), "voltage": voltages[0] if voltages else "", **_duty(view),
            },
            parameters=(shift, loss, *drop, power),
            channels=(*light_channels(view, channel), *voltages[:1]),
            drivers=(current, *(str(name) for key, name in _duty(view).items() if key == "duty")),
        )  # fmt: skip

    def _variant(
        self,
        view: View,
        channel: str,
        options: dict[str, Option],
        parameters: tuple[Parameter, ...],
        drivers: tuple[str, ...],
    ) -> Variant:
        return Variant(
            effect=self.id,
            options={"channel": channel, **options},
            parameters=parameters,
            channels=light_channels(view, channel),
            drivers=drivers,
        )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Relative power at the row's temperature."""
        column = str(variant.options["temperature"])
        if variant.options["kind"] == "knee":
            warm = np.nan_to_num(np.maximum(view.number(column) - float(values["knee"]), 0.0))
            return np.exp(-np.minimum(float(values["slope"]) * warm, 20.0))
        if variant.options["kind"] == "own heat":
            return np.exp(-float(values["loss"]) * _own_heat(variant, values, view))
        if variant.options["kind"] in _CURVES:
            warm = _warmth(variant, values, view)
            return np.exp(np.clip(-float(values["loss"]) * warm, -20.0, 20.0))
        growth = max(float(values["growth"]), 1e-9)
        warmth = np.expm1(growth * excess(view, variant, column)) / growth
        return np.asarray(np.clip(1.0 - float(values["slope"]) * warmth, 1e-3, 1e3))

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Shifts the light-current curve where there is one, then multiplies the light."""
        channel = str(variant.options["channel"])
        light = state[channel]
        if variant.options["kind"] in _CURVES:
            current, column = str(variant.options["current"]), str(variant.options["temperature"])
            shift = float(values["threshold_shift"]) * _grown(variant, values, view)
            light = light + shifted(view, channel, current, column, shift, in_proportion=False)
        if variant.options["kind"] == "own heat":
            current, column = str(variant.options["current"]), str(variant.options["temperature"])
            warm = _own_heat(variant, values, view)
            light = light + shifted(view, channel, current, column, float(values["threshold_shift"]) * warm)
            voltage = str(variant.options["voltage"])
            if voltage:
                state[voltage] = state[voltage] - float(values["voltage_drop"]) * warm
        set_light(view, state, channel, light * self.factor(variant, values, view))
        apply_to_all(self, variant, values, state, view)

    def expression(self, variant: Variant) -> str:
        """The law."""
        return all_readouts(variant, self._expression(variant))

    def _expression(self, variant: Variant) -> str:
        channel, column = variant.options["channel"], variant.options["temperature"]
        if variant.options["kind"] == "knee":
            return f"{channel} *= exp(-slope * max({column} - knee, 0))"
        if variant.options["kind"] == "own heat":
            current, voltage = variant.options["current"], variant.options["voltage"]
            heat = f"h = ({current} / {variant.options['top']})^exponent{_while_on(variant)}"
            law = f"{channel}({current}) = exp(-loss * h) * sim_{channel}({current} - threshold_shift * h), {heat}"
            return f"{law}; {voltage} -= voltage_drop * h" if voltage else law
        if variant.options["kind"] == "curve":
            current = variant.options["current"]
            warm = f"({column} - reference)"
            return f"{channel}({current}) = exp(-loss * {warm}) * sim_{channel}({current} - threshold_shift * {warm})"
        if variant.options["kind"] == "junction":
            current = variant.options["current"]
            heat = f"({current} / {variant.options['top']})^exponent{_while_on(variant)}"
            warm = f"w = {column} - reference + heating * {heat}"
            moved = f"sim_{channel}({current} - threshold_shift * (exp(growth * w) - 1) / growth)"
            return f"{channel}({current}) = exp(-loss * w) * {moved}, {warm}"
        origin = variant.options["reference"]
        return f"{channel} *= 1 - slope * (exp(growth * ({column} - {origin})) - 1) / growth"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss over the table's temperatures; of a light-current curve how threshold and slope move."""
        column = str(variant.options["temperature"])
        if variant.options["kind"] == "own heat":
            shift, lost = float(values["threshold_shift"]) * 1e3, -float(np.expm1(-float(values["loss"]))) * 100.0
            moved = f"its threshold lies {shift:.1f} mA higher and " if shift > 0.0 else ""
            top = float(variant.options["top"])
            return f"The laser warms itself: at {top:g} A {moved}its slope is {lost:.1f} % less."
        low, high = view.span(column)
        if variant.options["kind"] in _CURVES:
            shift = float(values["threshold_shift"]) * 1e3
            steeper = float(np.expm1(-float(values["loss"]) * (high - low))) * 100.0
            heating = ""
            if variant.options["kind"] == "junction":
                top = float(variant.options["top"])
                heating = f" At {top:g} A its junction is {float(values['heating']):.0f} K warmer than that."
            return (
                f"The laser's threshold current rises by {shift:.2f} mA per kelvin of {column}; the slope above it "
                f"changes by {steeper:+.1f} % from {low:.0f} to {high:.0f} °C.{heating}"
            )
        text = (
            f"The laser gives less light as it gets warmer: {percent(*self.change(variant, values, view))} "
            f"of the signal from {low:.0f} to {high:.0f} °C of {column}"
        )
        if variant.options["kind"] == "knee":
            return f"{text}, all of it above {values['knee']:.1f} °C, where the cooler no longer holds it."
        return f"{text}."

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """Above the knee."""
        if variant.options["kind"] != "knee":
            return {}
        column = str(variant.options["temperature"])
        return {column: [float(values["knee"]), view.span(column)[1]]}

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from the detector."""
        return (
            "Step the laser's cooler set-point at constant housing temperature, and log a monitor photodiode or the "
            "pump "
            "time: the laser's loss follows its own temperature, the detector's gain does not."
        )


def _warmest_knee(view: View, column: str) -> float:
    """Temperature above which two steps still lie: beyond it a knee would only say that one step is off."""
    steps = np.unique(np.round(step_mean(View(view.columns), column), 2))
    steps = steps[np.isfinite(steps)]
    return float(steps[-3]) if steps.size >= _FEWEST_STEPS else view.span(column)[1]


def _warmth(variant: Variant, values: Values, view: View) -> FloatArray:
    """Kelvin above the temperature of the simulation's curve: of the heat sink, and of the junction above it."""
    warm = np.nan_to_num(view.number(str(variant.options["temperature"])) - float(values["reference"]))
    if variant.options["kind"] == "junction":
        warm = warm + float(values["heating"]) * _own_heat(variant, values, view)
    return np.asarray(warm)


def _grown(variant: Variant, values: Values, view: View) -> FloatArray:
    """Kelvin that move the threshold, where each moves it by more than the one before."""
    warm = _warmth(variant, values, view)
    growth = float(values.get("growth", 0.0))
    return np.asarray(np.expm1(np.minimum(growth * warm, 20.0)) / growth) if growth > 1e-9 else warm


def _own_heat(variant: Variant, values: Values, view: View) -> FloatArray:
    """What the laser heats itself by at the row's current, 1 at the highest one."""
    share = np.maximum(np.nan_to_num(view.number(str(variant.options["current"]))), 0.0) / float(
        variant.options["top"]
    )
    heat = np.clip(share, 0.0, 10.0) ** float(values["exponent"])
    if "duty" in variant.options:
        heat = heat * np.nan_to_num(view.number(str(variant.options["duty"]))) / float(variant.options["longest"])
    return np.asarray(heat)


def _duty(view: View) -> dict[str, Option]:
    """Options of the column that says for which share of the time a laser is on, and its longest."""
    for name in view.covariates():
        if name.startswith("duty") and unit_of(name) == "1" and view.span(name)[0] >= 0.0:
            return {"duty": name, "longest": rounded(view.span(name)[1])}
    return {}


def _while_on(variant: Variant) -> str:
    return f" * {variant.options['duty']} / {variant.options['longest']}" if "duty" in variant.options else ""
