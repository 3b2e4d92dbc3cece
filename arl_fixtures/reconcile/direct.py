"""Search without derivatives, for effects whose likelihood jumps.

Where a pixel is sampled by a few sharp rays, a displacement changes nothing until a ray crosses an edge, and then one
row by many standard errors: a derivative sees either nothing or a single row. Such variants are marked `rough`; they
are tried at finite size, outwards from null along many directions, and refined by steps that shrink. The loss is
Student's: it counts rows that cross as predicted against rows that do not, so that one wrong crossing of a hundred
standard errors does not hide forty right ones.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effect import Parameter, State, Variant
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.terms import Term, beside

FREEDOM = 8.0
FIRST_SIZE, LAST_SIZE, RATIO, FINE_RATIO = 0.001, 140.0, 2.0, 1.25
"""Sizes tried along a direction, in typical amplitudes. A single amplitude has no other direction that could come
near its optimum: from the size on that changes anything visible its sizes are closer."""
SEEN = 4.0
"""Squared change (standard errors) from which a trial is visible."""
HOPELESS, HOPELESS_SHARE = 25.0, 0.02
"""A direction whose gain has fallen so far below its best is left: where much is wrong, by this share of the misfit,
as the first few rays may cross wrongly under a displacement of whole pixels."""
NOISE, WRONG = 0.45, 3.0
"""Mean of the loss of a unit variable, and how much more of it tells that all is wrong."""
HALVINGS, CROSSINGS = 5, 7
"""Times that the way to a direction's best is halved, and that to the first ray that crosses."""
FIRST_STEP, LAST_STEP = 0.35, 0.002
"""Steps of the refinement, as shares of the amplitude."""
MOST_TRIALS = 60
SECANT_TRIALS = 14
VISIBLE = 2.0
"""Change in standard errors that a secant of a rough parameter aims at: what an interval of 95 % rests on."""

Gain = Callable[[FloatArray], float]


def loss(z: FloatArray) -> FloatArray:
    """Student's negative log-likelihood of unit variables, z²/2 for small ones."""
    return np.asarray(0.5 * (FREEDOM + 1.0) * np.log1p(z * z / (FREEDOM + 1.0)))


@contextmanager
def undiminished(problem: Problem) -> Iterator[None]:
    """The problem with every row at its full weight, for a loss that is robust by itself.

    Rows at crossed edges pass for outliers and for patterns of pixels and angles until a displacement explains them.
    """
    kept = [(d, d.trust, d.tau) for d in problem.data]
    for d, _, tau in kept:
        d.trust = np.ones(len(d.use))
        d.rebuild({name: value for name, value in tau.items() if name == "step"})
    try:
        yield
    finally:
        for d, trust, tau in kept:
            d.trust = trust
            d.rebuild(tau)


def directions(count: int) -> FloatArray:
    """Unit vectors spread over a sphere, (k, count)."""
    if count == 1:
        return np.array([[1.0], [-1.0]])
    if count == 2:
        angle = np.arange(6) * (np.pi / 3.0)
        return np.column_stack([np.cos(angle), np.sin(angle)])
    grid = np.array(
        [p for p in itertools.product((-1.0, 0.0, 1.0), repeat=count) if np.count_nonzero(p) in (1, count)]
    )
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))


def values_at(variant: Variant, shapes: dict[str, float], place: FloatArray) -> dict[str, float]:
    """Parameter values at a place in typical amplitudes from null."""
    values = dict(shapes)
    for p, x in zip(variant.amplitudes(), place, strict=True):
        values[p.name] = float(np.clip((p.null or 0.0) + x * p.typical, p.low, p.high))
    return values


Trial = tuple[dict[str, float], FloatArray, FloatArray]
"""Values, whitened change, gain of each unit and (last) of all together by Student's loss."""


def outwards(
    problem: Problem,
    others: Sequence[Term],
    base: State,
    term: Term,
    shapes: Sequence[dict[str, float]],
    unit: IntArray,
    units: int,
) -> Iterator[Trial]:
    """Finite trials of a rough variant along each direction, until it is hopeless for all units, and about the best.

    The gain along a direction rises while rays cross edges as measured, and falls beyond.
    """
    residual = problem.whiten_state(base)
    before = loss(residual)
    hopeless = max(HOPELESS, HOPELESS_SHARE * (float(np.sum(before)) - NOISE * len(before)))
    if float(np.mean(before)) > WRONG * NOISE:
        hopeless = np.inf  # far off, a scene of stripes fits again and again on the way
    amplitudes = term.variant.amplitudes()
    tried = beside(others, term, problem.view)

    def trials(shape: dict[str, float], direction: FloatArray) -> Callable[[float], Trial]:
        def trial(size: float) -> Trial:
            values = values_at(term.variant, shape, size * direction)
            change = problem.whiten_change(base, tried(term.with_values(values)))
            gains = np.bincount(unit, before - loss(residual - change), minlength=units)[:units]
            return values, change, np.append(gains, gains.sum())

        return trial

    ratio = FINE_RATIO if len(amplitudes) == 1 else RATIO
    start = FIRST_SIZE  # then where the direction before was not seen yet: most of what is smaller is not either
    for shape in shapes:
        for direction in directions(len(amplitudes)):
            if not any(_beyond(p, x) for p, x in zip(amplitudes, direction, strict=True)):
                start = yield from _along(trials(shape, direction), units, ratio, hopeless, start)


def _along(
    trial: Callable[[float], Trial], units: int, ratio: float, hopeless: float, start: float
) -> Generator[Trial, None, float]:
    """Trials of growing size, from `start` or less; returns a size from which to start along the next direction."""
    best, at = np.zeros(units + 1), np.zeros(units + 1)
    while start > FIRST_SIZE and _is_seen(trial(start)):
        start /= RATIO
    size, step, unseen = start, RATIO, 0.0
    while size <= LAST_SIZE:
        found = trial(size)
        yield found
        seen = _is_seen(found)
        if step == RATIO and not seen:
            start = size
        if step > ratio and seen:
            size, step = size * ratio / step, ratio  # back to where it was not seen yet
            continue
        gains = found[2]
        at, best = np.where(gains > best, size, at), np.maximum(gains, best)
        if seen and step < RATIO and unseen > 0.0:
            for least, crossed in _first_crossings(trial, unseen, size):  # several rays may have crossed at once
                yield crossed
                at, best = np.where(crossed[2] > best, least, at), np.maximum(crossed[2], best)
        unseen = 0.0 if seen else size
        if np.all(gains < best - hopeless):
            break
        size *= step
    first = int(np.argmax(best))
    if best[first] <= 0.0:
        return start
    for inner, outer in ((at[first], at[first] * step), (at[first], at[first] / step)):
        good, bad = float(inner), float(outer)
        for _ in range(HALVINGS):
            middle = float(np.sqrt(good * bad))
            found = trial(middle)
            yield found
            if found[2][first] >= best[first]:
                good, best[first] = middle, found[2][first]
            else:
                bad = middle
    return start


def _is_seen(trial: Trial) -> bool:
    return float(trial[1] @ trial[1]) > SEEN


def _first_crossings(trial: Callable[[float], Trial], unseen: float, seen: float) -> Iterator[tuple[float, Trial]]:
    """Sizes, halved towards the least that changes anything visible, and their trials."""
    for _ in range(CROSSINGS):
        middle = float(np.sqrt(unseen * seen))
        found = trial(middle)
        yield middle, found
        if _is_seen(found):
            seen = middle
        else:
            unseen = middle


def _beyond(p: Parameter, x: float) -> bool:
    """Whether a direction leaves a one-sided parameter's range at once."""
    null = p.null or 0.0
    return (x * p.typical < 0 and p.low >= null) or (x * p.typical > 0 and p.high <= null)


def refine(gain: Gain, start: FloatArray, scale: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Place of largest gain near a start: steps along the axes and the last success, halved where none helps.

    Args:
        gain: of a place.
        start: (k,).
        scale: first step of each coordinate.
        low, high: bounds.
    """
    best, here = start, gain(start)
    step, trials = 1.0, 0
    moves = [sign * axis for axis in np.eye(len(start)) for sign in (1.0, -1.0)]
    if len(start) == 2:
        moves += [np.array([a, b]) for a in (1.0, -1.0) for b in (1.0, -1.0)]
    last: FloatArray | None = None
    while step > LAST_STEP / FIRST_STEP and trials < MOST_TRIALS:
        found: tuple[float, FloatArray, FloatArray] | None = None
        for move in ([last] if last is not None else []) + moves:
            place = np.clip(best + step * scale * move, low, high)
            if np.array_equal(place, best):
                continue
            value, trials = gain(place), trials + 1
            if value > here + 1e-9 and (found is None or value > found[0]):
                found = value, place, move
                if move is last:
                    break
        if found is None:
            step, last = 0.5 * step, None
        else:
            here, best, last = found
    return best


def secant(problem: Problem, state: State, moved: Callable[[float], State | None], start: float) -> FloatArray:
    """Whitened change per unit of a rough parameter, over the step that changes about `VISIBLE` standard errors.

    Where a single ray changes more at once, the step is that to the ray's crossing. Of both directions the longer.

    Args:
        problem: rows and weights.
        state: at the parameter's value.
        moved: state with the parameter moved by a step; None beyond its bounds.
        start: first step tried.
    """
    widest: tuple[float, FloatArray] | None = None
    for sign in (1.0, -1.0):
        below, above, step = 0.0, np.inf, start
        change: FloatArray | None = None
        for _ in range(SECANT_TRIALS):
            there = moved(sign * step)
            if there is None:
                above = step
            else:
                seen = problem.whiten_change(state, there)
                length = float(np.sqrt(seen @ seen))
                if length < VISIBLE:
                    below = step
                else:
                    above = step
                if length > 0.0:
                    change = seen * (VISIBLE / length)
                if 0.8 * VISIBLE < length < 1.2 * VISIBLE:
                    break
            step = 4.0 * step if np.isinf(above) else 0.25 * step if below == 0.0 else float(np.sqrt(below * above))
        if change is not None and (widest is None or step > widest[0]):
            widest = step, change / (sign * step)
    return np.zeros(len(problem.whiten_state(state))) if widest is None else widest[1]
