"""Range walk: a weak return crosses a threshold later, so the measured distance depends on the signal's strength."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class RangeWalk(Effect):
    """D += walk · ((I / I_ref)^−p − 1) / p with I_ref the table's median: every monotone walk near enough.

    p = 1 is a linear edge (1/I), p → 0 an exponential one (−ln I), negative p flattens towards weak returns.
    """

    id = "timing.range_walk"
    stage = Stage.TIMING
    source = "Kilpelä et al., Rev. Sci. Instrum. 72 (2001) 13: timing discriminators, walk error of leading edges"
    confusable = ("detector.pile_up", "air.multipath", "optics.veiling_glare")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per pair of a distance and an intensity channel."""
        for distance in view.channels(Role.DISTANCE):
            for signal in view.channels(Role.INTENSITY):
                yield Variant(
                    effect=self.id,
                    options={"distance": distance.name, "signal": signal.name},
                    parameters=(
                        Parameter(name="walk", unit=distance.unit, low=-2.0, high=2.0, null=0.0, typical=0.005),
                        Parameter(name="exponent", unit="1", low=-0.5, high=2.0, starts=(0.5, 0.05, 1.2)),
                    ),
                    channels=(distance.name,),
                    drivers=(signal.name,),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Uses the intensity as earlier stages left it."""
        distance, signal = str(variant.options["distance"]), str(variant.options["signal"])
        p = values["exponent"] if abs(values["exponent"]) > 1e-6 else 1e-6
        ratio = np.maximum(state[signal] / view.middle(f"sim_{signal}"), 1e-3)
        state[distance] = state[distance] + values["walk"] * (ratio ** (-p) - 1.0) / p

    def expression(self, variant: Variant) -> str:
        """The law."""
        distance, signal = variant.options["distance"], variant.options["signal"]
        return f"{distance} += walk * (({signal} / median)^(-exponent) - 1) / exponent"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Size over the middle 90 % of the signal."""
        signal = str(variant.options["signal"])
        low, high = np.nanquantile(view.sim[signal], [0.05, 0.95])
        state = {str(variant.options["distance"]): np.zeros(2), signal: np.array([low, high])}
        self.apply(variant, values, state, view)
        change = float(np.subtract(*state[str(variant.options["distance"])]))
        return (
            f"Weak returns ({signal} {low:.0f}) are ranged {change * 1e3:+.2f} mm against strong ones ({high:.0f})."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from glare and pile-up."""
        return (
            "Repeat with a neutral-density filter in front of the window: range walk follows the attenuated signal."
        )
