"""The distance shifts with the timing chip's temperature."""

from __future__ import annotations

from collections.abc import Iterable

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    distances,
    excess,
    in_mm,
    reference,
    span,
    temperature_drivers,
    unit_per,
)
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View


class TemperatureOffset(Effect):
    """D += slope·ΔT + bend·ΔT²; or, where distances differ, in proportion to the distance (a delay line's gain)."""

    id = "timing.temperature_offset"
    stage = Stage.TIMING
    source = "Henzler, Time-to-Digital Converters (2010), ch. 3: delay over temperature; 1 ps is 0.150 mm of range"
    confusable = ("timing.thermal_lag", "timing.clock_scale", "timing.range_walk")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per distance and temperature, the timing chip's first."""
        columns = temperature_drivers(
            view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", "laser_temperature_c"
        )
        for distance in distances(view):
            unit = unit_of(distance)
            size = per_metre(unit)
            low, high = view.span(f"sim_{distance}")
            kinds = ("offset", "scale") if low > 0.0 and high > 2.0 * low else ("offset",)
            for kind in kinds:
                for column in columns if kind == "offset" else columns[:1]:
                    half = span(view, column) / 2.0
                    each = "1/K" if kind == "scale" else unit_per(column, unit)
                    most = 0.5 if kind == "scale" else 2.0 * size
                    yield Variant(
                        effect=self.id,
                        options={
                            "channel": distance,
                            "temperature": column,
                            "kind": kind,
                            "reference": reference(view, column),
                        },
                        parameters=(
                            amplitude("slope", each, -most / half, most / half, 0.002 * most / half),
                            amplitude("bend", f"{each}^2", -most / half**2, most / half**2, 0.001 * most / half**2),
                        ),
                        channels=(distance,),
                        drivers=(column,) if kind == "offset" else (column, f"sim_{distance}"),
                    )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds to the distance."""
        distance, column = str(variant.options["channel"]), str(variant.options["temperature"])
        warm = excess(view, variant, column)
        added = values["slope"] * warm + values["bend"] * warm**2
        state[distance] = state[distance] + (
            added if variant.options["kind"] == "offset" else added * state[distance]
        )

    def expression(self, variant: Variant) -> str:
        """The law."""
        distance, column = variant.options["channel"], variant.options["temperature"]
        warm = f"({column} - {variant.options['reference']})"
        law = f"slope * {warm} + bend * {warm}^2"
        return f"{distance} += {law}" if variant.options["kind"] == "offset" else f"{distance} *= 1 + {law}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Shift over the table's range of temperature."""
        distance, column = str(variant.options["channel"]), str(variant.options["temperature"])
        low, high = view.span(column)
        ends = [x - float(variant.options["reference"]) for x in (low, high)]
        shift = values["slope"] * (ends[1] - ends[0]) + values["bend"] * (ends[1] ** 2 - ends[0] ** 2)
        if variant.options["kind"] == "scale":
            return f"The distance is stretched by {shift * 100:+.3f} % from {low:.0f} to {high:.0f} °C of {column}."
        return f"The distance shifts by {in_mm(shift, distance):+.2f} mm from {low:.0f} to {high:.0f} °C of {column}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells a delay from a scale."""
        return (
            "Repeat two temperatures at a second target distance: a delay shifts both alike, a scale in proportion; "
            "soak each for an hour to exclude a lag."
        )
