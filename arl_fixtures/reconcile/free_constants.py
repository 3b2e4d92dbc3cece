"""What units' constant gains and offsets tell, which are free while effects are sought."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.acceptance import PRICE
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.scores import unit_labels


def constant_z(d: ChannelData, state: State) -> float:
    """Largest significance of a unit's constant gain or offset."""
    return float(np.max(np.abs(d.constants(d.residual(state))) / d.constant_errors))


def zero_z(d: ChannelData, state: State) -> float:
    """Largest significance of a unit's zero beside its gain.

    Where it is stated how steps scatter, as if they scattered so: what they seem to beyond may be the zero's doing.
    """
    steps = d.level("step")
    if steps is not None and steps.declared:
        d = replace(d, tau={**d.tau, "step": steps.floor})
    left, most = d.whiten(d.residual(state)), 0.0
    for unit in range(d.units):
        own = d.whiten((d.unit == unit).astype(np.float64))
        power = float(own @ own)
        most = max(most, abs(float(own @ left)) / np.sqrt(power) if power > 0.0 else 0.0)
    return most


def constants_alone(problem: Problem, state: State, channels: Sequence[str]) -> dict[str, float]:
    """What the constants of one unit alone gain in channels, less their price, by the unit's label.

    An effect in one unit only must do more than they: of many units one is always off by some constant.
    """
    gains = {label: 0.0 for label in unit_labels(problem)[1] if label}
    for d in problem.data:
        if d.channel.name in channels:
            z = d.constants(d.residual(state)) / d.constant_errors
            for label, square in zip(gains, z**2, strict=False):
                gains[label] += 0.5 * float(square) - PRICE
    return gains
