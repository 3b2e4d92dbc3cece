"""A thermocouple reads off by a constant or in proportion."""

from __future__ import annotations

from collections.abc import Iterable

from arl_fixtures.reconcile.effect import Effect, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import amplitude
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View

_REFERENCE_C = 25.0
_MOST_UNITS = 8


class SensorOffset(Effect):
    """T += offset + gain·(T − 25 °C); or one unit's by an offset of which a calibration of all gave each its share.

    A constant that was fitted to the readings of n units together, one of them off, leaves that one off by
    offset·(1 − 1/n) and each of the others by −offset/n.
    """

    id = "thermal.sensor_offset"
    stage = Stage.BOOKKEEPING
    source = "IEC 60584-1: type K class 1, ±1.5 K or ±0.4 %"
    exact = True
    confusable = ("thermal.contact_resistance",)

    def variants(self, view: View) -> Iterable[Variant]:
        """One per temperature channel, and one per unit of it against the others."""
        units = view.labels("dut") if len(view.labels("dut")) <= _MOST_UNITS else ()
        for channel in view.channels(Role.TEMPERATURE):
            yield Variant(
                effect=self.id,
                options={"channel": channel.name},
                parameters=(amplitude("offset", "K", -30.0, 30.0, 0.5), amplitude("gain", "1", -0.3, 0.3, 0.01)),
                channels=(channel.name,),
                drivers=(f"sim_{channel.name}",),
            )
            for unit in units:
                yield Variant(
                    effect=self.id,
                    options={"channel": channel.name, "unit": unit, "units": len(units)},
                    parameters=(amplitude("offset", "K", -30.0, 30.0, 0.5),),
                    channels=(channel.name,),
                    drivers=("dut",),
                    where={"dut": [unit]},
                )

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Shifts and stretches the reading."""
        name = str(variant.options["channel"])
        if "unit" in variant.options:
            own = view.selects("dut", str(variant.options["unit"])) - 1.0 / float(variant.options["units"])
            state[name] = state[name] + float(values["offset"]) * own
            return
        state[name] = state[name] + float(values["offset"]) + float(values["gain"]) * (state[name] - _REFERENCE_C)

    def expression(self, variant: Variant) -> str:
        """The law."""
        name = variant.options["channel"]
        if "unit" in variant.options:
            return f"{name} += offset * ([dut = {variant.options['unit']}] - 1/{variant.options['units']})"
        return f"{name} += offset + gain * ({name} - {_REFERENCE_C:g})"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Offset and gain."""
        if "unit" in variant.options:
            return (
                f"{variant.options['channel']} of {variant.options['unit']} reads {values['offset']:+.2f} K off; "
                f"what was fitted to all units together gave each its share of it."
            )
        return (
            f"{variant.options['channel']} reads {values['offset']:+.2f} K off at 25 °C, and "
            f"{values['gain'] * 100:+.2f} % of the difference to 25 °C on top."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What confirms it."""
        return "Put the thermocouple into ice water and boiling water, or beside a reference on the unpowered plate."
