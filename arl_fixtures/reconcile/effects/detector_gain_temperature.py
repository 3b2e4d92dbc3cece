"""The detector's gain follows its temperature."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_avalanche import multiplication, of_options
from arl_fixtures.reconcile.effects_common import (
    excess,
    reference,
    rounded,
    set_response,
    temperature_drivers,
    with_scatter,
)
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class GainTemperature(Effect):
    """I *= 1 + slope·(T − T_mid) + curvature·(T − T_mid)²; the scatter of the signal scales alike.

    Of an avalanche detector at several bias voltages the breakdown voltage moves: I *= M(V / (V_b·(1 + drift·(T −
    T_mid)))) / M(V / V_b), with the multiplication M that the simulation shows.
    """

    id = "detector.gain_temperature"
    stage = Stage.DETECTOR
    source = "Excelitas C30645/C30662 data sheet: breakdown voltage 0.14 V/K at gain 10"
    confusable = ("laser.thermal_rolloff", "optics.filter_shift")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel and logged temperature that is not the laser's."""
        for channel in view.channels(Role.INTENSITY):
            for column in temperature_drivers(
                view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", limit=2, never=("laser_",)
            ):
                known = multiplication(view, channel.name)
                if known is not None:
                    yield Variant(
                        effect=self.id,
                        options={
                            "channel": channel.name, "temperature": column, "reference": reference(view, column),
                            "bias": known.column, "breakdown": rounded(known.breakdown_v),
                            "exponent": rounded(known.exponent),
                        },
                        parameters=(
                            Parameter(name="drift", unit="1/K", low=-0.01, high=0.01, null=0.0, typical=5e-4),
                        ),
                        channels=with_scatter(view, channel.name),
                        drivers=(column, known.column),
                    )  # fmt: skip
                yield Variant(
                    effect=self.id,
                    options={"channel": channel.name, "temperature": column, "reference": reference(view, column)},
                    parameters=(
                        Parameter(name="slope", unit="1/K", low=-0.05, high=0.05, null=0.0, typical=0.001),
                        Parameter(name="curvature", unit="1/K^2", low=-5e-4, high=5e-4, null=0.0, typical=1e-5),
                    ),
                    channels=with_scatter(view, channel.name),
                    drivers=(column,),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Multiplies the signal."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        warm = excess(view, variant, column)
        if "bias" in variant.options:
            law = of_options(variant)
            share = np.nan_to_num(view.number(law.column)) / law.breakdown_v
            gain = law.gain(share / np.maximum(1.0 + float(values["drift"]) * warm, 0.1)) / law.gain(share)
            set_response(state, channel, state[channel] * gain, gain)
            return
        gain = np.maximum(1.0 + float(values["slope"]) * warm + float(values["curvature"]) * warm**2, 0.01)
        set_response(state, channel, state[channel] * gain, gain)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["temperature"]
        if "bias" in variant.options:
            bias, exponent = variant.options["bias"], variant.options["exponent"]
            return (
                f"{channel} *= M(x / (1 + drift * ({column} - {variant.options['reference']}))) / M(x), "
                f"M(x) = 1 / (1 - x^{exponent}), x = {bias} / {variant.options['breakdown']}"
            )
        return (
            f"{channel} *= 1 + slope * ({column} - {variant.options['reference']}) + curvature * ({column} - "
            f"{variant.options['reference']})^2"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Change over the table's range of temperature."""
        column = str(variant.options["temperature"])
        low, high = view.span(column)
        middle = float(variant.options["reference"])
        if "bias" in variant.options:
            volts = float(values["drift"]) * float(variant.options["breakdown"])
            return (
                f"The breakdown voltage moves by {volts * 1e3:+.0f} mV/K with {column}, and the gain with it, most "
                f"where {variant.options['bias']} is high."
            )
        ends = [1.0 + values["slope"] * x + values["curvature"] * x**2 for x in (low - middle, high - middle)]
        change = (ends[1] / ends[0] - 1.0) * 100.0
        return f"The detector's gain changes by {change:+.1f} % from {low:.0f} to {high:.0f} °C of {column}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from the laser's roll-off."""
        return (
            "Step the laser's TEC set-point at constant housing temperature: the detector's gain does not follow it."
        )
