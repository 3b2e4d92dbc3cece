"""The detector's gain follows its temperature."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_avalanche import bias_column, breakdown, multiplication
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    excess,
    light_channels,
    reference,
    set_light,
    set_response,
    shape,
    temperature_drivers,
    with_scatter,
)
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class GainTemperature(Effect):
    """I *= 1 + slope·(T − T_mid) + curvature·(T − T_mid)²; the scatter of the signal scales alike.

    Or it follows the noise law as it would for more light, as of a detector whose efficiency changes (noise: light).

    Where the bias of an avalanche detector is swept also by its cause: I *= M(V, V_b + drift·(T − T_mid)) / M(V, V_b)
    with Miller's M = 1 / (1 − (V/V_b)^order): the nearer to breakdown, the more.
    """

    id = "detector.gain_temperature"
    stage = Stage.DETECTOR
    source = (
        "Excelitas C30645/C30662 data sheet: breakdown voltage 0.14 V/K at gain 10; Miller, Phys. Rev. 99 (1955) 1234"
    )
    confusable = ("laser.thermal_rolloff", "optics.filter_shift")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel and logged temperature that is not the laser's."""
        bias = bias_column(view)
        for channel in view.channels(Role.INTENSITY):
            for column in temperature_drivers(
                view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", limit=2, never=("laser_",)
            ):
                seen = light_channels(view, channel.name)
                for noise in ("response", "light") if len(seen) > 1 else ("response",):
                    yield Variant(
                        effect=self.id,
                        options={
                            "channel": channel.name, "temperature": column, "reference": reference(view, column),
                            **({"noise": noise} if noise == "light" else {}),
                        },
                        parameters=(
                            Parameter(name="slope", unit="1/K", low=-0.05, high=0.05, null=0.0, typical=0.001),
                            Parameter(name="curvature", unit="1/K^2", low=-5e-4, high=5e-4, null=0.0, typical=1e-5),
                        ),
                        channels=seen if noise == "light" else with_scatter(view, channel.name),
                        drivers=(column,),
                    )  # fmt: skip
                if bias:
                    top = view.span(bias)[1]
                    yield Variant(
                        effect=self.id,
                        options={
                            "channel": channel.name, "temperature": column, "reference": reference(view, column),
                            "bias": bias,
                        },
                        parameters=(
                            amplitude("drift", "V/K", -0.01 * top, 0.01 * top, 1e-4 * top),
                            breakdown(view, bias),
                            shape("order", "1", 1.0, 6.0, 2.0),
                        ),
                        channels=with_scatter(view, channel.name),
                        drivers=(column, bias),
                    )  # fmt: skip

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Multiplies the signal."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        warm = excess(view, variant, column)
        if "bias" in variant.options:
            bias, at = view.number(str(variant.options["bias"])), float(values["breakdown"])
            moved, known = (
                multiplication(bias, voltage, float(values["order"]))
                for voltage in (at + float(values["drift"]) * warm, at)
            )
            set_response(state, channel, state[channel] * (moved / known), moved / known)
            return
        gain = np.maximum(1.0 + float(values["slope"]) * warm + float(values["curvature"]) * warm**2, 0.01)
        if "noise" in variant.options:
            set_light(view, state, channel, state[channel] * gain)
        else:
            set_response(state, channel, state[channel] * gain, gain)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["temperature"]
        if "bias" in variant.options:
            return (
                f"{channel} *= M(breakdown + drift * ({column} - {variant.options['reference']})) / M(breakdown), "
                f"M(b) = 1 / (1 - ({variant.options['bias']} / b)^order)"
            )
        return (
            f"{channel} *= 1 + slope * ({column} - {variant.options['reference']}) + curvature * ({column} - "
            f"{variant.options['reference']})^2"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Change over the table's range of temperature."""
        column = str(variant.options["temperature"])
        if "bias" in variant.options:
            return (
                f"The detector's breakdown voltage, {values['breakdown']:.0f} V, moves by "
                f"{1e3 * values['drift']:+.0f} mV per kelvin of {column}: its gain changes, the more the nearer "
                f"{variant.options['bias']} is to it."
            )
        low, high = view.span(column)
        middle = float(variant.options["reference"])
        ends = [1.0 + values["slope"] * x + values["curvature"] * x**2 for x in (low - middle, high - middle)]
        change = (ends[1] / ends[0] - 1.0) * 100.0
        return f"The detector's gain changes by {change:+.1f} % from {low:.0f} to {high:.0f} °C of {column}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from the laser's roll-off."""
        return (
            "Step the laser's TEC set-point at constant housing temperature: the detector's gain does not follow it."
        )
