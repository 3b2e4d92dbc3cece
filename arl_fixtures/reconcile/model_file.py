"""`model.yaml`: the effects found, read by `arl predict` and by the simulation that runs with them switched on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ConfigDict, Field
from ruamel.yaml import YAML

from arl_fixtures.errors import ConfigError, DataError
from arl_fixtures.reconcile.boosting import Tree
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.ceilings import under_ceiling
from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.derived_rays import derive_rays
from arl_fixtures.reconcile.diagnosis import Diagnosis
from arl_fixtures.reconcile.effect import Parameter, State, Variant
from arl_fixtures.reconcile.features import category_id, features_of
from arl_fixtures.reconcile.law import Axis, Law, LawTerm
from arl_fixtures.reconcile.readings import smooth_readings
from arl_fixtures.reconcile.roles import MADE_OF
from arl_fixtures.reconcile.side_scatter import Side
from arl_fixtures.reconcile.terms import Term, field_keys, forward
from arl_fixtures.reconcile.view import View
from arl_fixtures.yaml_model import FileModel, load_model

Scalar = str | int | float | bool


class FieldFile(FileModel):
    """A free pattern: one value per level of some columns."""

    per: list[str]
    levels: list[list[str | float]]


class EffectFile(FileModel):
    """One effect with its choices and values; `channels` and `drivers` are for the reader."""

    effect: str
    options: dict[str, Scalar] = Field(default_factory=dict)
    values: dict[str, float] = Field(default_factory=dict)
    only: dict[str, str] = Field(default_factory=dict)
    scatters: Side = Side.OWN
    channels: list[str] = Field(default_factory=list)
    drivers: list[str] = Field(default_factory=list)
    fields: dict[str, FieldFile] = Field(default_factory=dict)


class AxisFile(FileModel):
    """A function of one column."""

    column: str
    kind: str
    middle: float = 0.0
    width: float = 1.0
    at: float = 0.0
    label: str = ""
    edges: list[float] = Field(default_factory=list)
    values: list[float] = Field(default_factory=list)


class LawTermFile(FileModel):
    """Coefficient times a product of functions."""

    coefficient: float
    functions: list[AxisFile]


class TreesFile(FileModel):
    """Boosted symmetric trees on binned columns."""

    columns: list[str]
    edges: list[list[float]]
    rate: float
    features: list[list[int]]
    thresholds: list[list[int]]
    leaves: list[list[float]]


class LawFile(FileModel):
    """An empirical law of an unknown effect."""

    channel: str
    relative: bool
    expression: str
    drivers: list[str]
    terms: list[LawTermFile]
    trees: TreesFile | None = None


class ModelFile(FileModel):
    """All of `model.yaml`."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True, populate_by_name=True)

    schema_: Literal["arl-model/1"] = Field(default="arl-model/1", alias="schema")
    unit_columns: list[str] = Field(default_factory=list)
    effects: list[EffectFile] = Field(default_factory=list)
    unknown: list[LawFile] = Field(default_factory=list)
    calibration: dict[str, dict[str, float]] = Field(default_factory=dict)
    zeros: dict[str, dict[str, float]] = Field(default_factory=dict)
    lines: dict[str, dict[str, tuple[float, float]]] = Field(default_factory=dict)
    units_seen: list[str] = Field(default_factory=list)
    unseen_units: dict[str, float] = Field(default_factory=dict)
    relative: list[str] = Field(default_factory=list)
    ceilings: dict[str, float] = Field(default_factory=dict)
    rays_derived: bool = False
    lens: dict[str, float] = Field(default_factory=dict)
    smoothed: list[str] = Field(default_factory=list)
    sweep_gap_deg: float | None = None
    frame_gap_s: float | None = None


def model_of(
    diagnosis: Diagnosis, unit_columns: tuple[str, ...], relative: tuple[str, ...], gaps: tuple[float, float],
    ceilings: Mapping[str, float] | None = None, units: tuple[list[str], dict[str, float]] | None = None,
    *, rays_derived: bool = False, lens: Mapping[str, float] | None = None, smoothed: Sequence[str] = (),
    zeros: Mapping[str, dict[str, float]] | None = None,
    lines: Mapping[str, dict[str, tuple[float, float]]] | None = None,
) -> ModelFile:  # fmt: skip
    """What to write for a diagnosis.

    Args:
        diagnosis: with terms and laws.
        unit_columns: columns whose levels the calibration constants belong to.
        relative: channels whose constant is a gain.
        gaps: how far apart neighbours in the sweep (degrees) and in time (seconds) may lie.
        ceilings: ends of channels' scales.
        units: those that were compared, and by channel the constant of others.
        rays_derived: whether the rays' directions, which the table did not give, were taken from its simulation.
        lens: of the camera that a sweep showed; the nominal bench's where empty.
        smoothed: temperatures that effects saw without their loggers' noise.
        zeros: of signals, by channel and unit, beside their gains.
        lines: gain less one and zero that bring the simulation to each unit, by channel and unit.
    """
    return ModelFile(
        unit_columns=list(unit_columns),
        effects=[_effect_file(term) for f in diagnosis.findings for term in f.terms],
        unknown=[_law_file(f.law) for f in diagnosis.findings if f.law is not None],
        calibration=diagnosis.constants,
        zeros=dict(zeros or {}),
        lines=dict(lines or {}),
        units_seen=units[0] if units else [],
        unseen_units=units[1] if units else {},
        relative=list(relative),
        ceilings=dict(ceilings or {}),
        rays_derived=rays_derived,
        lens=dict(lens or {}),
        smoothed=list(smoothed),
        sweep_gap_deg=gaps[0] if np.isfinite(gaps[0]) else None,
        frame_gap_s=gaps[1] if np.isfinite(gaps[1]) else None,
    )


def _effect_file(term: Term) -> EffectFile:
    per = {p.name: p.per for p in term.variant.parameters if p.per}
    fields = {
        name: FieldFile(per=list(per[name]), levels=[[*key, float(value)] for key, value in levels.items()])
        for name, levels in (term.fields or {}).items()
    }
    return EffectFile(
        effect=term.effect.id, options=dict(term.variant.options), values=term.values, fields=fields,
        only={term.unit_column: term.unit} if term.unit else {}, channels=list(term.variant.channels),
        drivers=list(term.variant.drivers), scatters=term.side,
    )  # fmt: skip


def _axis_file(a: Axis) -> AxisFile:
    return AxisFile(
        column=a.column, kind=a.kind, middle=a.middle, width=a.width, at=a.at, label=a.label, edges=list(a.edges),
        values=list(a.values),
    )  # fmt: skip


def _axis_of(a: AxisFile) -> Axis:
    return Axis(
        column=a.column, kind=a.kind, middle=a.middle, width=a.width, at=a.at, label=a.label, edges=tuple(a.edges),
        values=tuple(a.values),
    )  # fmt: skip


def _law_file(law: Law) -> LawFile:
    terms = [
        LawTermFile(
            coefficient=t.value,
            functions=[_axis_file(a) for a in t.axes],
        )
        for t in law.terms
    ]
    trees = None
    if law.trees:
        trees = TreesFile(
            columns=list(law.binned_names), edges=[e.tolist() for e in law.edges], rate=law.rate,
            features=[list(t.features) for t in law.trees], thresholds=[list(t.thresholds) for t in law.trees],
            leaves=[t.values.tolist() for t in law.trees],
        )  # fmt: skip
    return LawFile(
        channel=law.channel, relative=law.relative, expression=law.expression, drivers=law.drivers, terms=terms,
        trees=trees,
    )  # fmt: skip


def write_model(path: Path, model: ModelFile) -> None:
    """Write YAML."""
    yaml = YAML()
    yaml.width = 118
    with path.open("w", encoding="utf-8") as stream:
        yaml.dump(model.model_dump(mode="json", by_alias=True), stream)


def read_model(path: Path) -> ModelFile:
    """Read `model.yaml`.

    Raises:
        ConfigError: it is not there or not in the form.
    """
    return load_model(path, ModelFile)


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
        fields = {
            name: {tuple(str(k) for k in row[:-1]): float(row[-1]) for row in field.levels}
            for name, field in item.fields.items()
        }
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
            )
        )
    return terms


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
                    LawTerm(axes=tuple(_axis_of(a) for a in t.functions), value=t.coefficient) for t in item.terms
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
        features = features_of(view)
        for law in laws:
            needed = {a.column for t in law.terms for a in t.axes if a.column} | set(law.binned_names)
            needed |= {c for n in needed & set(MADE_OF) for c in MADE_OF[n]}
            missing = sorted(n for n in needed if n not in features and not n.startswith("~"))
            constant = {n: _single(view, n) for n in missing if view.has(n)}
            lacking = [n for n in missing if n not in constant]
            if lacking:
                raise DataError(
                    f"the table lacks column '{lacking[0]}', which drives the unknown effect on {law.channel}"
                )
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


def unit_keys(view: View, unit_columns: tuple[str, ...]) -> tuple[IntArray, list[str]]:
    """Code of the calibration unit of each row, and the text of each code."""
    code, keys = field_keys(unit_columns, view)
    return code, ["|".join(key) for key in keys]
