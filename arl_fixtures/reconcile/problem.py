"""A table's comparison as a statistical problem: its channels on the same rows, with what their groups share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import Channel, Columns, FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.estimated_noise import estimated_error, noise_quantities
from arl_fixtures.reconcile.grouping import Groups, find_groups, folds_of
from arl_fixtures.reconcile.neighbour_noise import add_patches
from arl_fixtures.reconcile.noise import CROSSED, IN_STEPS, Level, level_of, scale_of, unnoticed
from arl_fixtures.reconcile.pose_scatter import add_pose
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.stated import frames_averaged, shortfall, stated_error
from arl_fixtures.reconcile.view import View

FOLDS = 5
FEWEST_STEPS = 5
"""Steps from which an undeclared scatter between steps can be estimated: tests then know how few they are."""
SCATTER_STEPS = 0.005
"""Share by which the scatter of frames differs from step to step at rest; it counts like a declared one."""


class Problem:
    """All channels of some rows of a table.

    Args:
        columns: the table.
        rows: rows under work; all where None.
        groups: of the whole table; found where None.
    """

    def __init__(self, columns: Columns, rows: IntArray | None = None, groups: Groups | None = None) -> None:
        self.columns = columns
        self.view = View(columns, rows, scatters=False)
        self.groups = groups if groups is not None else find_groups(columns)
        self.fold = folds_of(self.groups.block, FOLDS)[self.view.rows]
        self.data: list[ChannelData] = []
        for channel in columns.channels:
            made = self._channel(channel)
            if made is not None:
                self.data.append(made)

    def _channel(self, channel: Channel) -> ChannelData | None:
        view, groups = self.view, self.groups
        measured, simulated = view.number(channel.name), view.sim[channel.name]
        use = np.flatnonzero(np.isfinite(measured) & np.isfinite(simulated))
        if len(use) < 4:
            return None
        stated, known = stated_error(view, channel)
        stated = stated[use]
        sim = simulated[use]
        relative = channel.role in {Role.INTENSITY, Role.SCATTER}
        scale = scale_of(sim) if relative else np.ones(len(use))
        rows = view.rows[use]
        levels: list[Level] = []
        for name in (*CROSSED, *IN_STEPS):
            code: IntArray | None = getattr(groups, name)
            if code is not None:
                made = level_of(name, code[rows], scale)
                if made is not None:
                    levels.append(made)
        declared = self.columns.numbers.get(f"sim_{channel.name}_repeat_std")
        floor, step_scale, stated_shared = 0.0, scale, False
        if declared is not None and np.any(declared[rows] > 0):
            step_scale, floor, stated_shared = np.nan_to_num(declared[rows]), 1.0, True
        elif channel.role is Role.SCATTER:
            step_scale, floor, stated_shared = SCATTER_STEPS * scale, 1.0, True
        elif len(np.unique(groups.step[rows])) < FEWEST_STEPS:
            floor = 1.0  # neither declared nor to be estimated: what a step shares carries no evidence
            if declared is not None and np.all(declared[rows] == 0.0):
                step_scale, stated_shared = unnoticed(scale, stated, groups.step[rows]), True
        made = level_of("step", groups.step[rows], step_scale, floor=floor, fewest=1, declared=stated_shared)
        if made is not None and not groups.of_curves:
            levels.append(made)
        expect = np.ones(len(use))
        if channel.role is Role.SCATTER:
            expect = shortfall(frames_averaged(view, channel)[use])
        unit = np.unique(groups.unit[rows], return_inverse=True)[1].astype(np.int64)
        data = ChannelData(
            channel=channel, use=use, measured=measured[use], stated=stated, scale=scale, unit=unit,
            units=int(unit.max()) + 1, levels=tuple(levels), fold=self.fold[use], block=groups.block[rows],
            stated_known=known, expect=expect,
        )  # fmt: skip
        if not known:
            frames = np.nan_to_num(view.frames()[use], nan=1.0)
            quantities, step = noise_quantities(view, use), groups.step[rows]
            data.stated = estimated_error(data.residual(view.sim), frames, quantities, step, scale)
            data.rebuild({})
        add_pose(data, view, groups.frame)
        if groups.pixel is not None:
            image = groups.frame if groups.frame is not None else groups.step
            seen = (*groups.unit_columns, "pixel_u", "pixel_v", "stage_angle_deg")
            add_patches(data, view, image, self.columns.group(*seen))
        return data

    @property
    def names(self) -> tuple[str, ...]:
        """Channels in order."""
        return tuple(d.channel.name for d in self.data)

    def whiten_state(self, state: State) -> FloatArray:
        """Whitened residual of all channels in one vector."""
        return np.concatenate([d.whiten(d.residual(state)) for d in self.data])

    def whiten_change(self, before: State, after: State) -> FloatArray:
        """Whitened change of the corrected simulation (a tangent times its step)."""
        parts = []
        for d in self.data:
            a, b = after[d.channel.name], before[d.channel.name]
            parts.append(np.zeros(len(d.use)) if a is b else d.whiten(d.expect * (a - b)[d.use]))
        return np.concatenate(parts)

    def codes(self, code: IntArray) -> IntArray:
        """A code of the whole table's rows on the stacked vector."""
        return np.concatenate([code[self.view.rows[d.use]] for d in self.data])

    def log_likelihood(self, state: State, *, lost: float = 0.0, without: tuple[str, ...] = ()) -> float:
        """Marginal likelihood with group scatters at their best for this state."""
        return sum(d.fit_scatter(d.residual(state), lost=lost, without=without)[0] for d in self.data)

    @contextmanager
    def keeping_scatters(self) -> Iterator[None]:
        """The problem with whatever scatters its groups are given meanwhile; afterwards with those of before."""
        kept = [(d, d.tau) for d in self.data]
        try:
            yield
        finally:
            for d, tau in kept:
                d.rebuild(tau)

    def refit_scatter(self, state: State, *, lost: float = 0.0) -> None:
        """Set the group scatters to their best for this state."""
        for d in self.data:
            d.rebuild(d.fit_scatter(d.residual(state), lost=lost)[1])
