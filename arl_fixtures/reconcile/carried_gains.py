"""A unit's gain on its signal, carried over to the scatters that grow with the signal."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.stated import frames_averaged, shortfall

CONTRADICTED = 2.0
"""Log-likelihood of a scatter that a gain may cost at most to be carried over to it."""


def carry_gains(problem: Problem, state: State) -> None:
    """Let a unit's gain move the scatters with its signal, as the simulation's own noise grows with the signal.

    Without this a calibration that a gain belongs to would pass for excess noise. Not to a scatter that clearly shows
    none of it: it is then no gain of the light by which that scatter grows.
    """
    for d in problem.data:
        parent = next((p for p in problem.data if p.calibrated and p.channel.role is Role.INTENSITY), None)
        if d.channel.role is not Role.SCATTER or parent is None:
            continue
        gains = parent.constants(parent.residual(state))
        by_row = np.zeros(problem.view.n)
        by_row[parent.use] = gains[parent.unit]
        signal = np.log(np.maximum(problem.view.sim[parent.channel.name][d.use], 1e-12))
        scatter = np.log(np.maximum(problem.view.sim[d.channel.name][d.use], 1e-12))
        good = np.isfinite(signal) & np.isfinite(scatter)
        spread = float(np.var(signal[good])) if good.any() else 0.0
        slope = float(np.cov(signal[good], scatter[good])[0, 1]) / spread if spread > 1e-6 else 0.0
        frames = frames_averaged(problem.view, d.channel)[d.use]
        d.expect = bare = d.tails * shortfall(frames)
        before = _misfit(d, state)
        d.expect = bare * np.maximum(1.0 + by_row[d.use], 0.1) ** slope
        if _misfit(d, state) > before + CONTRADICTED:
            d.expect = bare


def _misfit(d: ChannelData, state: State) -> float:
    """Half the sum of squares that a state leaves of a channel."""
    left = d.whiten(d.residual(state))
    return 0.5 * float(left @ left)
