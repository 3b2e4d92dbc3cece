"""What a written model does to a table: its effects and laws from their files, and the corrected simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arl_fixtures.errors import ConfigError, DataError
from arl_fixtures.reconcile.boosting import Tree
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.ceilings import under_ceiling
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.derived_rays import derive_rays
from arl_fixtures.reconcile.effect import Parameter, State, Variant
from arl_fixtures.reconcile.effects_encoder import STAGE
from arl_fixtures.reconcile.features import category_id
from arl_fixtures.reconcile.law import Axis, Law, LawTerm
from arl_fixtures.reconcile.model_file import AnswerFile, AxisFile, EffectFile, FieldFile, ModelFile, unit_keys
from arl_fixtures.reconcile.play import play_of
from arl_fixtures.reconcile.range_answer import Answer
from arl_fixtures.reconcile.readings import smooth_readings
from arl_fixtures.reconcile.roles import MADE_OF, played
from arl_fixtures.reconcile.terms import Strengths, Term, forward
from arl_fixtures.reconcile.turned import features_for
from arl_fixtures.reconcile.view import View


def terms_of(model: ModelFile, view: View, path: Path) -> list[Term]:
    """The model's effects on a table.

    Raises:
        ConfigError: an effect is not in the library.
        DataError: the table lacks a column that an effect needs.
    """
    entries = library()
    if model.rays_derived:
        derive_rays(view.columns, known=True, lens=model.lens)
    smooth_readings(view.columns, model.smoothed)
    view.columns.sweep_gap_deg = np.inf if model.sweep_gap_deg is None else model.sweep_gap_deg
    view.columns.frame_gap_s = np.inf if model.frame_gap_s is None else model.frame_gap_s
    terms = []
    for item in model.effects:
        if item.effect not in entries:
            raise ConfigError(f"effect '{item.effect}' is not in the library", path=path)
        effect = entries[item.effect]
        missing = [c for c in item.drivers if not (view.has(c) or view.has(f"sim_{c}"))]
        if missing:
            raise DataError(f"the table lacks column '{missing[0]}', which drives {item.effect}")
        if item.channels and not any(view.has(f"sim_{c}") for c in item.channels):
            raise DataError(f"the table lacks column 'sim_{item.channels[0]}', which {item.effect} changes")
        variant = _variant_of(item)
        fields = {name: _levels_of(field) for name, field in item.fields.items()}
        column, unit = next(iter(item.only.items()), ("", ""))
        terms.append(
            Term(
                effect=effect,
                variant=variant,
                values=dict(item.values),
                fields=fields or None,
                unit=unit,
                unit_column=column,
                side=item.scatters,
                strengths=None if item.strengths is None else _strengths_of(item.strengths),
                answer=None if item.answer is None else _answer_of(item.answer),
            )
        )
    return terms


def _answer_of(item: AnswerFile) -> Answer:
    return Answer(distance=item.distance, signal=item.signal, light=tuple(item.light), range=tuple(item.range))


def _levels_of(field: FieldFile) -> dict[tuple[str, ...], float]:
    return {tuple(str(k) for k in row[:-1]): float(row[-1]) for row in field.levels}


def _strengths_of(field: FieldFile) -> Strengths:
    return Strengths(per=tuple(field.per), levels=_levels_of(field), errors={})


def _variant_of(item: EffectFile) -> Variant:
    """The variant as it was found: its references to the first table stand in its options."""
    parameters = tuple(
        Parameter(name=name, unit="1", low=-np.inf, high=np.inf, null=0.0, typical=1.0, per=tuple(field.per))
        for name, field in item.fields.items()
    )
    return Variant(
        effect=item.effect, parameters=parameters, channels=tuple(item.channels), drivers=tuple(item.drivers),
        options=dict(item.options),
    )  # fmt: skip


def laws_of(model: ModelFile) -> list[Law]:
    """The model's empirical laws."""
    laws = []
    for item in model.unknown:
        trees = item.trees
        laws.append(
            Law(
                channel=item.channel,
                relative=item.relative,
                drivers=list(item.drivers),
                terms=[
                    LawTerm(
                        axes=tuple(_axis_of(a) for a in t.functions), value=t.coefficient,
                        reach=np.inf if t.reach is None else t.reach,
                    )
                    for t in item.terms
                ],
                trees=[]
                if trees is None
                else [
                    Tree(tuple(f), tuple(c), np.array(v))
                    for f, c, v in zip(trees.features, trees.thresholds, trees.leaves, strict=True)
                ],
                binned_names=() if trees is None else tuple(trees.columns),
                edges=[] if trees is None else [np.array(e) for e in trees.edges],
                rate=0.2 if trees is None else trees.rate,
            )
        )
    return laws


def corrected_state(model: ModelFile, terms: list[Term], view: View) -> State:
    """Corrected simulation of a view: effects, laws, calibration constants.

    Raises:
        DataError: something that the model needs is neither in it nor in the table.
    """
    try:
        state = forward(terms, view)
    except KeyError as error:
        effects = ", ".join(sorted(t.effect.id for t in terms))
        raise DataError(f"{effects}: needs {error}, which neither model.yaml nor the table has") from None
    laws = [law for law in laws_of(model) if law.channel in state]
    if laws:
        features = features_for(view, laws)
        for law in laws:
            needed = {name for t in law.terms for a in t.axes for name in a.columns} | set(law.binned_names)
            needed |= {c for n in needed & set(MADE_OF) for c in MADE_OF[n]}
            needed |= {played(n) for n in needed if played(n)}
            needed |= {STAGE for t in law.terms if t.turns}
            missing = sorted(n for n in needed if n not in features and not n.startswith("~"))
            constant = {n: _single(view, n) for n in missing if view.has(n)}
            lacking = [n for n in missing if n not in constant]
            if lacking:
                raise DataError(
                    f"the table lacks column '{lacking[0]}', which drives the unknown effect on {law.channel}"
                )
            for n in (n for n in needed if played(n) and n not in features):
                # a temperature that never moved has taken up no play
                constant |= {n: np.zeros(view.n)} | play_of(view, played(n))
            state[law.channel] = state[law.channel] + law.correction({**features, **constant}, state[law.channel])
    for channel, constants in model.calibration.items():
        if channel in state:
            others = model.unseen_units.get(channel, 0.0)
            values = _constants_on_rows(model, constants, view, others)
            # as it was fitted: a gain of what the effects and laws make of the simulation
            state[channel] = state[channel] * (1.0 + values) if channel in model.relative else state[channel] + values
    for channel, zeros in model.zeros.items():
        if channel in state:
            mean = float(np.mean(list(zeros.values())))
            state[channel] = state[channel] + _constants_on_rows(model, zeros, view, mean)
    for channel, top in model.ceilings.items():
        if channel in state and state[channel] is not view.sim[channel]:
            state[channel] = under_ceiling(state[channel], view.sim[channel], top)
    return state


def _single(view: View, name: str) -> FloatArray:
    """A column that does not vary in this table, as a feature."""
    if name in view.columns.numbers:
        return view.number(name)
    codes, labels = view.codes(name)
    return np.array([*(category_id(label) for label in labels), np.nan])[codes]


def _constants_on_rows(model: ModelFile, constants: dict[str, float], view: View, others: float) -> FloatArray:
    """Constant of each row's unit; of `others` where a unit was not compared."""
    if not model.unit_columns:
        return np.full(view.n, constants.get("", 0.0))
    code, keys = unit_keys(view, tuple(model.unit_columns))
    values = [constants.get(key, 0.0 if key in model.units_seen else others) for key in keys]
    return np.asarray(np.array(values)[code])


def _axis_of(a: AxisFile) -> Axis:
    return Axis(
        column=a.column, kind=a.kind, middle=a.middle, width=a.width, at=a.at, beside=a.beside, lean=a.lean,
        label=a.label, edges=tuple(a.edges), values=tuple(a.values),
    )  # fmt: skip
