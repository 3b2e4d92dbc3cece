"""Whether rows share errors within steps that nobody stated: what is sharp then finds its likeness in them."""

from __future__ import annotations

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.noise import PARTS_OF_STEPS
from arl_fixtures.reconcile.roles import Role

SHARED = 4.0
"""Log-likelihood from which images, angles or rows that follow one another share an error of their own."""
_WITHIN = (*PARTS_OF_STEPS, "angle")


def more_than_rows(d: ChannelData, state: State) -> bool:
    """Whether a channel is clearly likelier where images, angles or rows that follow one another share errors."""
    if d.channel.role is Role.SCATTER or not any(level.name in _WITHIN for level in d.levels):
        return False
    residual = d.residual(state)
    return d.fit_scatter(residual)[0] - d.fit_scatter(residual, without=_WITHIN)[0] > SHARED
