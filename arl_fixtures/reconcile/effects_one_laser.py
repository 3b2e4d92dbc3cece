"""Light of one laser that a table reads in several places: what the laser does, all of them see.

A monitor diode and a power meter, or two receivers, see the same pulse. An effect of the laser on each of them alone
explains a part of the mismatch with as many parameters; on all of them at once it is one cause, told by all.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from arl_fixtures.reconcile.effect import Effect, State, Values, Variant
from arl_fixtures.reconcile.effects_common import light_channels, lit_signals
from arl_fixtures.reconcile.view import View

_APART = " + "


def with_all_readouts(variants: Iterable[Variant], view: View) -> Iterable[Variant]:
    """Variants on single signals, and those of the first signal once more on all that see the laser.

    Args:
        variants: with the option `channel`.
        view: rows under work.
    """
    lit = lit_signals(view)
    for variant in variants:
        yield variant
        if len(lit) > 1 and variant.options.get("channel") == lit[0]:
            others = tuple(name for channel in lit[1:] for name in light_channels(view, channel))
            yield replace(
                variant,
                options={**variant.options, "seen_in": _APART.join(lit[1:])},
                channels=tuple(dict.fromkeys((*variant.channels, *others))),
            )


def apply_to_all(effect: Effect, variant: Variant, values: Values, state: State, view: View) -> None:
    """What a variant of `with_all_readouts` does to the further signals; call it after the first one's change.

    A `voltage` is moved with the first signal only.
    """
    for channel in str(variant.options.get("seen_in", "")).split(_APART):
        if channel:
            options = {name: x for name, x in variant.options.items() if name != "seen_in"} | {"channel": channel}
            if "voltage" in options:
                options["voltage"] = ""
            effect.apply(replace(variant, options=options), values, state, view)


def all_readouts(variant: Variant, law: str) -> str:
    """A law in words, with the further signals that follow it."""
    others = str(variant.options.get("seen_in", ""))
    return f"{law}; likewise {others.replace(_APART, ' and ')}" if others else law
