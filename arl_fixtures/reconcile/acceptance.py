"""Whether a candidate may be named: what counts for it, and what only looks like an effect of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effects_surface import TOGETHER
from arl_fixtures.reconcile.fit import Fit
from arl_fixtures.reconcile.own_driver import driven_by, has_own_driver, mends_shape
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import PIXEL_COLUMNS, Role
from arl_fixtures.reconcile.screen import FEW_AMPLITUDES, Candidate, Surcharge
from arl_fixtures.reconcile.step_means import act_apart
from arl_fixtures.reconcile.terms import Term, forward

PRICE = 2.0
"""Log-likelihood that each free parameter must earn."""
MISFIT_SHARE, HIDDEN_SHARE, EXACT_SHARE = 0.15, 0.004, 0.0004
"""A further effect on a channel must gain this share of what one there gains: with a driver in common, without one,
and without one where that one's law is a plain number, which leaves nothing."""
FURTHER, FURTHER_APART = 3.0, 1.0
"""What a further effect on a channel must gain beyond the threshold, as no operator before it is exact; less where
the two have no driver in common."""
QUIET, QUIET_GAIN = 0.15, 3.0
"""Share of its mean square below which an effect hardly acts, and what a further one must gain there."""
STILL = 0.3
"""Standard errors up to which a row counts as not mixed."""
STEADY_GAIN, CLEAR_GAIN = 2.0, 8.0
"""Log-likelihood by which a further effect is as large wherever a strong one acts, and does not grow with it; and
what it must gain itself if it gains next to nothing against the strong one."""
UNDONE = 1.0 / 3.0
"""Share of the squares of two effects of the same drivers that both together must keep: nobody saw what they undo."""
LEAST_SCATTER = 0.03
"""Relative excess of scatter below which rounding and the noise law's own accuracy explain it."""
_SMALLEST = 1e-300
SIDE_SHARE = 0.5
"""Share of a gain from which it lives on the side effects of others, and what it must be of what these gain there."""
LEAST_MEANS = 0.2
"""Share of what a mean's effect gains on scatters that it must gain on means, which tell more of it."""
TWIN_GAIN, LEAST_ROBUST = 2.0, 0.1
"""Of candidates that differ by less in log-likelihood the one with fewest parameters is taken; where both move edges,
as a test that allows for shared errors counts it, down to this share of the plain one."""
AT_EDGE = 1e-3
"""Share of an amplitude's range that counts as its edge."""
ESSENTIAL_Z = 2.0
"""Standard errors by which an effect's essential parameter must differ from none."""
PATTERN_ODDS = 0.65
"""Share of the threshold that an effect must gain over free patterns of pixels and angles in its place."""


@dataclass(slots=True, kw_only=True)
class Ranked:
    """A candidate after its non-linear fit beside the present terms.

    Attributes:
        fit: joint fit on the full problem.
        gain: likelihood gained over the present terms, less the price.
        robust: the gain over no mismatch at all, as the test with shared errors sees it.
        alone: whether what stands on its channels tells steps apart and it acts within them, or the reverse.
    """

    candidate: Candidate
    fit: Fit
    gain: float
    robust: float
    alone: bool = False


def evidence(ranked: Ranked, surcharge: Surcharge) -> float:
    """What counts against the threshold: the gain over no mismatch, and enough over a mere pattern of pixels.

    The threshold is the largest gain that chance gives to as many amplitudes, so the first effect on a channel
    pays no price for them again, up to half of what it gains; and so does one that tells steps apart where those
    before it act within them, or the reverse: it is the first of its kind. Any other further one does, and more: it
    may live on what the first one's law does not quite say. As a picture over the pixels it must gain all of the
    threshold beside their free pattern. A search along a shape pays for its many looks, and so
    does what acts in one unit of several.
    """
    variant = ranked.candidate.term.variant
    amplitudes = min(sum(not p.per for p in variant.amplitudes()), FEW_AMPLITUDES)
    before = [] if ranked.alone else _before(ranked.fit.terms)
    picture = bool(before) and set(variant.drivers) <= PIXEL_COLUMNS
    sure = min(ranked.gain if picture else ranked.gain / PATTERN_ODDS, ranked.robust)
    if not before:
        sure += float(np.clip(0.5 * sure, 0.0, PRICE * amplitudes))
    else:
        alike = any(driven_by(term) & driven_by(ranked.fit.terms[-1]) for term in before)
        sure -= FURTHER if alike else FURTHER_APART
    return sure - surcharge.of(ranked.fit.terms[-1])


def is_as_good(ranked: Ranked, best: Ranked) -> bool:
    """Whether a candidate explains as much as the best one: of two that move edges, to what edges can tell.

    The light of a pixel at an edge is in error by the same in all steps: a test which allows for shared errors then
    counts much less than the likelihood says.
    """
    share = 1.0
    if best.gain > 0.0 and all(r.fit.terms[-1].effect.displaces for r in (ranked, best)):
        share = float(np.clip(best.robust / best.gain, LEAST_ROBUST, 1.0))
    return share * (best.gain - ranked.gain) < TWIN_GAIN


def _before(terms: Sequence[Term]) -> list[Term]:
    """Terms before the last that share a channel with it: of what moves means one of the means."""
    own = set(terms[-1].variant.channels)
    own = {name for name in own if not name.endswith("_std")} or own
    return [t for t in terms[:-1] if set(t.variant.channels) & own]


def acts_alone(problem: Problem, terms: Sequence[Term]) -> bool:
    """Whether all on the last term's channels tell steps apart where it acts within them, or the reverse."""
    bare = problem.view.fresh_state()
    own = forward([terms[-1]], problem.view)
    return all(act_apart(problem, bare, forward([term], problem.view), own) for term in _before(terms))


def is_repeat(base: Fit, candidate: Candidate) -> bool:
    """Whether an effect stands already on the same rows, by the same columns: its shape is all it could mend."""
    new = candidate.term
    return not new.effect.several and any(
        term.effect.id == new.effect.id
        and set(term.variant.channels) & set(new.variant.channels)
        and (new.effect.single or driven_by(term) <= driven_by(new) or driven_by(new) <= driven_by(term))
        and (term.unit == new.unit or not term.unit or not new.unit)
        and (_surfaces(term) & _surfaces(new) or not _surfaces(term) or not _surfaces(new))
        for term in base.terms
    )


def _surfaces(term: Term) -> set[str]:
    """Surfaces on which a term acts; empty for all."""
    return {name for name in str(term.variant.options.get("surface", "")).split(TOGETHER) if name}


def lacks_essential(ranked: Ranked) -> bool:
    """Whether a candidate is fitted without what makes its name: a parameter less than two errors from none."""
    place = next(
        (k for k, (index, p) in enumerate(ranked.fit.keys)
         if index == len(ranked.fit.terms) - 1 and p.name == ranked.fit.terms[-1].effect.essential), None
    )  # fmt: skip
    if place is None:
        return False
    variance = np.linalg.pinv(ranked.fit.jacobian.T @ ranked.fit.jacobian)[place, place]
    null = ranked.fit.keys[place][1].null or 0.0
    return bool((ranked.fit.values()[place] - null) ** 2 < ESSENTIAL_Z**2 * variance)


def is_rounding(problem: Problem, base: Fit, ranked: Ranked) -> bool:
    """Whether a candidate changes scatters only, and by less than rounding and few frames leave uncertain."""
    largest = 0.0
    for d in problem.data:
        name = d.channel.name
        if ranked.fit.state[name] is base.state[name]:
            continue
        change = np.abs(ranked.fit.state[name] - base.state[name])[d.use] / d.scale
        if d.channel.role is not Role.SCATTER and np.any(change > 1e-6):
            return False
        largest = max(largest, float(np.quantile(change, 0.95)))
    return largest < LEAST_SCATTER


def is_misfit(problem: Problem, base: Fit, ranked: Ranked, gains: Mapping[int, float]) -> bool:
    """Whether a further effect only mends the shape of one that is already there.

    No operator is exact. What it leaves has its own drivers and channels, and is small against what it explains.
    Two laws of the same drivers that undo each other draw a curve by their difference: neither is seen.
    """
    new = ranked.fit.terms[-1]
    if base.terms and _is_beyond_reach(new):
        return True
    if _mends_side_effects(problem, ranked) or _undoes(problem, ranked) or _worsens_own(problem, base, ranked):
        return True
    for index, term in enumerate(base.terms):
        if not set(term.variant.channels) & set(new.variant.channels) or _is_side(term, new):
            continue
        common = bool(driven_by(term) & driven_by(new))
        alike = common and not has_own_driver(problem, ranked.fit.terms, term)
        hidden = EXACT_SHARE if term.effect.exact else HIDDEN_SHARE
        least = (MISFIT_SHARE if alike else hidden) * gains.get(index, 0.0)
        another = new.effect.several and new.effect.id == term.effect.id
        apart = (not alike or another) and (
            acts_alone(problem, (base.terms[index], new)) or _stands_apart(problem, base, ranked, index)
        )
        clear = not common and min(ranked.gain, ranked.robust) > CLEAR_GAIN
        apart = apart and (
            ranked.gain > 0.1 * least or (clear and _grows_with(problem, base, ranked, index) < -STEADY_GAIN)
        )
        if ranked.gain < least and not apart:
            return True
        small = ranked.gain < MISFIT_SHARE * gains.get(index, 0.0)
        if small and not alike and mends_shape(problem, ranked.fit.terms, term):
            return True
    return False


def _is_beyond_reach(new: Term) -> bool:
    """Whether an effect's fit ends at the edge of what it can physically be: it stands for something else."""
    return any(
        edge != p.null and abs(float(new.values[p.name]) - edge) < AT_EDGE * (p.high - p.low)
        for p in new.variant.amplitudes()
        if not p.per
        for edge in (p.low, p.high)
    )


def _worsens_own(problem: Problem, base: Fit, ranked: Ranked) -> bool:
    """Whether a further effect agrees worse with its own channels, and mends what another one makes of these.

    Light that nobody measured mends the walk of a range with it, where the walk's law is not quite that.
    """
    if not base.terms:
        return False
    own = set(ranked.fit.terms[-1].variant.channels)
    moved = [d for d in problem.data if ranked.fit.state[d.channel.name] is not base.state[d.channel.name]]
    if all(d.channel.name in own for d in moved):
        return False
    gain = sum(
        d.fit_scatter(d.residual(ranked.fit.state))[0] - d.fit_scatter(d.residual(base.state))[0]
        for d in moved if d.channel.name in own
    )  # fmt: skip
    return gain < 0.0


def _is_side(term: Term, new: Term) -> bool:
    """Whether an effect moves the channels of another, which are scatters, on the side only."""
    return all(name.endswith("_std") for name in new.variant.channels) and not all(
        name.endswith("_std") for name in term.variant.channels
    )


def _undoes(problem: Problem, ranked: Ranked) -> bool:
    """Whether a further effect and one of the same drivers take back most of what the other does."""
    terms = ranked.fit.terms
    for index, term in enumerate(terms[:-1]):
        if driven_by(term) != driven_by(terms[-1]) or not set(term.variant.channels) & set(
            terms[-1].variant.channels
        ):
            continue
        alone = [
            problem.whiten_change(forward([t for t in terms if t is not other], problem.view), ranked.fit.state)
            for other in (terms[index], terms[-1])
        ]
        both = alone[0] + alone[1]
        if float(both @ both) < UNDONE * sum(float(change @ change) for change in alone):
            return True
    return False


def _mends_side_effects(problem: Problem, ranked: Ranked) -> bool:
    """Whether a further effect lives on scatters that effects before it moved on the side.

    How a noise follows a signal is read off the table: what that leaves there calls for no name of other channels,
    nor for one that is small beside it. Nor is an effect on means seen by scatters alone.
    """
    untouched, after = problem.view.fresh_state(), ranked.fit.state
    before = forward(ranked.fit.terms[:-1], problem.view)  # not the base: there scatters pull at what moves signals
    gains: dict[bool, float] = {True: 0.0, False: 0.0}
    moved, plain, largest, means = 0.0, False, 0.0, 0.0
    for d in problem.data:
        name = d.channel.name
        if np.array_equal(after[name], before[name], equal_nan=True):
            continue
        scatter = d.channel.role is Role.SCATTER
        plain |= not scatter
        old, new = (d.whiten(d.residual(state)) for state in (before, after))
        side = scatter and before[name] is not untouched[name]
        if scatter:
            gains[side] += 0.5 * float(old @ old - new @ new)
        else:
            means += d.fit_scatter(d.residual(after))[0] - d.fit_scatter(d.residual(before))[0]
        change = np.abs(after[name] - before[name])[d.use]
        share = change / np.maximum(np.abs(before[name][d.use]), _SMALLEST)
        largest = max(largest, float(np.quantile(share, 0.95)))
        if side:
            first = d.whiten(d.residual(untouched))
            moved += 0.5 * float(first @ first - old @ old)
    if plain and means < LEAST_MEANS * sum(gains.values()):  # of scatters so far
        return True
    gains[False] += means
    if gains[True] <= SIDE_SHARE * (gains[True] + max(gains[False], 0.0)):
        return False
    return plain or gains[True] < SIDE_SHARE * moved or largest < 2.0 * LEAST_SCATTER


def _stands_apart(problem: Problem, base: Fit, ranked: Ranked, index: int) -> bool:
    """Whether a further effect gains as much where an earlier one hardly acts: what mends its shape does not.

    Of what lies within a pixel a table knows little: where that is mixed, there is no row in which little is mixed.
    """
    view, terms = problem.view, ranked.fit.terms
    rest = forward([t for k, t in enumerate(base.terms) if k != index], view)
    size = np.concatenate([
        d.root_weight * np.abs(base.state[d.channel.name] - rest[d.channel.name])[d.use] for d in problem.data
    ])  # fmt: skip
    power = problem.whiten_change(forward(terms[:-1], view), ranked.fit.state) ** 2
    gain = 0.5 * (problem.whiten_state(base.state) ** 2 - problem.whiten_state(ranked.fit.state) ** 2)
    seen = power > 1e-9
    if not seen.any():
        return False
    least = STILL**2 if base.terms[index].effect.mixes else QUIET * float(np.mean(size[seen] ** 2))
    quiet = seen & (size**2 < least)
    share = float(power[quiet].sum() / power.sum())
    return share > QUIET and float(gain[quiet].sum()) > max(QUIET_GAIN, 0.5 * share * float(gain[seen].sum()))


def _grows_with(problem: Problem, base: Fit, ranked: Ranked, index: int) -> float:
    """Log-likelihood by which a further effect is rather as large in each row as an earlier one is there.

    What an earlier one's law does not quite say is, or is a function of that one's size. Light is compared by
    the share that the earlier one takes.
    """
    view, before = problem.view, forward(ranked.fit.terms[:-1], problem.view)
    rest = forward([t for k, t in enumerate(base.terms) if k != index], view)
    own, grown, bent = 0.0, 0.0, 0.0
    for d in problem.data:
        name = d.channel.name
        if ranked.fit.state[name] is before[name]:
            continue
        size, unit = (base.state[name] - rest[name])[d.use], np.ones(len(d.use))
        if d.channel.role is Role.INTENSITY:
            unit = np.abs(rest[name])[d.use]
            size = size / np.maximum(unit, _SMALLEST)
        size = size / max(float(np.max(np.abs(size))), _SMALLEST)
        change, left = (ranked.fit.state[name] - before[name])[d.use] * d.expect, d.whiten(d.residual(before))
        own += _told([d.whiten(change)], left)
        grown += _told([d.whiten(change * np.abs(size))], left)
        bent += _told([d.whiten(unit * size**power) for power in range(4)], left) - 4.0
    return max(grown, bent) - own


def _told(columns: Sequence[FloatArray], left: FloatArray) -> float:
    """Log-likelihood that a sum of columns takes from a whitened residual."""
    design = np.column_stack(columns)
    design = design / np.maximum(np.linalg.norm(design, axis=0), _SMALLEST)
    fitted = design @ np.linalg.lstsq(design, left, rcond=None)[0]
    return 0.5 * float(fitted @ fitted)
