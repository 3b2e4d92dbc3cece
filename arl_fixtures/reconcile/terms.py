"""An effect that is switched on with values, and the chain of such terms from the simulation to its correction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arl_fixtures.reconcile.columns import IntArray
from arl_fixtures.reconcile.effect import Effect, FloatArray, Parameter, State, Variant
from arl_fixtures.reconcile.range_answer import Answer
from arl_fixtures.reconcile.side_scatter import Side, with_scatters
from arl_fixtures.reconcile.view import View


@dataclass(frozen=True, slots=True, kw_only=True)
class Strengths:
    """How much of what an effect does each unit shows, over what all show together: two lasers do not age alike.

    Attributes:
        per: columns that make a unit.
        levels: factor by unit; units never seen have 1.
        errors: standard error of each; empty where read from a file.
    """

    per: tuple[str, ...]
    levels: dict[tuple[str, ...], float]
    errors: dict[tuple[str, ...], float]

    def named(self) -> dict[str, tuple[float, float]]:
        """Factor and its standard error by a unit's name."""
        return {"|".join(key): (value, self.errors[key]) for key, value in self.levels.items()}

    def on_rows(self, view: View) -> FloatArray:
        """The factor of every row of a view."""
        inverse, keys = field_keys(self.per, view)
        return np.array([self.levels.get(key, 1.0) for key in keys], dtype=np.float64)[inverse]


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One effect with its values.

    Attributes:
        effect: library entry.
        variant: how it acts in this table.
        values: parameter name to value (fields excluded).
        unit: label of the only unit (DUT) it acts on; empty for all.
        unit_column: the category column of `unit`.
        fields: name of a field parameter to its values by level key.
        side: how scatters go along with what the effect does to means.
        strengths: in which units it does more or less; None where all are alike.
        answer: what a distance answers to the light that the effect changes; None where it does not.
    """

    effect: Effect
    variant: Variant
    values: dict[str, float]
    unit: str = ""
    unit_column: str = ""
    fields: dict[str, dict[tuple[str, ...], float]] | None = None
    side: Side = Side.OWN
    strengths: Strengths | None = None
    answer: Answer | None = None

    @property
    def label(self) -> str:
        """The variant's label, with the unit where it is restricted."""
        return self.variant.label + (f"@{self.unit_column}={self.unit}" if self.unit else "")

    def free(self) -> tuple[Parameter, ...]:
        """Parameters that are plain numbers."""
        return tuple(p for p in self.variant.parameters if not p.per)

    def with_values(self, values: dict[str, float]) -> Term:
        """The same term with other values."""
        return replace(self, values=dict(values))

    def values_on(self, view: View) -> dict[str, float | FloatArray]:
        """All values, those of a field on every row."""
        values: dict[str, float | FloatArray] = dict(self.values)
        for name, levels in (self.fields or {}).items():
            parameter = next(p for p in self.variant.parameters if p.name == name)
            values[name] = field_on_rows(levels, parameter, view)
        return values

    def apply(self, state: State, view: View) -> State:
        """New state after this term; arrays that the term does not touch are shared."""
        after = dict(state)
        values = self.values_on(view)
        with np.errstate(all="ignore"):
            self.effect.apply(self.variant, values, after, view)
            after = with_scatters(self.side, state, after, view)
            if self.answer is not None:
                self.answer.to(state, after)
        inside = view.selects(self.unit_column, self.unit) if self.unit else None
        share = None if self.strengths is None else self.strengths.on_rows(view)
        for name, old in state.items():
            new = after[name]
            if new is old:
                continue
            if share is not None:
                new = after[name] = old + share * (new - old)
            good = np.isfinite(new)
            if inside is None and good.all():
                continue
            if inside is not None:
                good &= inside
            after[name] = np.where(good | ~np.isfinite(old), new, old) if inside is None else np.where(good, new, old)
        return after


def default_values(variant: Variant, *, amplitude: float = 0.0) -> dict[str, float]:
    """Shapes at their first start, amplitudes at `amplitude` of their typical size from null."""
    values = {}
    for p in variant.parameters:
        if p.per:
            continue
        values[p.name] = p.starts[0] if p.null is None else _inside(p, p.null + amplitude * p.typical)
    return values


def _inside(p: Parameter, value: float) -> float:
    return min(max(value, p.low), p.high)


def forward(terms: Sequence[Term], view: View) -> State:
    """Corrected simulation of the view's rows: all terms in the order of their stages."""
    state = view.fresh_state()
    for term in sorted(terms, key=_order):
        state = term.apply(state, view)
    return state


def beside(others: Sequence[Term], term: Term, view: View) -> Callable[[Term], State]:
    """`forward` of others and a term that is tried with many values: what acts before it is worked out once."""
    before = forward([t for t in others if _order(t) <= _order(term)], view)
    later = sorted((t for t in others if _order(t) > _order(term)), key=_order)

    def tried(trial: Term) -> State:
        state = trial.apply(before, view)
        for other in later:
            state = other.apply(state, view)
        return state

    return tried


def _order(term: Term) -> tuple[int, str]:
    return term.effect.stage, term.label


def field_keys(per: tuple[str, ...], view: View) -> tuple[IntArray, list[tuple[str, ...]]]:
    """Level code of each row for the columns of a field parameter, and the key of each level; once for a view."""
    memo = view.memo
    if ("field keys", per) not in memo:
        memo["field keys", per] = _field_keys(per, view)
    found: tuple[IntArray, list[tuple[str, ...]]] = memo["field keys", per]
    return found


def _field_keys(per: tuple[str, ...], view: View) -> tuple[IntArray, list[tuple[str, ...]]]:
    code = view.group(*per)
    present, first, inverse = np.unique(code, return_index=True, return_inverse=True)
    keys: list[tuple[str, ...]] = []
    for row in first[: len(present)]:
        key = []
        for name in per:
            if view.is_category(name):
                codes, labels = view.codes(name)
                key.append(labels[codes[row]] if codes[row] >= 0 else "")
            elif view.has(name):
                key.append(f"{view.number(name)[row]:g}")
            else:
                key.append("")
        keys.append(tuple(key))
    return inverse.astype(np.int64), keys


RECORD_TIME = ("cycle", "step")
"""Columns that order what happens to a pixel: what it has come to in one it keeps in the next ones."""


def field_on_rows(levels: dict[tuple[str, ...], float], parameter: Parameter, view: View) -> FloatArray:
    """A field's values on the rows of a view; null where the level is not known.

    What a pixel has come to in one cycle (and step) it keeps in the next ones, also in those never seen.
    """
    inverse, keys = field_keys(parameter.per, view)
    null = parameter.null if parameter.null is not None else 0.0
    times = sum(name in RECORD_TIME for name in parameter.per)
    since: dict[tuple[str, ...], list[tuple[tuple[float, ...], float]]] = {}
    if times and parameter.per[:times] == tuple(name for name in RECORD_TIME if name in parameter.per):
        for key, value in levels.items():
            since.setdefault(key[times:], []).append((moment_of(key[:times]), value))

    def value_of(key: tuple[str, ...]) -> float:
        if key in levels or key[times:] not in since:
            return levels.get(key, null)
        now = moment_of(key[:times])
        earlier = [(moment, value) for moment, value in since[key[times:]] if moment < now]
        return max(earlier)[1] if earlier else null

    by_level = np.array([value_of(key) for key in keys], dtype=np.float64)
    return np.asarray(by_level[inverse])


def moment_of(key: tuple[str, ...]) -> tuple[float, ...]:
    """Cycle and step of a level, in order."""
    return tuple(float(part) if part not in ("", "nan") else 0.0 for part in key)
