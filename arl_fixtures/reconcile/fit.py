"""Joint fit of the parameters of several effects: damped least squares on whitened residuals, within bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import BoolArray, FloatArray
from arl_fixtures.reconcile.direct import FIRST_STEP, loss, refine, secant, undiminished
from arl_fixtures.reconcile.effect import Parameter, State
from arl_fixtures.reconcile.effects_surface import borders, mixed_rows
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.terms import Term, beside, forward

SHORT = 4
"""Rounds up to which a fit starts near its end."""
SHORT_STEP = 0.05
HALVINGS = 6
"""How often the start of a term is halved in search of one that explains anything."""
FEWEST_ROUNDS = 3
"""Rounds from which rough terms are refined by trials."""
MOVED, MOVED_FAR, KEPT_Z = 1.5, 5.0, 1.5
"""Standard errors by which a rough term moves a row of an edge, and to which what it leaves there is held back."""
WORTH = 2.0
"""Gain over null from which a rough term is refined."""


@dataclass(slots=True, kw_only=True)
class Fit:
    """Result of a fit.

    Attributes:
        terms: with fitted values.
        state: corrected simulation of the problem's rows.
        residual: whitened residual.
        jacobian: derivative of the corrected simulation, whitened, one column per free parameter.
        keys: (term index, parameter) of each column.
        log_likelihood: with the group scatters at their best (`finish` sets it).
    """

    terms: tuple[Term, ...]
    state: State
    residual: FloatArray
    jacobian: FloatArray
    keys: list[tuple[int, Parameter]]
    log_likelihood: float = -np.inf

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.residual @ self.residual)

    def values(self) -> FloatArray:
        """Free parameters in the order of `keys`."""
        return np.array([self.terms[index].values[p.name] for index, p in self.keys])


def free_keys(terms: Sequence[Term]) -> list[tuple[int, Parameter]]:
    """All plain parameters of all terms."""
    return [(index, p) for index, term in enumerate(terms) for p in term.free()]


def unit_step(p: Parameter) -> float:
    """Natural scale of a parameter."""
    return abs(p.typical) if p.is_amplitude else 0.1 * (p.high - p.low)


def with_vector(terms: Sequence[Term], keys: list[tuple[int, Parameter]], vector: FloatArray) -> tuple[Term, ...]:
    """Terms with the values of a vector."""
    values = [dict(term.values) for term in terms]
    for (index, p), x in zip(keys, vector, strict=True):
        values[index][p.name] = float(x)
    return tuple(term.with_values(v) for term, v in zip(terms, values, strict=True))


def jacobian_of(
    problem: Problem, terms: Sequence[Term], keys: list[tuple[int, Parameter]], state: State, step: float = 0.01
) -> FloatArray:
    """Numerical derivative, whitened, shape (stacked rows, parameters)."""
    columns = []
    vector = np.array([terms[index].values[p.name] for index, p in keys])
    tried: dict[int, Callable[[Term], State]] = {}
    for place, (index, p) in enumerate(keys):
        h = step * unit_step(p)
        if vector[place] + h > p.high:
            h = -h
        moved = vector.copy()
        moved[place] += h
        if index not in tried:
            tried[index] = beside([*terms[:index], *terms[index + 1 :]], terms[index], problem.view)
        columns.append(
            problem.whiten_change(state, tried[index](with_vector(terms, keys, moved)[index])) / h
        )  # fmt: skip
    return np.stack(columns, axis=1) if columns else np.zeros((sum(len(d.use) for d in problem.data), 0))


def fit(problem: Problem, terms: Sequence[Term], *, rounds: int = 12, tolerance: float = 0.02) -> Fit:
    """Least squares from the terms' present values; rough variants also by trials, see `direct`.

    Args:
        problem: rows, weights and scatters (kept as they are).
        terms: start.
        rounds: most Gauss-Newton steps.
        tolerance: stop when a step gains less log-likelihood than this.
    """
    keys = free_keys(terms)
    first = [(index, p) for index, p in keys if not p.last]
    if rounds >= FEWEST_ROUNDS and len(first) < len(keys):
        terms = _descend(problem, terms, first, rounds=rounds, tolerance=tolerance).terms
    found = _descend(problem, terms, keys, rounds=rounds, tolerance=tolerance)
    if rounds < FEWEST_ROUNDS or not any(term.variant.rough for term in terms):
        return found
    start = min((found.terms, tuple(terms)), key=lambda t: _left(problem, t, rough=True))  # a tangent may lead astray
    return _descend(problem, _by_trials(problem, start, rounds), keys, rounds=min(rounds, 4), tolerance=tolerance)


def steady_jacobian(problem: Problem, found: Fit) -> FloatArray:
    """The fit's Jacobian with secants for rough variants: what their intervals rest on."""
    jacobian = found.jacobian.copy()
    for place, (index, p) in enumerate(found.keys):
        if found.terms[index].variant.rough:
            jacobian[:, place] = _secant(problem, found, place, p)
    return jacobian


def _left(problem: Problem, terms: Sequence[Term], *, rough: bool) -> float:
    """Sum of squares that terms leave; for rough ones, whose strength outliers hide, of a loss that limits them."""
    if not rough:
        residual = problem.whiten_state(forward(terms, problem.view))
        return float(residual @ residual)
    with undiminished(problem):
        return float(np.sum(loss(problem.whiten_state(forward(terms, problem.view)))))


def _by_trials(problem: Problem, terms: tuple[Term, ...], rounds: int) -> tuple[Term, ...]:
    """Each rough term refined by steps that shrink, the others kept."""
    share = FIRST_STEP if rounds > SHORT else SHORT_STEP
    for index, term in enumerate(terms):
        if term.variant.rough:
            with undiminished(problem):
                terms = _refined(problem, terms, index, share)
    return terms


def _refined(problem: Problem, terms: tuple[Term, ...], index: int, share: float) -> tuple[Term, ...]:
    """One term refined; its amplitudes' first step is `share` of their size, at least of a twentieth typical."""
    free = terms[index].free()
    keys = [(index, p) for p in free]

    def gain(place: FloatArray) -> float:
        return -float(np.sum(loss(problem.whiten_state(forward(with_vector(terms, keys, place), problem.view)))))

    start = np.array([terms[index].values[p.name] for p in free])
    absent = np.array([x if p.null is None else p.null for x, p in zip(start, free, strict=True)])
    if gain(start) < gain(absent) + WORTH:
        return terms
    sizes = [abs(x - (p.null or 0.0)) / abs(p.typical) for x, p in zip(start, free, strict=True) if p.is_amplitude]
    size = max(*sizes, 0.05)
    scale = np.array([unit_step(p) * (size if p.is_amplitude else 0.3) * share for p in free])
    place = refine(gain, start, scale, np.array([p.low for p in free]), np.array([p.high for p in free]))
    return with_vector(terms, keys, place)


def _secant(problem: Problem, found: Fit, place: int, p: Parameter) -> FloatArray:
    vector = found.values()

    def moved(step: float) -> State | None:
        there = vector.copy()
        there[place] += step
        if not p.low <= there[place] <= p.high:
            return None
        return forward(with_vector(found.terms, found.keys, there), problem.view)

    return secant(problem, found.state, moved, 0.02 * unit_step(p))


def _descend(
    problem: Problem, terms: Sequence[Term], keys: list[tuple[int, Parameter]], *, rounds: int, tolerance: float
) -> Fit:
    """From the terms' values, along these parameters alone."""
    low = np.array([p.low for _, p in keys])
    high = np.array([p.high for _, p in keys])
    scale = np.array([unit_step(p) for _, p in keys])
    vector = np.array([terms[index].values[p.name] for index, p in keys])
    now = tuple(terms)
    state = forward(now, problem.view)
    residual = problem.whiten_state(state)
    jacobian = jacobian_of(problem, now, keys, state)
    damping = 1e-3
    for _ in range(rounds if keys else 0):
        gradient = (jacobian.T @ residual) * scale
        hessian = (jacobian.T @ jacobian) * np.outer(scale, scale)
        at_bound = ((vector <= low) & (gradient < 0)) | ((vector >= high) & (gradient > 0))
        free = ~at_bound & (np.diag(hessian) > 0)
        if not free.any():
            break
        gained = False
        gain = 0.0
        for _ in range(6):
            block = hessian[np.ix_(free, free)]
            block = block + np.diag(damping * np.diag(block) + 1e-9 * np.trace(block) / len(block))
            step = np.zeros(len(vector))
            step[free] = np.linalg.solve(block, gradient[free]) * scale[free]
            trial_vector = np.clip(vector + step, low, high)
            trial = with_vector(now, keys, trial_vector)
            trial_state = forward(trial, problem.view)
            trial_residual = problem.whiten_state(trial_state)
            gain = 0.5 * float(residual @ residual - trial_residual @ trial_residual)
            if gain > 0:
                gained = True
                break
            damping = max(damping, 1e-3) * 10.0
        if not gained:
            break
        vector, now, state, residual = trial_vector, trial, trial_state, trial_residual
        damping = max(damping / 10.0, 1e-6)
        if gain < tolerance:
            break
        jacobian = jacobian_of(problem, now, keys, state)
    return Fit(terms=now, state=state, residual=residual, jacobian=jacobian, keys=keys)


def hold_back_edges(problem: Problem, found: Fit) -> None:
    """Limit the weight of rows at edges that rough terms leave unexplained.

    Which ray has crossed an edge hangs on the last digits of angles and temperatures. Rows that a fifth more or less
    of a rough term would change, or that it changes much, and that still lie off are its own error: they must not
    call for another effect. Nor must rows that see two surfaces, of which a term changes one: by which part of the
    light that does is known from the neighbours only. Nor those of which a term says that the table does not tell.
    """
    _hold_back_mixed(problem, found)
    _hold_back_unsure(problem, found)
    rough = [k for k, term in enumerate(found.terms) if term.effect.displaces or term.variant.rough]
    if not rough:
        return
    states = [forward([t for k, t in enumerate(found.terms) if k not in rough], problem.view)]
    for factor in (0.8, 1.2):
        terms = list(found.terms)
        for index in rough:
            values = dict(terms[index].values)
            for p in terms[index].variant.amplitudes():
                null = p.null or 0.0
                values[p.name] = float(np.clip(null + factor * (values[p.name] - null), p.low, p.high))
            terms[index] = terms[index].with_values(values)
        states.append(forward(terms, problem.view))
    for d in problem.data:
        name, error = d.channel.name, d.stated * d.spread
        moved = [np.abs(state[name] - found.state[name])[d.use] / error for state in states]
        left = np.abs(d.residual(found.state)) / error
        held = ((moved[0] > MOVED_FAR) | (moved[1] > MOVED) | (moved[2] > MOVED)) & (left > KEPT_Z)
        _hold_back(d, held, left)


def _hold_back(d: ChannelData, held: BoolArray, left: FloatArray) -> None:
    """Limit the weight of some of a channel's rows to that of `KEPT_Z` standard errors; left: theirs, in these."""
    if held.any():
        d.trust = np.where(held, np.minimum(d.trust, (KEPT_Z / np.maximum(left, KEPT_Z)) ** 2), d.trust)
        d.rebuild(d.tau)


OF_SURFACES = {"incidence_deg", "surface", "reflectance"}
"""Columns by which an effect acts on one of the surfaces that share a pixel."""


def _hold_back_mixed(problem: Problem, found: Fit) -> None:
    """Limit the weight of rows that see several surfaces where terms that act on one of them leave much."""
    acting = [t for t in found.terms if t.effect.at_borders or OF_SURFACES & set(t.variant.drivers)]
    mixed = borders(problem.view) if any(t.effect.at_borders for t in acting) else mixed_rows(problem.view)
    if not acting or not mixed.any():
        return
    without = forward([t for t in found.terms if t not in acting], problem.view)
    for d in problem.data:
        name, error = d.channel.name, d.stated * d.spread
        moved = np.abs(without[name] - found.state[name])[d.use] / error > MOVED
        left = np.abs(d.residual(found.state)) / error
        held = mixed[d.use] & moved & (left > KEPT_Z)
        _hold_back(d, held, left)


def _hold_back_unsure(problem: Problem, found: Fit) -> None:
    """Limit the weight of rows that a term may move by what the table does not tell."""
    for term in found.terms:
        unsure = term.effect.unsure(term.variant, problem.view)
        if unsure is None:
            continue
        for d in problem.data:
            if d.channel.name in term.variant.channels:
                left = np.abs(d.residual(found.state)) / (d.stated * d.spread)
                _hold_back(d, unsure[d.use] & (left > KEPT_Z), left)


def within_reach(problem: Problem, others: Sequence[Term], term: Term) -> Term:
    """A term's start, its amplitudes halved until it does better than none: along a tangent a strong one overshoots.

    As it was where none does.
    """

    rough = term.variant.rough
    without = _left(problem, others, rough=rough)
    trial, amplitudes = term, {p.name: p.null or 0.0 for p in term.variant.amplitudes()}
    for halved in range(HALVINGS + 1):
        share = 0.5**halved
        trial = term.with_values({
            name: amplitudes[name] + share * (x - amplitudes[name]) if name in amplitudes else x
            for name, x in term.values.items()
        })  # fmt: skip
        if _left(problem, [*others, trial], rough=rough) < without:
            return trial
    return term


def finish(problem: Problem, found: Fit) -> Fit:
    """Set the likelihood with the group scatters at their best for this fit."""
    found.log_likelihood = problem.log_likelihood(found.state, lost=float(len(found.keys)))
    return found
