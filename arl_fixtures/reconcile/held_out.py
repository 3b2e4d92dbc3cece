"""Agreement on rows that a fit has not seen: before, after and the floor that repeated frames leave."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.diagnosis import HeldOut
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.noise import less_constants
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.terms import Term, forward

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

def held_out_without(
    decision: Decision, left_out: Sequence[Term], channels: Sequence[str], gain: float
) -> HeldOut:
    """Before and after of terms that are left out, over channels."""
    rest = tuple(t for t in decision.terms if all(t is not own for own in left_out))
    before_state = forward(rest, decision.problem.view)
    after = decision.cross_fitted()
    data = [d for d in decision.problem.data if d.channel.name in channels]
    return held_out_of(data, before_state, after, decision.problem.groups.block_name, gain)


def mean_square(d: ChannelData, state: State, *, centred: bool = False) -> float:
    """Mean squared residual in standard errors; outliers weigh as in the fit.

    Centred: beside a gain or offset, and beside a scale of distances that a calibration has fitted.
    """
    residual = d.residual(state)
    if centred and d.channel.role is Role.DISTANCE and d.second is not None:
        residual = less_constants(residual, d.scale, d.root_weight**2, d.unit, second=d.second)
    elif centred and d.calibrated:
        # a gain belongs to what is corrected, not to the simulation before it
        along = state[d.channel.name][d.use] if d.channel.role is Role.INTENSITY else np.ones(len(residual))
        weight = d.root_weight**2 * along
        power = np.maximum(np.bincount(d.unit, weight * along, minlength=d.units), 1e-300)
        residual = residual - along * (np.bincount(d.unit, weight * residual, minlength=d.units) / power)[d.unit]
    return float(np.sum(d.trust * (residual / d.stated) ** 2) / np.sum(d.trust))


def held_out_of(data: Sequence[ChannelData], before: State, after: State, blocks: str, gain: float) -> HeldOut:
    """Before and after over channels."""
    rows = np.array([float(len(d.use)) for d in data])
    first = float(np.average([mean_square(d, before) for d in data], weights=rows)) if data else 0.0
    last = float(np.average([mean_square(d, after, centred=True) for d in data], weights=rows)) if data else 0.0
    floor = min(float(np.average([d.spread**2 for d in data], weights=rows)), last) if data else 1.0
    share = (first - last) / max(first - floor, 1e-9)
    return HeldOut(blocks=blocks, before=first, after=last, explained=float(np.clip(share, -1.0, 1.0)), gain=gain)
