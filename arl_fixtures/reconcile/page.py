"""`diagnosis.html`: the diagnosis for a person, in one file that needs nothing else.

Whatever comes from the table (column names, serial numbers, categories) is text from outside: the template escapes
all of it, and the pictures are made of escaped text only. See `page_rows` for the rows that the pictures show.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from arl_fixtures.reconcile import page_words as words
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.decide import Decision
from arl_fixtures.reconcile.diagnosis import ChannelFit, Diagnosis, Finding
from arl_fixtures.reconcile.effect import Kind, State
from arl_fixtures.reconcile.held_out import mean_square
from arl_fixtures.reconcile.page_data import Mismatch
from arl_fixtures.reconcile.page_figures import bars
from arl_fixtures.reconcile.page_parts import (
    block_names,
    held_back,
    level_text,
    misfit_of_fold,
    outliers,
    rays_of,
    size_text,
)
from arl_fixtures.reconcile.page_pictures import Gallery
from arl_fixtures.reconcile.page_rows import shown_rows
from arl_fixtures.reconcile.problem import FOLDS
from arl_fixtures.reconcile.terms import forward
from arl_fixtures.reconcile.view import View

NAMED_BLOCKS = 4
"""Blocks of a fold that are named."""

LEAST_CONSTANT = 1e-4
"""Share of a row's noise below which a unit's constant is not listed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutPart:
    """One fold: which blocks were held out, and the mean square mismatch there."""

    blocks: str
    before: str
    after: str


def write_page(path: Path, diagnosis: Diagnosis, decision: Decision, *, pictured: Diagnosis | None = None) -> None:
    """Write `diagnosis.html`.

    Args:
        path: file to write.
        diagnosis: what is said.
        decision: of the search that made it, with the rows and simulated values that the pictures show.
        pictured: the same by the names under which columns were read, where these are others.
    """
    path.write_text(page_of(diagnosis, decision, pictured=pictured), encoding="utf-8")


def page_of(diagnosis: Diagnosis, decision: Decision, *, pictured: Diagnosis | None = None) -> str:
    """The page's HTML; the same diagnosis gives the same text."""
    environment = Environment(
        loader=PackageLoader("arl_fixtures.reconcile", "templates"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    maker = _Maker(diagnosis, decision)
    gallery = Gallery((pictured or diagnosis).findings, decision.found, maker.shown.problem.view)
    return environment.get_template("diagnosis.html.j2").render(
        d=diagnosis, words=words, headline=words.headline(diagnosis), chance=words.chance(diagnosis),
        matters=maker.matters(), constants=maker.constants(), facts=maker.facts(),
        findings=[maker.finding(f) for f in diagnosis.findings],
        places=[gallery.place(m) for m in maker.pictured], fresh=maker.shown.fresh, unseen=maker.unseen(),
    )  # fmt: skip


class _Maker:
    """Sections of one page."""

    def __init__(self, diagnosis: Diagnosis, decision: Decision) -> None:
        self.diagnosis, self.decision = diagnosis, decision
        self.view: View = decision.problem.view
        self.shown = shown_rows(decision)
        self.before: State = self.view.fresh_state()
        self.after: State = decision.cross_fitted() if self.shown.fresh else self.shown.after
        self.mismatches = [
            Mismatch(d, self.before, self.after, keep_constant=self._is_off(d)) for d in decision.problem.data
        ]  # fmt: skip
        self.pictured = self.mismatches
        if self.shown.fresh:
            self.pictured = [
                Mismatch(d, self.shown.before, self.shown.after, keep_constant=self._is_off(d))
                for d in self.shown.problem.data
            ]  # fmt: skip

    def _is_off(self, d: ChannelData) -> bool:
        """Whether a constant is the finding on a channel."""
        return any(f.term is None and f.law is None and d.channel.name in f.channels for f in self.diagnosis.findings)

    # ---- sentences and tables --------------------------------------------------------------------------------

    def matters(self) -> list[tuple[str, str]]:
        """How much it matters, channel by channel; of a large table on rows that the search never looked at."""
        touched = {c for f in self.diagnosis.findings for c in f.channels}
        made = []
        for m in self.pictured:
            d, name = m.data, m.data.channel.name
            fit = self.diagnosis.fit.get(name)
            if fit is None or name not in touched:
                continue
            seen = ""
            if self.shown.fresh:
                seen = f"On {words.counted(self.shown.problem.view.n)} rows that the search never looked at"
                before, after = mean_square(d, self.shown.before), mean_square(d, self.shown.after, centred=True)
                fit = ChannelFit(before=before, after=after, unexplained=fit.unexplained)
            size = size_text(d, m.change(self.shown.before, self.shown.after))
            size = size.replace("it touches", "that the findings touch")
            text = words.matters(
                fit, min(d.spread**2, fit.after), constants=name in self.diagnosis.constants, seen=seen
            )  # fmt: skip
            text = f"{size[:1].upper()}{size[1:]} {text} {outliers(d, self.shown.after)}"
            made.append((name, text.strip()))
        return made

    def constants(self) -> list[tuple[str, str, str]]:
        """Channel, unit and calibration constant, those that are none to speak of left out."""
        lines = [
            (name, unit, f"{words.constant(zero, channel, zero=True)}, gain {words.plain(100.0 * gain)} %")
            for name, units in self.diagnosis.lines.items()
            for channel in self.decision.problem.columns.channels if channel.name == name
            for unit, (gain, zero) in sorted(units.items())
        ]  # fmt: skip
        return lines + [
            (d.channel.name, unit or "all rows", words.constant(value, d.channel))
            for d in self.decision.problem.data
            for unit, value in sorted(self.diagnosis.constants.get(d.channel.name, {}).items())
            if abs(value) * float(np.median(d.scale)) > LEAST_CONSTANT * float(np.median(d.stated))
        ]

    def facts(self) -> list[tuple[str, str]]:
        """What the table holds."""
        columns, problem = self.decision.problem.columns, self.decision.problem
        rows = words.counted(self.diagnosis.rows)
        if self.view.n < columns.n or "(rows)" in self.diagnosis.notes:
            rows += f" ({words.counted(self.view.n)} of them were searched, evenly drawn"
            rows += (
                f"; the pictures show {words.counted(self.shown.problem.view.n)} others)" if self.shown.fresh else ")"
            )
        made = [("Rows", rows), *rays_of(columns)]
        for d in problem.data:
            noise = "" if d.stated_known else "; the simulation states no noise, it was estimated"
            wider = f"; rows scatter {d.spread:.2g} times as much as stated" if d.spread > 1.15 else ""
            unit = words.unit_text(d.channel.unit)
            made.append(
                (
                    f"Channel {d.channel.name}",
                    f"{unit or 'no unit'}, {words.counted(len(d.use))} rows compared{noise}{wider}{held_back(d)}",
                )
            )
        for label, names in (
            ("DUTs", ("dut",)), ("Cycles", ("cycle",)), ("Steps", ("dut", "cycle", "step")),
            ("Stage angles", ("stage_angle_deg",)), ("Pixels", ("pixel_u", "pixel_v")),
        ):  # fmt: skip
            if names[-1] in columns.numbers or names[-1] in columns.categories:
                made.append((label, level_text(columns, label, names)))
        made.append(("Blocks held out in turn", problem.groups.block_name))
        if problem.groups.unit_columns:
            made.append(("Calibrated as one unit", "each " + words.joined(problem.groups.unit_columns)))
        if columns.given:
            read = "; ".join(f"{known} = {given.formula()}" for known, given in sorted(columns.given.items()))
            made.append(("Read as", read))
        made.append(("SHA-256 of the table", self.diagnosis.sha256 or "not known"))
        return made

    def finding(self, f: Finding) -> dict[str, object]:
        """What the template shows of a finding."""
        held = f.held_out
        floor = held.after
        if held.explained > 1e-3 and held.before > held.after:
            floor = held.before - (held.before - held.after) / held.explained
        moves = abs(held.before - held.after) > 1e-9 * max(held.before, 1.0)
        return {
            "f": f, "title": words.title_of(f.effect), "floor": floor, "moves": moves,
            "bars": bars(held.before, held.after, floor) if moves else Markup(""), "parts": self._parts(f),
            "size": self._size(f), "parameters": [(p, *words.with_interval(p)) for p in f.parameters],
        }  # fmt: skip

    def _without(self, f: Finding) -> State:
        return forward([t for t in self.decision.terms if all(t is not own for own in f.terms)], self.view)

    def _data(self, name: str) -> ChannelData | None:
        return next((d for d in self.decision.problem.data if d.channel.name == name), None)

    def _parts(self, f: Finding) -> list[HeldOutPart]:
        """Before and after of each fold, for effects of the library that move a mean."""
        data = [d for name in f.channels if (d := self._data(name)) is not None]
        if f.term is None or f.term.effect.kind is not Kind.MEAN or not data:
            return []
        before = self._without(f)
        made = []
        for fold in range(FOLDS):
            blocks = self._blocks(fold)
            pairs = [
                (misfit_of_fold(d, before, fold), misfit_of_fold(d, self.after, fold, centred=True)) for d in data
            ]
            counts = [int(np.sum(d.fold == fold)) for d in data]
            if blocks and sum(counts):
                first, last = (float(np.average([p[k] for p in pairs], weights=counts)) for k in (0, 1))
                made.append(HeldOutPart(blocks=blocks, before=words.plain(first), after=words.plain(last)))
        return made

    def _blocks(self, fold: int) -> str:
        """Names of the blocks of a fold."""
        problem = self.decision.problem
        rows = self.view.rows[problem.fold == fold]
        names = list(dict.fromkeys(block_names(problem.columns, problem.groups, rows)))
        return ", ".join(names[:NAMED_BLOCKS]) + (
            f" and {len(names) - NAMED_BLOCKS} more" if len(names) > NAMED_BLOCKS else ""
        )

    def _size(self, f: Finding) -> list[tuple[str, str, str]]:
        """How far a finding moves each of its channels, beyond a constant."""
        made = []
        for m in self.mismatches:
            name = m.data.channel.name
            if name not in f.channels:
                continue
            if f.law is not None and f.law.channel == name:
                base = forward(self.decision.terms, self.view)
                full = {**base, name: base[name] + f.law.correction(self.decision.found.looker.features, base[name])}
                moved = m.change(base, full)
            elif f.term is not None and f.term.effect.kind is Kind.MEAN:
                moved = m.change(self._without(f), forward(self.decision.terms, self.view))
            else:
                continue
            text = size_text(m.data, moved)
            if text:
                apart = m.moves_units_only(moved / m.data.scale)
                lead = "In" if apart else "Beyond what calibration would take away, in"
                made.append((lead, name, text))
        return made

    def unseen(self) -> list[tuple[str, list[str]]]:
        """Reasons why this table could not have shown some effects, and their ids."""
        made = self.diagnosis.invisible
        reasons = dict.fromkeys(reason for _, reason in sorted(made.items()))
        return [(reason, [e for e, r in sorted(made.items()) if r == reason]) for reason in reasons]


