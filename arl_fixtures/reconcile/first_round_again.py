"""The first round asked again, with other constants of the units: what is free beside an effect may hide it.

A gain or an offset of each unit is free while effects are sought. Where it is large, an effect may explain it as
well: then it is held. And whoever fitted a zero to each unit's signal took an effect's mean along: then a zero is let
free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.acceptance import PRICE, evidence, is_as_good, simplest
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.fit import Fit, finish, fit
from arl_fixtures.reconcile.free_constants import constant_z, constants_alone, zero_z
from arl_fixtures.reconcile.rivals import is_structure
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.screen import Screening, screen
from arl_fixtures.reconcile.two_in_place import SECOND_NAME

if TYPE_CHECKING:
    from arl_fixtures.reconcile.search import Search, Stage

CLEAR_CONSTANT = 5.0
"""Standard errors from which a unit's constant is worth explaining."""
LEAST_ZERO = 3.0
"""Standard errors by which an effect leaves a unit's signal a zero, from which the zero may have hidden it."""


def with_constants_held(search: Search, stage: Stage, chance: Screening) -> Stage:
    """Try the effects without free constants where these are large: an effect may explain the constant as well.

    It must beat the constants and the best effect beside them, each with the price of its parameters.
    """
    base = stage.base
    shifted = [
        d.channel.name for d in search.full.data if d.calibrated and constant_z(d, base.state) > CLEAR_CONSTANT
    ]
    if not shifted:
        return stage
    price = PRICE * sum(d.units for d in search.full.data if d.channel.name in shifted)
    own = constants_alone(search.full, base.state, shifted)
    _free_constants(search, shifted, free=False)
    # constants that many earn little: the effect pays for those that it does without
    bare, other = _asked(search, screen(search.small, search.variants, ()), chance, base.log_likelihood - price)
    sure = [
        r for r in other.ranked if evidence(r, search.surcharge) > stage.threshold
        and r.gain > max(stage.gain, stage.threshold + own.get(r.candidate.term.unit, -np.inf))
    ]  # fmt: skip
    if not sure:
        _free_constants(search, shifted, free=True)
        return stage
    best = max(sure, key=lambda r: r.gain)
    chosen = min((r for r in sure if is_as_good(r, best)), key=simplest)
    return replace(
        stage, base=bare, p_value=chance.p_value(evidence(chosen, search.surcharge)), ranked=other.ranked,
        chosen=chosen, gain=chosen.gain,
    )  # fmt: skip


def behind_zeros(search: Search, stage: Stage, chance: Screening) -> Stage:
    """Try the effects behind zeros that a user fitted to each unit's signal: they took the effect's mean along.

    The zeros must earn what they cost in likelihood, and the effect beside them what it must otherwise.
    """
    signals = [
        d.channel.name for d in search.full.data
        if d.channel.role is Role.INTENSITY and d.calibrated and d.second is None
        and _may_hide_behind_zero(search, stage, d)
    ]  # fmt: skip
    if not signals:
        return stage
    _free_zeros(search, signals, free=True)
    bare, other = _asked(search, search.candidates((), with_chance=False), chance, stage.base.log_likelihood)
    least = stage.threshold if stage.chosen is None else max(stage.gain + SECOND_NAME, stage.threshold)
    chosen = other.chosen
    if chosen is None or other.gain <= least or evidence(chosen, search.surcharge) <= stage.threshold:
        _free_zeros(search, signals, free=False)
        return stage
    return replace(
        stage, base=bare, p_value=chance.p_value(evidence(chosen, search.surcharge)), ranked=other.ranked,
        chosen=chosen, gain=other.gain,
    )  # fmt: skip


def _may_hide_behind_zero(search: Search, stage: Stage, data: ChannelData) -> bool:
    """Whether a signal has structure, or what was chosen for it leaves zeros that are none."""
    structure, chosen = is_structure(search.before[data.channel.name]), stage.chosen
    if chosen is None:
        return structure
    told = structure or data.channel.name in chosen.candidate.term.variant.channels
    return told and zero_z(data, chosen.fit.state) > LEAST_ZERO


def _asked(search: Search, screening: Screening, chance: Screening, before: float) -> tuple[Fit, Stage]:
    """No effect at all with the constants as they are now, and a round from there, gains counted from `before`."""
    bare = finish(search.full, fit(search.full, ()))
    handicap = max(before - bare.log_likelihood, 0.0)
    other = search.ask(bare, screening, chance)
    for r in other.ranked:
        r.gain -= handicap
        r.robust = min(r.robust, r.gain)
    return bare, replace(other, gain=other.gain - handicap)


def _free_constants(search: Search, channels: Sequence[str], *, free: bool) -> None:
    for problem in (search.full, search.small):
        for d in problem.data:
            if d.channel.name in channels:
                d.free_constant = free
                d.rebuild(d.tau)


def _free_zeros(search: Search, channels: Sequence[str], *, free: bool) -> None:
    for problem in (search.full, search.small):
        for d in problem.data:
            if d.channel.name in channels:
                if free:
                    d.free_zero()
                else:
                    d.hold_second()
                d.rebuild(d.tau)
