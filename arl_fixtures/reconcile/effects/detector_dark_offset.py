"""A dark signal adds counts and noise, growing with temperature."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Option, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_avalanche import multiplication, of_options
from arl_fixtures.reconcile.effects_common import (
    above,
    amplitude,
    noise_law,
    rounded,
    shape,
    signals,
    temperature_drivers,
    top_signal,
    with_scatter,
)
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View


class DarkOffset(Effect):
    """I += dark · 2^((T − T_top) / doubling), with its shot noise; T_top is the table's highest temperature.

    Without a temperature in the table the offset is constant. Before an avalanche it is multiplied by the gain, which
    the simulation shows over the bias voltage: dark is then that at the highest bias.
    """

    id = "detector.dark_offset"
    stage = Stage.DETECTOR
    source = (
        "Sze, Ng, Physics of Semiconductor Devices (2007), sec. 2.4: generation current, doubling every 8 to 10 K"
    )
    confusable = ("optics.veiling_glare", "detector.gain_temperature", "readout.noise_excess")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per intensity channel and temperature near the detector."""
        columns = temperature_drivers(
            view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", limit=2, never=("laser_",)
        )
        for channel in signals(view):
            unit, top = unit_of(channel), top_signal(view, channel)
            for column in columns or ("",):
                parameters = [amplitude("dark", unit, 0.0, 0.5 * top, 0.01 * top)]
                if column:
                    parameters.append(shape("doubling", "K", 4.0, 40.0, 9.0))
                highest = _highest(view, column)
                options: dict[str, Option] = {"channel": channel, "temperature": column, "highest": highest}
                shot, seen = noise_law(view, channel)[1], with_scatter(view, channel)
                if len(seen) > 1:  # only a scatter that was measured can tell
                    start = shot if shot > 0.0 else 1e-3 * top
                    parameters.append(shape("shot", f"{unit}^2/{unit}", 0.0, 20.0 * start, start))
                else:
                    options["shot"] = rounded(shot)
                drivers = (column,) if column else (f"sim_{channel}",)
                known = multiplication(view, channel)
                if known is not None:
                    more: dict[str, Option] = {
                        "bias": known.column, "breakdown": rounded(known.breakdown_v),
                        "exponent": rounded(known.exponent), "highest_bias": rounded(view.span(known.column)[1]),
                    }  # fmt: skip
                    yield Variant(
                        effect=self.id, options=options | more, parameters=tuple(parameters), channels=seen,
                        drivers=(*drivers, known.column),
                    )  # fmt: skip
                yield Variant(
                    effect=self.id, options=options, parameters=tuple(parameters), channels=seen, drivers=drivers
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds counts, and their shot noise to the scatter."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        added = np.full(view.n, float(values["dark"]))
        if column:
            colder = above(view, column, float(variant.options["highest"]))
            added = added * np.exp2(np.clip(colder / float(values["doubling"]), -200.0, 8.0))
        if "bias" in variant.options:
            law = of_options(variant)
            gain = law.gain(np.nan_to_num(view.number(law.column)) / law.breakdown_v)
            added = added * gain / law.gain(float(variant.options["highest_bias"]) / law.breakdown_v)
        state[channel] = state[channel] + added
        scatter = f"{channel}_std"
        if scatter in state:
            shot = float(values.get("shot", variant.options.get("shot", 0.0)))
            state[scatter] = np.sqrt(state[scatter] ** 2 + shot * added)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["temperature"]
        if not column:
            return f"{channel} += dark; {channel}_std^2 += shot * dark"
        multiplied = ""
        if "bias" in variant.options:
            bias, breakdown, exponent = (variant.options[name] for name in ("bias", "breakdown", "exponent"))
            ratio = f" * M({bias}) / M({variant.options['highest_bias']})"
            multiplied = f"{ratio}, M(V) = 1 / (1 - (V / {breakdown})^{exponent})"
        return (
            f"{channel} += dark * 2^(({column} - {variant.options['highest']}) / doubling){multiplied}; "
            f"{channel}_std^2 += shot * added"
        )

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Counts at the hottest, doubling."""
        channel, column = str(variant.options["channel"]), str(variant.options["temperature"])
        if not column:
            return f"A dark signal adds {values['dark']:.3g} {unit_of(channel)} everywhere."
        return (
            f"A dark signal adds {values['dark']:.3g} {unit_of(channel)} at {variant.options['highest']:.0f} °C of "
            f"{column}, "
            f"doubling every {values['doubling']:.1f} K."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from glare."""
        return "Cover the window and repeat the hottest step: a dark signal stays, glare and gain errors vanish."


def _highest(view: View, column: str) -> float:
    return rounded(view.span(column)[1]) if column else 0.0
