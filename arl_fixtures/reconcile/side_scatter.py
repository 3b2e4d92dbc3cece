"""What an effect on signals does to their scatters on the side, where a sensor's noise comes in elsewhere."""

from __future__ import annotations

from enum import Enum

import numpy as np

from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_common import set_light
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.view import View


class Side(Enum):
    """How scatters go along with what an effect does to means."""

    OWN = ""
    """As the effect's law says."""
    STILL = "still"
    """Not at all: the noise comes in behind the effect, or is that of the nominal signal."""
    LIGHT = "light"
    """As the table's noise law says of the new signal."""
    GAIN = "gain"
    """As the signal itself: the effect multiplies what noise has come in."""


def with_scatters(side: Side, before: State, after: State, view: View) -> State:
    """The state after an effect, its scatters moved from those before it by another rule than the effect's own."""
    if side is Side.OWN:
        return after
    made = {name: before[name] if name.endswith("_std") else values for name, values in after.items()}
    for name in [channel.name for channel in view.channels(Role.INTENSITY)]:
        if side is Side.STILL or name not in made or made[name] is before[name]:
            continue
        light, made[name] = made[name], before[name]
        if side is Side.LIGHT:
            set_light(view, made, name, light)
        else:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = light / before[name]
            made[name], scatter = light, f"{name}_std"
            if scatter in made:
                made[scatter] = made[scatter] * np.where(np.isfinite(ratio), np.abs(ratio), 1.0)
    return made
