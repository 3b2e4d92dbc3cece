"""A supply rail's deviation modulates the gain."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from arl_fixtures.reconcile.effect import Stage, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    FloatArray,
    LightFactor,
    amplitude,
    light_channels,
    rounded,
    shape,
    signals,
    span,
)
from arl_fixtures.reconcile.effects_logged import is_noisy, step_mean
from arl_fixtures.reconcile.roles import unit_of
from arl_fixtures.reconcile.view import View

_MOST_RAILS = 8
_PER_VOLT = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
_LOW_V, _MOST_COUPLING = 24.0, 2.5
"""Volts of a supply up to which it is no bias of an avalanche diode, and percent of gain for one of its percents that
hardly a circuit there has: a laser's driver follows with one or two, what is regulated with less than one."""
_FEWEST_LEVELS = 6
"""Different readings of a rail from which a drop-out is told from a straight line."""


class RailCoupling(LightFactor):
    """I *= 1 + coupling·(V − V_median) / V_median, one supply rail at a time.

    A regulator rejects its supply down to the drop-out: I *= 1 + coupling·min(V − knee, 0) / V_median.
    """

    id = "electronics.rail_coupling"
    stage = Stage.DETECTOR
    single = True  # several noisy rails that drift together are a thermometer
    source = "finite power-supply rejection: gain error = coupling · relative deviation of the supply"
    confusable = ("detector.gain_temperature", "laser.thermal_rolloff")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per rail, two where its readings are noisy; other voltages where no column is called a rail."""
        volts = view.voltages()
        rails = [name for name in volts if name.startswith("rail_")] or [name for name in volts if "tec" not in name]
        for channel in signals(view)[:1]:
            for rail in rails[:_MOST_RAILS]:
                middle = rounded(view.middle(rail))
                if middle == 0.0:
                    continue
                most = 2.0 * abs(middle) / span(view, rail)
                for reading in ("step mean", "each") if is_noisy(view, rail) else ("each",):
                    yield Variant(
                        effect=self.id,
                        options={"channel": channel, "rail": rail, "reading": reading, "reference": middle},
                        parameters=(amplitude("coupling", "1", -most, most, 0.02 * most),),
                        channels=light_channels(view, channel),
                        drivers=(rail,),
                    )
                low, high = view.span(rail)
                if np.unique(view.number(rail)).size < _FEWEST_LEVELS:
                    continue
                knee = shape("knee", unit_of(rail), low, high, low + 0.6 * (high - low))
                yield Variant(
                    effect=self.id,
                    options={"channel": channel, "rail": rail, "reading": "drop-out", "reference": middle},
                    parameters=(amplitude("coupling", "1", -most, most, 0.02 * most), knee),
                    channels=light_channels(view, channel),
                    drivers=(rail,),
                )

    def is_far_fetched(self, variant: Variant, values: Mapping[str, float]) -> bool:
        """A rail that drifts by little with the heat is rather a thermometer than a lever."""
        low = abs(float(variant.options["reference"])) * _PER_VOLT[unit_of(str(variant.options["rail"]))] < _LOW_V
        return low and abs(float(values["coupling"])) > _MOST_COUPLING

    def factor(self, variant: Variant, values: Values, view: View) -> FloatArray:
        """Relative gain at the row's supply."""
        middle = float(variant.options["reference"])
        rail = str(variant.options["rail"])
        volts = step_mean(view, rail) if variant.options["reading"] == "step mean" else view.number(rail)
        if "knee" in values:
            volts = np.minimum(volts - float(values["knee"]), 0.0) + middle
        deviation = np.nan_to_num(volts / middle - 1.0)
        return np.maximum(1.0 + float(values["coupling"]) * deviation, 0.01)

    def expression(self, variant: Variant) -> str:
        """The law."""
        channel, rail, middle = (variant.options[key] for key in ("channel", "rail", "reference"))
        if variant.options["reading"] == "drop-out":
            return f"{channel} *= 1 + coupling * min({rail} - knee, 0) / {middle}"
        return f"{channel} *= 1 + coupling * ({rail} / {middle} - 1)"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Coupling in percent per percent."""
        change = self.change(variant, values, view)
        below = f" below {values['knee']:.4g} V" if "knee" in values else ""
        return (
            f"The gain follows {variant.options['rail']}{below}: {values['coupling']:+.2f} % per percent of the "
            f"supply; its deviations change the signal between {change[0]:+.2f} and {change[1]:+.2f} %."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What confirms it."""
        return (
            f"Set {variant.options['rail']} two percent up and down at constant temperature: the signal must follow."
        )
