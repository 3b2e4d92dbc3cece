"""A timing gradient along rows or columns."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import (
    amplitude,
    distances,
    excess,
    in_mm,
    reference,
    rounded,
    shape,
    span,
    temperature_drivers,
    unit_per,
)
from arl_fixtures.reconcile.roles import per_metre, unit_of
from arl_fixtures.reconcile.view import View


class RowSkew(Effect):
    """D += per_column·(u − middle) + per_row·(v − middle), fixed or in proportion to a temperature.

    A line of resistors and capacitors delays less and less towards its open end (W. C. Elmore, J. Appl. Phys. 19
    (1948) 55): each axis' part is then (x − bend·(x² − 1/3))·half, x = (u − middle) / half; bend is ±½ where it ends.
    """

    id = "timing.row_skew"
    stage = Stage.TIMING
    exact = True
    source = "delay of a stop or clock line along the array; 1 ps is 0.150 mm of range"
    confusable = ("mount.tilt", "readout.column_pattern", "stage.eccentricity")

    def variants(self, view: View) -> Iterable[Variant]:
        """Fixed, and growing with the timing chip's temperature."""
        axes = [name for name in ("pixel_u", "pixel_v") if view.varies(name)]
        if not axes:
            return
        warm = temperature_drivers(view, "tof_temperature_c", "fpga_temperature_c", "housing_temperature_c", limit=2)
        for distance in distances(view):
            size = per_metre(unit_of(distance))
            for column, bent in (("", False), ("", True), *((column, False) for column in warm)):
                scale = span(view, column) if column else 1.0
                unit = unit_per(column, f"{unit_of(distance)}/px") if column else f"{unit_of(distance)}/px"
                yield Variant(
                    effect=self.id,
                    options={
                        "channel": distance,
                        "temperature": column,
                        "reference": reference(view, column) if column else 0.0,
                        **{f"middle_{axis[-1]}": rounded(sum(view.span(axis)) / 2.0) for axis in axes},
                        **({f"half_{axis[-1]}": rounded(0.5 * span(view, axis)) for axis in axes} if bent else {}),
                    },
                    parameters=(
                        *(
                            amplitude(
                                "per_column" if axis == "pixel_u" else "per_row",
                                unit,
                                -0.1 * size / scale,
                                0.1 * size / scale,
                                2e-4 * size / scale,
                            )
                            for axis in axes
                        ),
                        *([shape("bend", "1", -0.5, 0.5, 0.2)] if bent else []),
                    ),
                    channels=(distance,),
                    drivers=(*axes[::-1], *((column,) if column else ())),
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Adds the gradient."""
        distance, column = str(variant.options["channel"]), str(variant.options["temperature"])
        added = np.zeros(view.n)
        for name, letter in (("per_column", "u"), ("per_row", "v")):
            if name in values:
                away = np.nan_to_num(view.number(f"pixel_{letter}")) - float(variant.options[f"middle_{letter}"])
                if "bend" in values:
                    half = float(variant.options[f"half_{letter}"])
                    away = away - float(values["bend"]) * ((away / half) ** 2 - 1.0 / 3.0) * half
                added = added + float(values[name]) * away
        if column:
            added = added * excess(view, variant, column)
        state[distance] = state[distance] + added

    def drivers(self, variant: Variant, values: Values, view: View) -> list[str]:
        """The axis along which it leans most comes first."""
        lean = {
            axis: abs(float(values[name])) * span(view, axis)
            for name, axis in (("per_row", "pixel_v"), ("per_column", "pixel_u"))
            if name in values
        }
        axes = sorted(lean, key=lambda axis: -lean[axis])
        return [*axes, *(name for name in variant.drivers if name not in axes)]

    def expression(self, variant: Variant) -> str:
        """The law."""
        distance, column = variant.options["channel"], variant.options["temperature"]
        parts = " + ".join(
            f"{name} * (pixel_{letter} - {variant.options[f'middle_{letter}']})"
            for name, letter in (("per_column", "u"), ("per_row", "v"))
            if f"middle_{letter}" in variant.options
        )
        grown = f" * ({column} - {variant.options['reference']})" if column else ""
        if any(name.startswith("half_") for name in variant.options):
            grown = ", each (x - bend * (x^2 - 1/3)) for x, from -1 to 1 over its axis"
        return f"{distance} += ({parts}){grown}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Size over the image."""
        distance, column = str(variant.options["channel"]), str(variant.options["temperature"])
        scale = span(view, column) if column else 1.0
        parts = [
            f"{in_mm(values[name] * scale * span(view, axis), distance):+.2f} mm along the {along}"
            for name, axis, along in (("per_row", "pixel_v", "rows"), ("per_column", "pixel_u", "columns"))
            if name in values
        ]
        when = f" over the range of {column}" if column else ""
        return f"The distance leans over the image: {' and '.join(parts)}{when}."

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a tilted mount."""
        return (
            "Turn the sensor by 90° about its axis, or use a second distance: skew stays with the array and does not "
            "grow with the distance."
        )
