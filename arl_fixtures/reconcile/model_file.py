"""`model.yaml`: the effects found, read by `arl predict` and by the simulation that runs with them switched on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator
from ruamel.yaml import YAML

from arl_fixtures.reconcile.columns import IntArray
from arl_fixtures.reconcile.diagnosis import Diagnosis
from arl_fixtures.reconcile.law import Axis, Law
from arl_fixtures.reconcile.range_answer import Answer
from arl_fixtures.reconcile.side_scatter import Side
from arl_fixtures.reconcile.terms import Term, field_keys
from arl_fixtures.reconcile.view import View
from arl_fixtures.yaml_model import FileModel, load_model

Scalar = str | int | float | bool


class FieldFile(FileModel):
    """A free pattern: one value per level of some columns."""

    per: list[str]
    levels: list[list[str | float]]


class AnswerFile(FileModel):
    """What a distance answers to the light that an effect changes: a curve over the signal's natural logarithm."""

    distance: str
    signal: str
    light: list[float] = Field(min_length=2)
    range: list[float]

    @model_validator(mode="after")
    def _is_curve(self) -> Self:
        if len(self.range) != len(self.light):
            raise ValueError(f"{len(self.light)} points of the light have {len(self.range)} of the range")
        if any(b <= a for a, b in pairwise(self.light)):
            raise ValueError("the light of a curve does not ascend")
        return self


class EffectFile(FileModel):
    """One effect with its choices and values; `channels` and `drivers` are for the reader.

    `strengths`: how much of it each unit shows, where units differ; 1 for others.
    """

    effect: str
    options: dict[str, Scalar] = Field(default_factory=dict)
    values: dict[str, float] = Field(default_factory=dict)
    only: dict[str, str] = Field(default_factory=dict)
    scatters: Side = Side.OWN
    channels: list[str] = Field(default_factory=list)
    drivers: list[str] = Field(default_factory=list)
    fields: dict[str, FieldFile] = Field(default_factory=dict)
    strengths: FieldFile | None = None
    answer: AnswerFile | None = None


class AxisFile(FileModel):
    """A function of one column, or of one that leans on another."""

    column: str
    kind: str
    middle: float = 0.0
    width: float = 1.0
    at: float = 0.0
    beside: str = ""
    lean: float = 0.0
    label: str = ""
    edges: list[float] = Field(default_factory=list)
    values: list[float] = Field(default_factory=list)

    @model_validator(mode="after")
    def _has_edges(self) -> Self:
        if self.kind in {"band", "bit"} and len(self.edges) != 2:
            raise ValueError(f"a function of the kind {self.kind!r} has two edges, not {len(self.edges)}")
        return self


class LawTermFile(FileModel):
    """Coefficient times a product of functions."""

    coefficient: float
    functions: list[AxisFile]
    reach: float | None = None


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
    fields = {name: _field_file(per[name], levels) for name, levels in (term.fields or {}).items()}
    each = None if term.strengths is None else _field_file(term.strengths.per, term.strengths.levels)
    return EffectFile(
        effect=term.effect.id, options=dict(term.variant.options), values=term.values, fields=fields, strengths=each,
        only={term.unit_column: term.unit} if term.unit else {}, channels=list(term.variant.channels),
        drivers=list(term.variant.drivers), scatters=term.side, answer=_answer_file(term.answer),
    )  # fmt: skip


def _answer_file(answer: Answer | None) -> AnswerFile | None:
    if answer is None:
        return None
    return AnswerFile(
        distance=answer.distance, signal=answer.signal, light=list(answer.light), range=list(answer.range)
    )


def _field_file(per: tuple[str, ...], levels: dict[tuple[str, ...], float]) -> FieldFile:
    return FieldFile(per=list(per), levels=[[*key, float(value)] for key, value in levels.items()])


def _axis_file(a: Axis) -> AxisFile:
    return AxisFile(
        column=a.column, kind=a.kind, middle=a.middle, width=a.width, at=a.at, beside=a.beside, lean=a.lean,
        label=a.label, edges=list(a.edges), values=list(a.values),
    )  # fmt: skip


def _law_file(law: Law) -> LawFile:
    terms = [
        LawTermFile(
            coefficient=t.value,
            functions=[_axis_file(a) for a in t.axes],
            reach=t.reach if np.isfinite(t.reach) else None,
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


def unit_keys(view: View, unit_columns: tuple[str, ...]) -> tuple[IntArray, list[str]]:
    """Code of the calibration unit of each row, and the text of each code."""
    code, keys = field_keys(unit_columns, view)
    return code, ["|".join(key) for key in keys]
