"""Optical power falls over cycles or operating hours."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    age_drivers,
    age_options,
    aged,
    amplitude,
    light_channels,
    per_view,
    rounded,
    shape,
    signals,
    temperature_drivers,
)
from arl_fixtures.reconcile.effects_history import History, history, on_rows, time_column
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_BOLTZMANN_EV = 8.617e-5


class PowerDecay(LightFactor):
    """I *= exp(−loss · age^exponent), age from 0 to 1 over the table; or age weighted by exp(−E/kT)."""

    id = "laser.power_decay"
    stage = Stage.LASER
    source = "Johnson, Prog. Quantum Electron. 2 (1973) 187 (diode degradation); Ea about 0.5 eV for 808 nm pump bars"
    confusable = ("optics.window_contamination", "laser.thermal_rolloff", "optics.window_frost")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per column that counts age, and one per time weighted by temperature."""
        columns = age_drivers(view)
        warm = temperature_drivers(view, "laser_temperature_c", "housing_temperature_c", limit=2)
        for channel in signals(view):
            for column in columns:
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "age": column, "temperature": "", **age_options(view, column)},
                    parameters=(
                        amplitude("loss", "1", 0.0, 3.0, 0.05),
                        shape("exponent", "1", 0.25, 3.0, 1.0),
                    ),
                    channels=light_channels(view, channel),
                    drivers=(column,),
                )
            housing = [name for name in warm if not name.startswith("laser_")]
            if housing and history(view, housing[0]) is not None:
                column = time_column(view)
                yield Variant(
                    effect=self.id,
                    options={
                        "channel": channel,
                        "age": column,
                        "temperature": housing[0],
                        "reference": rounded(view.middle(housing[0])),
                        **age_options(view, column),
                    },
                    parameters=(
                        amplitude("loss", "1", 0.0, 3.0, 0.05),
                        shape("activation_energy", "eV", 0.1, 1.2, 0.5),
                    ),
                    channels=light_channels(view, channel),
                    drivers=(column, housing[0]),
                )

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Relative power at the row's age."""
        if variant.options["temperature"]:
            record = history(view, str(variant.options["temperature"]))
            if record is None:
                return np.ones(view.n)
            length = float(variant.options["last"]) - float(variant.options["first"])
            origin = float(variant.options["reference"])
            worn = on_rows(view, _wear(record, float(values["activation_energy"]), origin)) / length
            return np.exp(-np.minimum(float(values["loss"]) * worn, 20.0))
        column = str(variant.options["age"])
        since = per_view(
            view, ("log age", variant.label), lambda: np.log(np.maximum(aged(view, variant, column), 1e-12))
        )
        return np.asarray(
            np.exp(-np.minimum(float(values["loss"]) * np.exp(float(values["exponent"]) * since), 20.0))
        )

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, column = variant.options["channel"], variant.options["age"]
        if variant.options["temperature"]:
            warm = variant.options["temperature"]
            return (
                f"{channel} *= exp(-loss * W), W = time weighted by exp(-activation_energy / k {warm}), "
                f"1 = the record's length at {variant.options['reference']} °C"
            )
        return f"{channel} *= exp(-loss * a^exponent), a = {column} from 0 (first) to 1 (last)"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Loss from first to last."""
        lost = -np.expm1(-float(values["loss"])) * 100.0
        column = str(variant.options["age"])
        low, high = view.span(column) if view.has(column) else (0.0, 0.0)
        faster = f", faster while {variant.options['temperature']} is high" if variant.options["temperature"] else ""
        return f"The light fades by {lost:.1f} % from {column} {low:.4g} to {high:.4g} {_plain(column)}{faster}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a dirty window."""
        return (
            "Wipe the window and repeat one step at the temperature of the first: a worn laser stays weak. Compare "
            "pump "
            "time or drive current, which move before the power does."
        )


def _plain(column: str) -> str:
    unit = unit_of(column)
    return "" if unit == "1" else unit


def _wear(record: History, energy_ev: float, origin_c: float) -> FloatArray:
    """Time at the reference temperature that would have worn as much, by Arrhenius' law."""
    kelvin = np.maximum(record.values + 273.15, 150.0)
    weight = np.exp(np.clip(-energy_ev / _BOLTZMANN_EV * (1.0 / kelvin - 1.0 / (origin_c + 273.15)), -30.0, 30.0))
    done = np.cumsum(weight, axis=1) - weight[:, :1]
    return np.asarray(done * record.interval)
