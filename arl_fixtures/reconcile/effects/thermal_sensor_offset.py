"""A thermocouple reads off by a constant or in proportion."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import FloatArray, amplitude
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

_REFERENCE_C = 25.0
_MOST_UNITS = 8
FEWEST_EACH, MOST_EACH = 3, 16
"""Thermometers of which each may be off by its own."""


class SensorOffset(Effect):
    """T += offset + gain·(T − 25 °C); or one unit's by an offset of which a calibration of all gave each its share.

    Of several thermometers each may be off by an offset and a gain of its own (`each`).

    A constant that was fitted to the readings of n units together, one of them off, leaves that one off by
    offset·(1 − 1/n) and each of the others by −offset/n.
    """

    id = "thermal.sensor_offset"
    stage = Stage.BOOKKEEPING
    source = "IEC 60584-1: type K class 1, ±1.5 K or ±0.4 %"
    exact = True
    of_reading = True
    confusable = ("thermal.contact_resistance",)

    def variants(self, view: View) -> Iterable[Variant]:
        """One per temperature channel, and one per unit of it against the others."""
        column = _thermometers(view)
        units = view.labels(column) if column and len(view.labels(column)) <= _MOST_UNITS else ()
        for channel in view.channels(Role.TEMPERATURE):
            yield Variant(
                effect=self.id,
                options={"channel": channel.name},
                parameters=(amplitude("offset", "K", -30.0, 30.0, 0.5), amplitude("gain", "1", -0.3, 0.3, 0.01)),
                channels=(channel.name,),
                drivers=(f"sim_{channel.name}",),
            )
            if FEWEST_EACH <= len(view.labels(column) if column else ()) <= MOST_EACH:
                yield self._each(view, channel.name, column)
            for unit, shared in itertools.product(units, (True,) if column == "dut" else (False, True)):
                yield Variant(
                    effect=self.id,
                    options={
                        "channel": channel.name, "column": column, "unit": unit, "units": len(units) if shared else 0
                    },
                    parameters=(amplitude("offset", "K", -30.0, 30.0, 0.5),),
                    channels=(channel.name,),
                    drivers=(column,),
                    where={column: [unit]},
                )  # fmt: skip

    def _each(self, view: View, channel: str, column: str) -> Variant:
        units = view.labels(column)
        return Variant(
            effect=self.id,
            options={"channel": channel, "each": column, "names": json.dumps(list(units))},
            parameters=(
                *(amplitude(f"offset_{unit}", "K", -30.0, 30.0, 0.5) for unit in units),
                *(amplitude(f"gain_{unit}", "1", -0.3, 0.3, 0.01) for unit in units),
            ),
            channels=(channel,),
            drivers=(column, f"sim_{channel}"),
            where={column: list(units)},
        )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Shifts and stretches the reading."""
        name = str(variant.options["channel"])
        if "unit" in variant.options:
            own = view.selects(str(variant.options["column"]), str(variant.options["unit"])) * 1.0
            state[name] = state[name] + float(values["offset"]) * (own - _share(variant))
            return
        if "each" in variant.options:
            offset, gain = (_of_each(variant, values, view, part) for part in ("offset", "gain"))
            state[name] = state[name] + offset + gain * (state[name] - _REFERENCE_C)
            return
        state[name] = state[name] + float(values["offset"]) + float(values["gain"]) * (state[name] - _REFERENCE_C)

    def expression(self, variant: Variant) -> str:
        """The law."""
        name = variant.options["channel"]
        if "unit" in variant.options:
            shared = f" - 1/{variant.options['units']}" if variant.options["units"] else ""
            return f"{name} += offset * ([{variant.options['column']} = {variant.options['unit']}]{shared})"
        if "each" in variant.options:
            own = f"[{variant.options['each']}]"
            return f"{name} += offset{own} + gain{own} * ({name} - {_REFERENCE_C:g})"
        return f"{name} += offset + gain * ({name} - {_REFERENCE_C:g})"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Offset and gain."""
        if "unit" in variant.options:
            off = f"{variant.options['channel']} of {variant.options['unit']} reads {values['offset']:+.2f} K off"
            fitted = "; what was fitted to all units together gave each its share of it" if _share(variant) else ""
            return f"{off}{fitted}."
        if "each" in variant.options:
            ends = [
                (min(own), max(own))
                for own in ([values[f"{part}_{unit}"] for unit in _names(variant)] for part in ("offset", "gain"))
            ]
            (least, most), (flat, steep) = ends
            return (
                f"Each thermometer is off by its own: {variant.options['channel']} by {least:+.2f} to {most:+.2f} K "
                f"at 25 °C, and by {100 * flat:+.2f} to {100 * steep:+.2f} % of the difference to 25 °C on top."
            )
        return (
            f"{variant.options['channel']} reads {values['offset']:+.2f} K off at 25 °C, and "
            f"{values['gain'] * 100:+.2f} % of the difference to 25 °C on top."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What confirms it."""
        return "Put the thermocouple into ice water and boiling water, or beside a reference on the unpowered plate."


def _names(variant: Variant) -> list[str]:
    """Thermometers that are each off by their own."""
    return [str(name) for name in json.loads(str(variant.options["names"]))]


def _of_each(variant: Variant, values: Values, view: View, part: str) -> FloatArray:
    """Offset or gain of each row's thermometer; of one that was not seen the mean of the others."""
    own = {unit: float(values[f"{part}_{unit}"]) for unit in _names(variant)}
    codes, labels = view.codes(str(variant.options["each"]))
    mean = float(np.mean(list(own.values())))
    return np.array([*(own.get(label, mean) for label in labels), mean])[codes]


_PLACES = ("thermocouple", "thermometer", "node", "probe", "sensor", "nest", "position", "location")
"""Words of a column that tells thermometers apart where no devices are told apart."""


def _thermometers(view: View) -> str:
    """Category column that tells thermometers apart: devices, else places; empty for none."""
    if view.labels("dut"):
        return "dut"
    named = [name for name in view.columns.categories if any(word in name for word in _PLACES)]
    return next((name for name in named if view.is_category(name)), "")


def _share(variant: Variant) -> float:
    """What a fit to all units together gave each of an offset of one."""
    units = float(variant.options["units"])
    return 1.0 / units if units else 0.0
