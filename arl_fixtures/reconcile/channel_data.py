"""One channel's rows as a statistical problem: residuals, weights, units' constants, shared errors, likelihood."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import Channel, FloatArray, IntArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.mixed_model import UnitConstants
from arl_fixtures.reconcile.noise import (
    NESTED,
    OF_THEIR_OWN,
    PARTS_OF_STEPS,
    Level,
    beside_steps,
    fit_tau,
    is_largest_first,
    less_constants,
    scale_of,
    share_more_than_stated,
    surprise,
    turned,
)
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.whitener import Whitener

ZERO_SHARE = 0.02
"""Standard deviation of a calibrated signal's zero beside an effect, as a share of the median signal."""
CALIBRATED = (Role.INTENSITY, Role.DISTANCE)
"""Roles whose gain or offset a user calibrates per unit: a constant of theirs carries no finding."""
SUITED = 4.0
"""Log-likelihood by which an order of scatters must be likelier than one in which the larger comes first: each is
approximate, and a little likelihood may be what it takes too little of."""
CLEARLY_ADDED = 15.0
"""Log-likelihood by which steps that differ by an amount must be likelier than steps that differ by a share."""
_Levels = tuple[Level, ...]
_Fitted = tuple[float, dict[str, float], _Levels, _Levels]  # likelihood, scatters, the levels, their best order


@dataclass(slots=True, kw_only=True)
class ChannelData:
    """One channel on the rows that can be compared.

    Attributes:
        channel: what it is.
        use: positions among the view's rows.
        measured: measured values there.
        stated: standard error of the row's mean by the simulation's own noise model (estimated where it has none).
        spread: factor by which rows scatter more than stated.
        trust: weight of each row, 1 or less for outliers.
        dark: rows that are left out for now: pixels that died cannot tell of anything else; empty for none.
        scale: what a gain error of 1 would change (the simulation itself), or 1 for an offset.
        unit: calibration unit of each row; units: their number.
        levels: groups that share errors.
        fold: hold-out fold of each row.
        free_constant: whether a constant per unit may be fitted (where the role knows calibration at all).
        whitener: of the present scatters.
        intercept: whitened direction of the units' constants, (n,), or (units, n) where units share groups.
        stated_known: whether the simulation states its noise.
        expect: expected measurement over the true value, 1 except for scatters of few frames.
    """

    channel: Channel
    use: IntArray
    measured: FloatArray
    stated: FloatArray
    scale: FloatArray
    unit: IntArray
    units: int
    levels: tuple[Level, ...]
    fold: IntArray
    block: IntArray
    stated_known: bool
    expect: FloatArray
    spread: float = 1.0
    trust: FloatArray = field(default_factory=lambda: np.zeros(0))
    dark: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    tau: dict[str, float] = field(default_factory=dict)
    free_constant: bool = True
    tails: float = 1.0
    whitener: Whitener = field(init=False)
    intercept: FloatArray = field(init=False)
    _intercept_weight: FloatArray = field(init=False)
    _exact: UnitConstants | None = field(init=False, default=None)
    _inverse: FloatArray = field(init=False)
    _units_share: bool = field(init=False)
    _fitted: dict[object, _Fitted] = field(init=False, default_factory=dict)
    """By what it was fitted to: the same is asked again and again."""

    def __post_init__(self) -> None:
        self._units_share = any(
            np.unique(level.code * self.units + self.unit).size > level.count for level in self.levels
        )
        self.trust = np.ones(len(self.use)) if len(self.trust) == 0 else self.trust
        self.rebuild(self.tau)

    @property
    def calibrated(self) -> bool:
        """Whether a constant per unit is fitted beside the effects, as a matter of calibration."""
        return self.free_constant and self.channel.role in CALIBRATED

    @property
    def root_weight(self) -> FloatArray:
        """1 / standard error, with outliers held back."""
        weight = np.sqrt(self.trust) / (self.stated * self.spread)
        return np.where(self.dark, 0.0, weight) if len(self.dark) else weight

    def rebuild(self, tau: dict[str, float], whitener: Whitener | None = None) -> None:
        """Make the whitener (or take one) anew for other scatters, weights or spread."""
        self.tau = dict(tau)
        self.whitener = whitener or Whitener(self.root_weight, self.levels, self.tau)
        self._exact = None
        if self.calibrated:
            self._prepare_constants()

    def _prepare_constants(self) -> None:
        """Whitened direction of each unit's constant; a matrix where units share the errors of a step."""
        if not self._units_share:
            self.intercept = self.whitener(self.scale)
            weight = np.bincount(self.unit, self.intercept**2, minlength=self.units)
            self._intercept_weight = np.where(weight > 0, weight, np.inf)
            return
        self.intercept = self.whitener(np.where(self.unit == np.arange(self.units)[:, None], self.scale, 0.0))
        gram = self.intercept @ self.intercept.T
        self._inverse = np.asarray(np.linalg.pinv(gram, rcond=1e-9, hermitian=True), dtype=np.float64)

    def whiten(self, x: FloatArray) -> FloatArray:
        """Independent unit variables, without what a constant per unit explains."""
        z = self.whitener(x)
        if self.calibrated:
            constants = self._explained(z)
            z = z - (constants @ self.intercept if self._units_share else self.intercept * constants[self.unit])
        return z

    def _explained(self, whitened: FloatArray) -> FloatArray:
        """Constant of each unit that leaves least of a whitened residual."""
        if self._units_share:
            return np.asarray(self._inverse @ (self.intercept @ whitened), dtype=np.float64)
        total = np.bincount(self.unit, self.intercept * whitened, minlength=self.units)
        return np.asarray(total / self._intercept_weight, dtype=np.float64)

    @property
    def _constants(self) -> UnitConstants:
        if self._exact is None:  # whitening is approximate where groups cross, and its constants off by many errors
            weight, tau = self.root_weight, self.whitener.tau
            self._exact = UnitConstants(weight, self.unit, self.units, self.scale, self.levels, tau)
        return self._exact

    def constants(self, residual: FloatArray) -> FloatArray:
        """Gain or offset of each unit in a residual, (units,)."""
        return self._constants.of(residual)

    @property
    def constant_errors(self) -> FloatArray:
        """Standard error of each unit's gain or offset, (units,); infinite where no row tells of it."""
        return self._constants.errors

    def residual(self, state: State) -> FloatArray:
        """Measured − corrected."""
        return self.measured - self.expect * state[self.channel.name][self.use]

    def follow(self, state: State) -> None:
        """Let a unit's gain belong to what is corrected: the user calibrated what the sensor saw, effects and all."""
        if self.channel.role is Role.INTENSITY:
            self.relate_to(scale_of(state[self.channel.name][self.use]))
            self.rebuild(self.tau)

    def order_levels(self, residual: FloatArray) -> bool:
        """Whiten levels in the order in which a residual is told best; tells whether that is another one."""
        before, self.levels = self.levels, self._told(residual, 0.0, ())[-1]
        return any(a is not b for a, b in zip(before, self.levels, strict=True))

    def relate_to(self, scale: FloatArray) -> None:
        """Let gains and what groups share be parts of other values: of two kinds, they would differ by any curve."""
        self.scale = scale
        self.levels = tuple(
            level if level.declared or level.amount or level.name in OF_THEIR_OWN else replace(level, scale=scale)
            for level in self.levels
        )

    def differ_like(self, whole: ChannelData, place: IntArray) -> None:
        """Let steps differ as in the channel of which this one has the rows at these places."""
        steps = whole.level("step")
        self.levels = tuple(
            replace(level, scale=steps.scale[place], amount=steps.amount) if steps and level.name == "step" else level
            for level in self.levels
        )

    def tell_step_scatter(self, residual: FloatArray) -> bool:
        """Let steps differ by an amount and not by a share of the signal, where what nobody declared is clearly that.

        A dark level that is found anew at every step is one; bright rows hardly show it.

        Returns:
            Whether they differ by the other one now.
        """
        place = next((k for k, v in enumerate(self.levels) if v.name == "step"), None)
        if self.channel.role is not Role.INTENSITY or place is None or self.levels[place].floor > 0.0:
            return False
        before, step = self.levels, self.levels[place]
        share = replace(step, scale=self.scale, amount=False)
        amount = replace(step, scale=np.full(len(self.use), float(np.median(self.scale))), amount=True)
        likelihood = []
        for kind in (share, amount):
            self.levels = (*before[:place], kind, *before[place + 1 :])
            likelihood.append(self.fit_scatter(residual)[0])
        clear = likelihood[1] > likelihood[0] + CLEARLY_ADDED
        self.levels = (*before[:place], amount if clear else share, *before[place + 1 :])
        return clear is not step.amount

    def share_within(self, level: Level) -> None:
        """Let groups within images share an error: it is whitened before all that these are nested in."""
        place = next((k for k, other in enumerate(self.levels) if other.name in NESTED), len(self.levels))
        self.levels = (*self.levels[:place], level, *self.levels[place:])
        self.rebuild(self.tau)

    def free_zero(self) -> None:
        """Let each unit's signal have a zero of its own, beside an effect that the user's calibration did not know.

        A line that was fitted to a recording with the effect in it is off in gain and zero once the effect is taken
        away. The zero carries no evidence then; it is no larger than a few percent of the signal.
        """
        if self.channel.role is Role.INTENSITY:
            self.free_second(ZERO_SHARE * float(np.median(self.scale)), np.ones(len(self.use)))

    def free_second(self, size: float, scale: FloatArray) -> None:
        """Let each unit have a second constant of about this size: a zero beside a gain, a scale beside an offset."""
        if self.calibrated and self.second is None:
            second = Level(name="unit", code=self.unit, count=self.units, scale=scale, floor=size)
            self.levels = (second, *self.levels)

    def hold_second(self) -> None:
        """Take the units' second constant away again."""
        self.levels = tuple(level for level in self.levels if level.name != "unit")
        self.tau.pop("unit", None)

    @property
    def second(self) -> FloatArray | None:
        """What a second constant of its unit changes in each row, None where units have but one."""
        return next((level.scale for level in self.levels if level.name == "unit"), None)

    def part(self, rows: IntArray) -> ChannelData:
        """The channel on some of its rows, with the same noise."""
        levels = tuple(level.part(rows) for level in self.levels)
        return replace(
            self, use=self.use[rows], measured=self.measured[rows], stated=self.stated[rows], scale=self.scale[rows],
            unit=self.unit[rows], levels=levels, fold=self.fold[rows], block=self.block[rows],
            expect=self.expect[rows], trust=self.trust[rows], dark=self.dark[rows] if len(self.dark) else self.dark,
        )  # fmt: skip

    def level_scatter(
        self, residual: FloatArray, level: Level, partial: Whitener, *, lost: float = 0.0
    ) -> tuple[float, float]:
        """Scatter of one level and its gain of likelihood over the level's floor.

        Images are nested in steps: their scatter is what remains beside the mean of their step, that of a few rows
        which follow one another beside that of many. So is that of pixels and angles: with rows missing they see more
        of one step than of another.
        """
        return self._level_scatter(*self._centred(residual), level, partial, lost)

    def _centred(self, residual: FloatArray) -> tuple[FloatArray, float]:
        """A residual without what a constant makes of it, and the degrees of freedom that this takes."""
        uniform = self.channel.role is Role.SCATTER and self.tails == 1.0
        if not (self.calibrated or uniform):  # a noise that is larger everywhere does not scatter
            return residual, 0.0
        # plain means: constants that weigh by the present scatters would depend on where the estimate starts
        centred = less_constants(residual, self.scale, self.root_weight**2, self.unit, second=self.second)
        return centred, 1.0 if self._units_share else float(self.units)

    def _level_scatter(
        self, centred: FloatArray, count: float, level: Level, partial: Whitener, lost: float
    ) -> tuple[float, float]:
        if level.smooth is not None:
            sums, weight = partial.group_sums(centred, level.name)
            lost = min(float(level.smooth.shape[1]), level.count / 2.0)
            return fit_tau(level.beyond_smooth(sums, weight), weight, floor=level.floor, lost=lost)
        part, around = level.name in PARTS_OF_STEPS, self._around(level)
        if around is not None and (part or (level is not around and level.is_crossed(around))):
            own = self.scale if self.calibrated and around.scale is not self.scale else None
            centred = beside_steps(centred, around, self.root_weight**2, own, self.unit)
            count = float(around.count) if part else max(count, 1.0)
        elif level.name == "step":
            count += lost
        sums, weight = partial.group_sums(centred, level.name)
        return fit_tau(sums, weight, floor=level.floor, lost=min(count, level.count / 2.0), freedom=level.freedom)

    def _around(self, level: Level) -> Level | None:
        """The level that another's groups lie within; the step of one that is no part of any."""
        wider = NESTED[NESTED.index(level.name) + 1 :] if level.name in PARTS_OF_STEPS else ("step",)
        return next((found for name in wider if (found := self.level(name)) is not None), None)

    def fit_scatter(
        self, residual: FloatArray, *, lost: float = 0.0, without: tuple[str, ...] = ()
    ) -> tuple[float, dict[str, float]]:
        """Likelihood with the group scatters at their best; those of the levels in `without` are taken as none.

        Returns:
            log-likelihood (up to a constant of the channel), scatters. The whitener is left as it was.
        """
        likelihood, tau, *_ = self._told(residual, lost, without)
        return likelihood, dict(tau)

    def _told(self, residual: FloatArray, lost: float, without: tuple[str, ...]) -> _Fitted:
        key = self._digest(residual), lost, without, self.free_constant, self.tails, tuple(map(id, self.levels))
        if key not in self._fitted:
            found, order = self._told_best(residual, lost, without)
            self._fitted[key] = *found, self.levels, order  # the levels' ids stay taken
        return self._fitted[key]

    def _digest(self, residual: FloatArray) -> bytes:
        found = blake2b(residual.tobytes())
        for part in (self.root_weight, self.scale):
            found.update(part.tobytes())
        return found.digest()

    def _told_best(
        self, residual: FloatArray, lost: float, without: tuple[str, ...]
    ) -> tuple[tuple[float, dict[str, float]], _Levels]:
        """What the likelier order of the levels finds, or that which suits what it finds if it is as likely."""
        found = self._fit_in_order(self.levels, residual, lost, without)
        if not share_more_than_stated(self.levels, found[1]):
            return found, self.levels  # nothing that passes for another level's
        other = turned(self.levels)
        ways = [(found, self.levels), (self._fit_in_order(other, residual, lost, without), other)]
        return max(ways, key=lambda way: way[0][0] + SUITED * is_largest_first(way[1], way[0][1]))

    def _fit_in_order(
        self, levels: _Levels, residual: FloatArray, lost: float, without: tuple[str, ...]
    ) -> tuple[float, dict[str, float]]:
        tau: dict[str, float] = {}
        whitener = Whitener(self.root_weight, (), {})
        centred, count = self._centred(residual)
        for level in levels:
            whitener, tau[level.name] = whitener.followed_by(level), level.floor
            if level.name not in without:
                tau[level.name], _ = self._level_scatter(centred, count, level, whitener, lost)
                whitener = whitener.at(tau[level.name])
        fitted = copy(self)
        fitted.rebuild(tau, whitener)
        return fitted.likelihood(residual), tau

    def likelihood(self, residual: FloatArray) -> float:
        """Log-likelihood with the present scatters, up to a constant of the channel."""
        z = self.whiten(residual)
        unlikely = sum(surprise(self.whitener.tau[v.name], v.floor, v.freedom) for v in self.levels)
        return -0.5 * (float(z @ z) + self.whitener.log_det) - unlikely

    def level(self, name: str) -> Level | None:
        """The grouping of a name; None where the channel's rows have none such."""
        return next((level for level in self.levels if level.name == name), None)

    def alone(self, level: Level) -> float:
        """Scatter of a level from which its groups' rows tell of it more than of themselves."""
        weight = np.bincount(level.code, (self.root_weight * level.scale) ** 2, minlength=level.count)
        return float(1.0 / np.sqrt(max(float(np.median(weight)), 1e-300)))
