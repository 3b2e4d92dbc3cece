"""A DUT's contact to the plate is worse than assumed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.effect import Effect, Parameter, Stage, State, Values, Variant
from arl_fixtures.reconcile.effects_common import amplitude, is_of, shape
from arl_fixtures.reconcile.effects_history import history, low_pass, on_rows, rate
from arl_fixtures.reconcile.roles import Role, unit_of
from arl_fixtures.reconcile.view import View


class ContactResistance(Effect):
    """A node whose resistance to the plate is (1 + excess) times the simulated one.

    Simulated: τ dT/dt = T_plate + R·P − T. With more resistance: (1 + excess)·τ dT/dt = T_plate + (1 + excess)·R·P
    − T. The heat R·P = T + τ dT/dt − T_plate is read off the simulation itself. Settled, ΔT to the plate grows by
    `excess` in proportion to the heat that flows; on a ramp the node follows later. `carrying`: the contact of the
    node nearest to the plate; what stands upon it is warmer by as much, and follows it by a first-order lag.
    """

    id = "thermal.contact_resistance"
    stage = Stage.BOOKKEEPING
    source = "Incropera, DeWitt, Fundamentals of Heat and Mass Transfer, sec. 3.1.4: thermal contact resistance"
    confusable = ("thermal.sensor_offset", "thermal.latent_heat")

    def variants(self, view: View) -> Iterable[Variant]:
        """One per temperature channel of a node on a plate whose temperature is known, and one that carries all."""
        nodes: dict[str, list[tuple[float, Variant]]] = {}
        for channel in view.channels(Role.TEMPERATURE):
            plate = _plate(view, channel.name)
            if not plate:
                continue
            record = history(view, f"sim_{channel.name}")
            parameters: tuple[Parameter, ...] = (amplitude("excess", "1", -0.9, 20.0, 0.2),)
            if record is not None:
                longest = 0.3 * record.interval * record.values.shape[1]
                least = 0.3 * record.interval
                parameters += (shape("time_constant", record.unit, least, max(longest, 2 * least), 40.0, 200.0),)
            alone = Variant(
                effect=self.id,
                options={"channel": channel.name, "plate": plate},
                parameters=parameters,
                channels=(channel.name,),
                drivers=(plate.removeprefix("sim_"), f"sim_{channel.name}"),
            )
            yield alone
            gap = np.abs(view.number(f"sim_{channel.name}") - view.number(plate))
            nodes.setdefault(plate, []).append((float(np.nanmedian(gap)), alone))
        for found in nodes.values():
            if len(found) > 1:
                yield _carrying([variant for _, variant in sorted(found, key=lambda node: node[0])])

    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Solves the node again with the larger resistance."""
        name, plate = str(variant.options["channel"]), str(variant.options["plate"])
        more = float(values["excess"])
        own, base = history(view, f"sim_{name}"), history(view, plate)
        if own is None or base is None or "time_constant" not in values:
            gap = view.number(f"sim_{name}") - view.number(plate)
            for node in variant.channels:
                state[node] = state[node] + np.where(np.isfinite(gap), more * gap, 0.0)
            return
        tau = float(values["time_constant"])
        heated = own.values + tau * rate(own) - base.values
        driven = low_pass(base.values + (1.0 + more) * heated, own.interval / (tau * (1.0 + more)))
        same = low_pass(base.values + heated, own.interval / tau)
        state[name] = state[name] + on_rows(view, driven - same)
        for node in variant.channels[1:]:
            state[node] = state[node] + on_rows(view, low_pass(driven - same, own.interval / float(values["lag"])))

    def expression(self, variant: Variant) -> str:
        """The law."""
        name, plate = variant.options["channel"], variant.options["plate"]
        law = (
            f"(1 + excess) * time_constant * d{name}/dt = {plate} + (1 + excess) * (sim_{name} + time_constant * "
            f"dsim_{name}/dt - {plate}) - {name}"
        )
        upon = variant.channels[1:]
        if not upon:
            return law
        later = " after lag" if any(p.name == "lag" for p in variant.parameters) else ""
        return f"{law}; {', '.join(upon)} += {name} - sim_{name}{later}"

    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """Excess and its effect on the settled difference."""
        name, plate = str(variant.options["channel"]), str(variant.options["plate"])
        gap = float(np.nanmedian(view.number(f"sim_{name}") - view.number(plate))) if view.n else 0.0
        return (
            f"The contact of {name} to its plate has {values['excess'] * 100:+.1f} % resistance: it lies "
            f"{values['excess'] * gap:+.2f} K off when settled, and follows ramps later"
            f"{', with all that it carries' if variant.channels[1:] else ''}."
        )

    def next_experiment(self, variant: Variant) -> str:
        """What tells it from a sensor's offset."""
        return (
            "Switch the DUT off during a soak: an error of the contact vanishes with the heat flow, an error of the "
            "sensor stays."
        )


def _carrying(nodes: list[Variant]) -> Variant:
    """The first node's contact, and what stands upon that node; a lag needs a history."""
    first = nodes[0]
    times = [p for p in first.parameters if p.name == "time_constant"]
    return replace(
        first,
        options={**first.options, "carrying": len(nodes) - 1},
        parameters=(*first.parameters, *(replace(p, name="lag") for p in times)),
        channels=tuple(name for node in nodes for name in node.channels),
    )


def _plate(view: View, channel: str) -> str:
    """Column of what the node is screwed to, else of what cools that; simulated where it is a channel, or empty."""
    for part in ("plate", "heatsink", "sink", "coolant", "oil", "bath"):
        of_part = [name for name in sorted(view.columns.numbers) if unit_of(name) == "°C" and is_of(name, part)]
        found = [name for name in of_part if not is_of(name, "sim", "set", "std") and name != channel]
        for name in sorted(found, key=lambda name: name != f"{part}_temperature_c"):
            return f"sim_{name}" if f"sim_{name}" in view.columns.numbers else name
    return ""
