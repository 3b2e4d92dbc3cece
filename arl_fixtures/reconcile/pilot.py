"""First look without physics: true scatter of the rows, outliers, and how much there is to explain at all.

A physics-free model is cross-fitted over whole blocks; what it leaves gives the row's true scatter (robust) and the
outliers. It also is the ceiling against which named effects are judged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.boosting import Binned, Ceiling, bin_columns, ceiling
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import BoolArray, FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.effects_encoder import STAGE, turned_by
from arl_fixtures.reconcile.estimated_noise import estimated_error, group_median, noise_quantities
from arl_fixtures.reconcile.features import features_of
from arl_fixtures.reconcile.lonely import (
    FAR_ALONE,
    MOST_ALONE,
    common_part,
    distance_alone,
    distance_beside,
    kin_of,
    scatter_beside,
)
from arl_fixtures.reconcile.noise import POSE, Level, less_shared
from arl_fixtures.reconcile.play import turns
from arl_fixtures.reconcile.pose_scatter import beside_pose
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import BEARING_SIGNS, PIXEL, Role, played
from arl_fixtures.reconcile.stated import by_chance
from arl_fixtures.reconcile.turned import per_turn

MOST_ROWS = 12_000
TAIL_Z = 2.5
FAR_Z = 20.0
"""Standard errors beyond which a row is no tail of any noise: it counts the less, the farther it lies."""
FAR_IMAGE = 4.0
"""Median of the standard errors by which rows of a stage angle are off, from which all of it is."""
MISFIT = 2.0
"""Scatter about what the model leaves, in that of rows about those beside them, from which it is the model's."""
TAIL_SPREAD = 1.1
"""Scatter of a standard deviation, in Gaussian ones, from which its frames have heavy tails."""
TAIL_DEFICIT = 3.0
"""Deficit of the mean of standard deviations, in their excess variance, that tails like Student's with 4 degrees of
freedom make where the farthest rows are held back (a median of 10 frames' deviations is 10 % low, its mean 5 %)."""
LEAST_SHAPE = 1e-3
"""Share of what a shared error typically makes of a row of its group, below which it makes next to nothing."""
SAME_FRAMES = 0.2
"""Relative error within which scatters are higher than those of few frames by just what these lack."""
TAIL_SHARE = 0.004
"""More than this share of rows beyond 4 standard errors means heavy tails (a Gaussian has 0.00006)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """What a physics-free model predicts of one channel's residual.

    Attributes:
        ceiling: on the rows used.
        z: significance of the held-out gain over blocks.
        gain: held-out log-likelihood gain, with the scatter that groups share, scaled to all rows of the channel.
    """

    channel: str
    ceiling: Ceiling
    z: float
    gain: float

    def leading(self) -> list[str]:
        """Columns by which the model splits most."""
        order = sorted(self.ceiling.importance.items(), key=lambda kv: -kv[1])
        return [name for name, share in order[:5] if share > 0.05]


class Looker:
    """Physics-free looks at residuals of one problem; features are binned once."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.failed: dict[str, str] = {}
        self.features = features_of(problem.view)
        looked = [name for name in self.features if name != PIXEL]
        if turned_by(problem.view) == STAGE:  # what laws may be of, and no look is
            self.features |= per_turn(problem.view)
        if not (problem.view.varies("azimuth_deg") and problem.view.varies("stage_angle_deg")):
            for name in BEARING_SIGNS:  # the other one of the two says the same
                self.features.pop(name, None)
        for name in [n for n in self.features if played(n)]:
            if not turns(self.features[name]):
                del self.features[name]
        self.binned: Binned = bin_columns({n: self.features[n] for n in looked if n in self.features})

    def rows_of(self, data: ChannelData) -> IntArray:
        """Rows of a channel that are looked at: at most `MOST_ROWS`, evenly spread."""
        n = len(data.use)
        return np.arange(n) if n <= MOST_ROWS else (np.arange(MOST_ROWS) * n // MOST_ROWS)

    def look(self, data: ChannelData, state: State, *, trees: int = 60) -> Structure:
        """Cross-fit the residual of a channel."""
        rows = self.rows_of(data)
        target, weight = self.target_of(data, state, rows)
        if not np.any(target):
            return nothing(data)
        codes = self.binned.codes[:, data.use[rows]]
        found = ceiling(
            Binned(self.binned.names, codes, self.binned.edges), target, weight, data.fold[rows], trees=trees
        )
        part = data.part(rows)
        left = part.scale * (target - found.prediction)
        _, tau = part.fit_scatter(left)  # what groups share by chance is one witness a group, not one a row
        part.rebuild(tau)
        change = part.whiten(part.scale * target) ** 2 - part.whiten(left) ** 2
        gains = np.bincount(np.unique(part.block, return_inverse=True)[1], 0.5 * change)
        spread = float(np.sqrt(np.sum((gains - gains.mean()) ** 2))) if len(gains) > 1 else np.inf
        gain = float(gains.sum())
        z = gain / spread if spread > 0 else 0.0
        return Structure(channel=data.channel.name, ceiling=found, z=z, gain=gain * len(data.use) / len(rows))

    def calibrate(self, data: ChannelData, state: State, *, structure: Structure | None = None) -> Structure:
        """Set spread, trust and group scatters of a channel from what the physics-free model leaves."""
        data.trust = np.ones(len(data.use))
        data.spread = 1.0
        data.expect, data.tails = data.expect / data.tails, 1.0
        data.rebuild({})
        found = structure
        for _ in range(2):
            found = self.look(data, state, trees=40)
            if len(found.ceiling.prediction) == 0:
                break
            residual = self._centred(data, data.residual(state))
            predicted = found.ceiling.predict(self.binned.codes[:, data.use], data.fold)
            self._set_noise(data, residual / data.scale - predicted)
            _allow_for_tails(data, data.residual(state))
            _, tau = data.fit_scatter(data.residual(state))
            data.rebuild(tau)
            if data.order_levels(data.residual(state)):
                data.rebuild(data.fit_scatter(data.residual(state))[1])
            if data.spread < 1.5 and data.trust.min() == 1.0:
                break
        assert found is not None
        return found

    def target_of(self, data: ChannelData, state: State, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Residual in units of the scale, without constants and with wild values cut, and its weight."""
        target = self._centred(data, data.residual(state))[rows] / data.scale[rows]
        weight = (data.root_weight[rows] * data.scale[rows]) ** 2
        limit = 30.0 / np.sqrt(np.maximum(weight, 1e-300)) + 10.0 * _spread(target)
        return np.clip(target, -limit, limit), weight

    def _centred(self, data: ChannelData, residual: FloatArray) -> FloatArray:
        """Without the units' constants, and the means of what holding out does not test: steps or images."""
        if data.calibrated:
            residual = residual - data.scale * data.constants(residual)[data.unit]
        alike = self.problem.groups.unseen_alike
        if alike is not None:
            code = alike[self.problem.view.rows[data.use]]
            residual = less_shared(residual, data.scale, data.root_weight**2, code)
        return residual

    def _set_noise(self, data: ChannelData, left: FloatArray) -> None:
        """Spread and trust from what is left of the residual, in units of the scale."""
        if not data.stated_known:
            view = self.problem.view
            frames, rows = np.nan_to_num(view.frames()[data.use], nan=1.0), view.rows[data.use]
            quantities, step = noise_quantities(view, data.use), self.problem.groups.step[rows]
            data.stated = estimated_error(left * data.scale, frames, quantities, step, data.scale)
        z = left * data.scale / data.stated
        whole = self._in_whole_images(data, z)
        for level in data.levels:
            count = np.bincount(level.code, minlength=level.count)
            if level.name == POSE:
                z = beside_pose(level, z, level.scale / data.stated)
            elif np.median(count[count > 0]) >= 4:
                z = z - _shared(level, z, level.scale / data.stated)
        spread = 1.4826 * float(np.median(np.abs(z)))
        data.spread = max(spread, 1.0) if data.stated_known else max(spread, 0.05)
        if len(data.dark):
            z = np.where(data.dark, 0.0, z)
        kin = kin_of(self.problem, data.use)
        asked = self.problem.groups.of_curves and data.stated_known and data.spread > MISFIT
        beside = scatter_beside(z, kin) if asked else np.inf
        lacks = beside < data.spread / MISFIT
        if lacks:
            data.spread = max(beside, 1.0)
        chance = by_chance(self.problem.view, data.channel, data.use)
        alone = np.where(chance, 0.0, distance_alone(z / data.spread, kin))
        wild = alone > FAR_ALONE
        if np.mean(wild) > MOST_ALONE:
            wild = np.zeros_like(wild)
        data.trust = np.where(wild, (TAIL_Z / np.maximum(alone, TAIL_Z)) ** 2, 1.0)
        beyond = np.minimum(alone, distance_beside(z / data.spread, kin)) if lacks else np.abs(z) / data.spread
        beyond = np.where(whole, np.minimum(alone, beyond), beyond)
        beyond = np.where(wild | chance, 0.0, beyond)
        if np.mean(beyond > 4.0) > TAIL_SHARE:
            far = np.minimum(1.0, FAR_Z / np.maximum(beyond, 1e-9))
            data.trust *= far * np.minimum(1.0, TAIL_Z / np.maximum(beyond, 1e-9))
            # rows held back still scatter more than their weight says: a sum over many would pass for shared error
            excess = float(np.mean((data.trust * beyond) ** 2) / np.mean(data.trust))
            data.spread *= np.sqrt(max(excess, 1.0))

    def _in_whole_images(self, data: ChannelData, z: FloatArray) -> BoolArray:
        """Rows of stage angles (of a device) at which most rows are far off: no tails, and no edges."""
        code = self.problem.groups.angle
        if code is None:
            return np.zeros(len(z), dtype=bool)
        here = np.unique(code[self.problem.view.rows[data.use]], return_inverse=True)[1].astype(np.int64)
        return np.asarray(group_median(here, np.abs(z), int(here.max()) + 1)[here] > FAR_IMAGE)


def _shared(level: Level, z: FloatArray, shape: FloatArray) -> FloatArray:
    """What the rows of each group are off in common, in proportion to what a shared error of 1 makes of each; (n,).

    Where the light of rows differs, one error of their step is many errors of the brightest row and none of the dark.
    """
    typical = group_median(level.code, shape, level.count)[level.code]
    own = np.maximum(shape / np.maximum(typical, 1e-300), LEAST_SHAPE)
    part = group_median if level.name in {"pixel", "angle"} else common_part
    return own * part(level.code, z / own, level.count)[level.code]


def _allow_for_tails(data: ChannelData, residual: FloatArray) -> None:
    """Let frames with heavy tails scatter less on average than the root of their variance, as few of them do.

    A standard deviation of n frames has the mean σ(1 − Var(s²)/8σ⁴), and scatters by √(Var(s²)/4σ⁴): what exceeds the
    Gaussian's scatter, `spread`, tells how much of a deficit may be the tails'. Where all scatters together are just
    what the simulation says, both are of as many frames, or were made so: that is no larger noise.
    """
    if data.channel.role is not Role.SCATTER:
        return
    weight = data.trust * (data.scale / data.stated) ** 2
    rest = float(np.sum(weight * residual / data.scale) / max(float(np.sum(weight)), 1e-300))
    off = data.tails * (1.0 + rest) - 1.0  # of what Gaussian frames would show
    change = 1.0
    if data.spread > TAIL_SPREAD:
        relative = float(np.median(data.stated / data.scale))
        most = TAIL_DEFICIT * (data.spread**2 - 1.0) * relative**2
        change += float(np.clip(off, -most, 0.0))
    short = 1.0 / float(np.median(data.expect / data.tails)) - 1.0
    if abs(off - short) < SAME_FRAMES * short:
        change += off
    data.expect, data.tails = data.expect * change / data.tails, change


def nothing(data: ChannelData) -> Structure:
    """A channel whose residual is zero everywhere."""
    empty = Ceiling(before=0.0, after=0.0, block_gain=np.zeros(1), importance={}, prediction=np.zeros(0))
    return Structure(channel=data.channel.name, ceiling=empty, z=0.0, gain=0.0)


def _spread(x: FloatArray) -> float:
    return 1.4826 * float(np.median(np.abs(x - np.median(x))))
