"""Distances are stretched by a constant factor."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import amplitude, distances, in_mm
from arl_fixtures.reconcile.grouping import unit_columns_of
from arl_fixtures.reconcile.view import View

LEAST_SPAN = 0.02
"""Share of the distance over which the distances of one unit must spread."""


def _spread(view: View, name: str) -> float:
    """Largest spread of a distance within a unit, as a share of the distance itself."""
    memo, key = view.columns.memo, ("spread within a unit", name)
    if key not in memo:
        unit, values = view.columns.group(*unit_columns_of(view.columns)), view.columns.numbers[name]
        seen = [v for k in range(int(unit.max()) + 1) if len(v := values[(unit == k) & np.isfinite(values)])]
        memo[key] = max((float(np.ptp(v)) / max(abs(float(np.median(v))), 1e-12) for v in seen), default=0.0)
    spread: float = memo[key]
    return spread


class ClockScale(Effect):
    """D *= 1 + scale: the clock that times the echoes is off its nominal frequency."""

    id = "timing.clock_scale"
    stage = Stage.TIMING
    source = (
        "D = c·n_ticks / (2·f_clock); quartz oscillators: 10 to 100 ppm, free-running ring oscillators up to percents"
    )
    exact = True
    confusable = ("timing.temperature_offset", "stage.eccentricity", "timing.range_walk")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per distance channel with a near and a far: else a scale is an offset, and no offset is so large."""
        for distance in distances(view):
            if _spread(view, f"sim_{distance}") > LEAST_SPAN:
                yield Variant(
                    effect=self.id,
                    options={"channel": distance},
                    parameters=(amplitude("scale", "1", -0.1, 0.1, 1e-3),),
                    channels=(distance,),
                    drivers=(f"sim_{distance}",),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Stretches the distance."""
        distance = str(variant.options["channel"])
        state[distance] = state[distance] * (1.0 + values["scale"])

    def expression(self, variant: Variant) -> str:
        """The law."""
        return f"{variant.options['channel']} *= 1 + scale"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Scale in ppm and its effect at the largest distance."""
        distance = str(variant.options["channel"])
        low, high = view.span(f"sim_{distance}")
        grown = in_mm(values["scale"] * (high - low), distance)
        return (
            f"All distances are stretched by {values['scale'] * 1e6:+.0f} ppm: {grown:+.2f} mm "
            f"between the nearest and the farthest."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from an offset."""
        return "Measure a target at two distances as far apart as the room allows: a scale grows with the distance."
