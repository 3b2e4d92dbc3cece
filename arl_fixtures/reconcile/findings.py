"""Findings in words and numbers: law, region, intervals, held-out gain, what else could be in its place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.diagnosis import Alternative, Finding, HeldOut, ParameterValue
from arl_fixtures.reconcile.effects_common import in_mm
from arl_fixtures.reconcile.effects_encoder import STAGE
from arl_fixtures.reconcile.finding_words import separating, size_of, statement, tidy
from arl_fixtures.reconcile.fit import Fit
from arl_fixtures.reconcile.held_out import held_out_of, held_out_without
from arl_fixtures.reconcile.in_place import charged, others_in_place, without_name
from arl_fixtures.reconcile.intervals import half_widths
from arl_fixtures.reconcile.law import Law, LawTerm
from arl_fixtures.reconcile.patterns import Pattern
from arl_fixtures.reconcile.region import columns_as_drivers, energy_region
from arl_fixtures.reconcile.shared_scatter import Scatter
from arl_fixtures.reconcile.terms import RECORD_TIME, Term, forward
from arl_fixtures.reconcile.told_apart import reason_of

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision


def named_finding(decision: Decision, index: int) -> Finding:
    """An effect of the library."""
    term = decision.best.terms[index]
    view = decision.problem.view
    without, gain = without_name(decision, index)
    energy = decision.energy(term)
    channels = sorted(
        (c for c in energy if energy[c] > max(4.0, 0.01 * max(energy.values()))), key=lambda c: -energy[c]
    )
    channels = channels or list(term.variant.channels[:1])
    alternatives, tests = _alternatives(decision, index, without, gain)
    twins = list(tests)
    where = dict(term.effect.where(term.variant, term.values, view))
    if term.unit:
        where[term.unit_column] = [term.unit]
    for column, bounds in _region(decision, term, channels).items():
        where.setdefault(column, bounds)
    effect = term.effect
    sentence, law = effect.sentence(term.variant, term.values, view), effect.expression(term.variant)
    if term.strengths is not None:
        law += "; of this change each unit has its strength"
        each = ", ".join(f"{unit} {value:.2f} times" for unit, (value, _) in term.strengths.named().items())
        sentence += f" Units differ: {each} this."
    if term.answer is not None:
        distance, signal = term.answer.distance, term.answer.signal
        moved = decision.best.state[distance] - without.state[distance]
        most = in_mm(float(np.nanmax(np.abs(moved))), distance)
        law += f"; {distance} goes along its simulated curve over {signal}"
        sentence += f" {distance} answers by up to {most:.2g} mm, as in the simulation where {signal} differs."
    return Finding(
        effect=effect.id, channels=channels, where=where, drivers=effect.drivers(term.variant, term.values, view),
        expression=law, source=effect.source, parameters=_parameters(decision, index),
        statement=statement(sentence, where, twins), alternatives=alternatives, equivalent_to=twins,
        held_out=held_out_without(decision, [term], channels, gain), strength=gain, terms=[term],
        next_experiment=separating(effect.next_experiment(term.variant), tests),
    )  # fmt: skip


def _region(decision: Decision, term: Term, channels: Sequence[str]) -> dict[str, list[float]]:
    others = [t for t in decision.terms if t is not term]
    base, moved = forward(others, decision.problem.view), forward([*others, term], decision.problem.view)
    found: dict[str, list[float]] = {}
    for name in channels[:1]:
        d = next(d for d in decision.problem.data if d.channel.name == name)
        power = ((moved[name] - base[name])[d.use] / (d.stated * d.spread)) ** 2
        for column in term.variant.drivers:
            if decision.problem.view.varies(column):
                bounds = energy_region(decision.problem.view.number(column)[d.use], power)
                if bounds is not None:
                    found[column] = bounds
    return found


def _parameters(decision: Decision, index: int) -> list[ParameterValue]:
    widths = half_widths(decision.problem, decision.best)
    term, made = decision.best.terms[index], []
    unknown = term.effect.unknown_history(term.variant, term.values, decision.problem.view)
    for (place, p), width in zip(decision.best.keys, widths, strict=True):
        if place == index:
            value, width = term.values[p.name], float(np.hypot(width, 1.96 * unknown.get(p.name, 0.0)))
            low, high = max(value - width, p.low), min(value + width, p.high)
            made.append(ParameterValue(name=p.name, value=value, unit=p.unit, low=float(low), high=float(high)))
    if term.strengths is not None:
        for unit, (value, error) in term.strengths.named().items():
            low, high = value - 1.96 * error, value + 1.96 * error
            made.append(ParameterValue(name=f"strength_{unit}", value=value, unit="1", low=low, high=high))
    return made


def _alternatives(
    decision: Decision, index: int, without: Fit, gain: float
) -> tuple[list[Alternative], dict[str, str]]:
    """Other effects in the place of a term, refitted beside the remaining ones.

    Returns:
        alternatives, and those among them that cannot be told apart with the measurement that each asks for.
    """
    term = decision.best.terms[index]
    own = charged(term, gain)
    alternatives: list[Alternative] = []
    twins: dict[str, str] = {}
    for r, deficit, alike in others_in_place(decision, index, without, gain):
        other = r.fit.terms[-1]
        twin = alike or (other.effect.id in term.effect.says_as_well(term.variant) and r.gain > 0)
        reason = reason_of(deficit, own, alike=alike) if r.gain > 0 else "gains nothing in its place"
        alternatives.append(
            Alternative(
                effect=other.effect.id,
                gain=float(max(r.gain, 0.0) / max(own, 1e-9)),
                indistinguishable=twin,
                reason=reason,
            )
        )
        if twin:
            twins[other.effect.id] = other.effect.next_experiment(other.variant)
    return alternatives[:6], twins


def error_of_spread(values: FloatArray) -> float:
    """Relative standard error of a standard deviation; tails heavier than a Gaussian's make it larger."""
    x = values - float(np.mean(values))
    kurtosis = float(np.mean(x**4)) / max(float(np.mean(x**2)), 1e-300) ** 2
    return float(np.sqrt(max(kurtosis - 1.0, 2.0) / (4.0 * max(len(x) - 1, 1))))


def pattern_finding(decision: Decision, pattern: Pattern) -> Finding:
    """An effect with a free value per pixel."""
    term = pattern.term
    view = decision.problem.view
    channels = [c for c in term.variant.channels if c in decision.energy(term)]
    rest = [t for t in decision.terms if t is not term]
    data = [d for d in decision.problem.data if d.channel.name in channels]
    held = held_out_of(
        data, forward(rest, view), decision.final_state(), decision.problem.groups.block_name, pattern.gain
    )  # fmt: skip
    name, levels = next(iter((term.fields or {}).items()))
    parameter = next(p for p in term.variant.parameters if p.name == name)
    sparse = parameter.low >= (parameter.null or 0.0)
    pixels = [k for k, column in enumerate(parameter.per) if column not in RECORD_TIME]
    count = len({tuple(key[k] for k in pixels) for key in levels}) if sparse else len(levels)
    size = float(count) if sparse else pattern.size
    spread = 0.0 if sparse else 1.96 * pattern.size * error_of_spread(np.array(list(levels.values())))
    shown = ParameterValue(
        name="count" if sparse else f"{name}_sd", value=size, unit="1" if sparse else parameter.unit,
        low=size - spread, high=size + spread,
    )  # fmt: skip
    where: dict[str, list[str] | list[float]] = dict(term.variant.where)
    values = term.values_on(view) if sparse else {**term.values, name: size}
    if sparse:
        for axis in ("pixel_u", "pixel_v"):
            if axis in parameter.per:
                place = [float(key[parameter.per.index(axis)]) for key in levels]
                where[axis] = sorted(set(place)) if len(set(place)) <= 12 else [min(place), max(place)]
    return Finding(
        effect=term.effect.id, channels=channels, where=where, drivers=list(term.variant.drivers),
        expression=term.effect.expression(term.variant), source=term.effect.source, parameters=[shown],
        statement=statement(term.effect.sentence(term.variant, values, view), where, []),
        held_out=held, strength=pattern.gain, terms=[term], next_experiment=term.effect.next_experiment(term.variant),
    )  # fmt: skip


def law_finding(decision: Decision, law: Law) -> Finding:
    """A mismatch that the library does not explain."""
    d = next(d for d in decision.problem.data if d.channel.name == law.channel)
    before = forward(decision.terms, decision.problem.view)
    drivers = columns_as_drivers(law.drivers, decision.problem.view)
    sizes = [size_of_tables(t) for t in law.terms]
    parameters = [
        ParameterValue(
            name=f"c{k + 1}", value=t.value * size, unit="deg" if t.turns else law.unit,
            low=(t.value - 1.96 * t.error) * size, high=(t.value + 1.96 * t.error) * size,
        )
        for k, (t, size) in enumerate(zip(law.terms, sizes, strict=True))
    ]  # fmt: skip
    left = decision.after[law.channel].ceiling
    added = law.correction(decision.found.looker.features, before[law.channel])
    total = added[d.use]
    final = decision.final_state()
    bare = {**final, law.channel: final[law.channel] - added}
    # on the scale of named effects: with the scatter of the groups at its best for each of the two
    gain = max(decision.problem.log_likelihood(final) - decision.problem.log_likelihood(bare), 0.0)
    power = (total / (d.stated * d.spread)) ** 2
    where: dict[str, list[str] | list[float]] = {}
    for column in drivers[:3]:
        if decision.problem.view.varies(column):
            bounds = energy_region(decision.problem.view.number(column)[d.use], power)
            if bounds is not None:
                where[column] = list(bounds)
    explained = (left.before - left.after) / max(left.before - 1.0, 1e-9)
    nearest = _nearest(decision, law)
    turned = bool(law.terms) and all(t.turns for t in law.terms) and not law.trees
    how = "as if the stage stood elsewhere than its angle says, " if turned else ""
    told = [name for name in drivers if name != STAGE] if turned else drivers
    text = (
        f"{law.channel} differs from the simulation {how}with {', '.join(told[:3]) or 'no single column'} "
        f"{size_of(total, law, before[law.channel][d.use])}; no effect of the library explains it."
    )
    held = HeldOut(
        blocks=decision.problem.groups.block_name, before=left.before, after=left.after,
        explained=float(min(max(explained, 0.0), 1.0)), gain=gain,
    )  # fmt: skip
    if law.terms and not law.trees and law.confirmed > 0.0:
        whole = held_out_of([d], bare, final, held.blocks, gain)
        held = HeldOut(
            blocks=held.blocks, before=whole.before, gain=gain, explained=law.confirmed * whole.explained,
            after=whole.before - law.confirmed * (whole.before - whole.after),
        )  # fmt: skip
    return Finding(
        effect="unknown", channels=[law.channel], where=where, drivers=drivers, expression=law.expression,
        source="", parameters=parameters, statement=statement(text, where, []), held_out=held,
        alternatives=nearest, strength=gain, law=law,
        next_experiment=f"Vary {drivers[0] if drivers else 'one condition'} alone and keep everything else still.",
    )  # fmt: skip


def size_of_tables(term: LawTerm) -> float:
    """Root mean square of a term's tabulated functions: the report gives them unit size, the coefficient theirs."""
    sizes = [float(np.sqrt(np.mean(np.square(axis.values)))) for axis in term.axes if len(axis.values)]
    return float(np.prod(sizes)) if sizes and min(sizes) > 0 else 1.0


def _nearest(decision: Decision, law: Law) -> list[Alternative]:
    """What of the library came nearest in a law's channel, with the share it would explain: the law tells as much."""
    channel = law.channel
    ceiling_gain = max(decision.found.before[channel].gain, law.gain)
    near: list[Alternative] = []
    if ceiling_gain <= 1.0:
        return near  # what is told by units' constants alone leaves columns nothing to predict
    view, data = decision.problem.view, next(d for d in decision.problem.data if d.channel.name == channel)
    before = data.fit_scatter(data.residual(view.fresh_state()))[0]
    for stage in decision.found.stages[:1]:
        for r in stage.ranked:
            effect = r.fit.terms[-1].effect.id
            if channel in r.fit.terms[-1].variant.channels and all(a.effect != effect for a in near):
                here = data.fit_scatter(data.residual(forward(r.fit.terms[-1:], view)))[0] - before
                share = float(min(max(here, 0.0) / ceiling_gain, 1.0))  # what it gains elsewhere says nothing of it
                but = ", by another strength under other conditions" if effect in decision.refused else ""
                near.append(
                    Alternative(
                        effect=effect, gain=share, indistinguishable=False,
                        reason=f"explains {100 * share:.0f} % of what the columns predict{but}",
                    )
                )  # fmt: skip
    return near[:4]


def scatter_finding(decision: Decision, scatter: Scatter) -> Finding:
    """Scatter that rows of a group share."""
    term = scatter.term
    amplitude = next(p for p in term.variant.parameters if p.is_amplitude)
    value = ParameterValue(
        name=amplitude.name, value=scatter.value, unit=amplitude.unit,
        low=max(scatter.value - scatter.half_width, 0.0), high=scatter.value + scatter.half_width,
    )  # fmt: skip
    data = [d for d in decision.problem.data if d.channel.name == scatter.channel]
    state = decision.final_state()
    held = held_out_of(data, state, state, decision.problem.groups.block_name, scatter.gain)
    return Finding(
        effect=term.effect.id, channels=[scatter.channel], where=dict(term.variant.where),
        drivers=list(term.variant.drivers), expression=term.effect.expression(term.variant),
        source=term.effect.source, parameters=[value], held_out=held, strength=scatter.gain, terms=[term],
        statement=tidy(term.effect.sentence(term.variant, term.values, decision.problem.view)),
        next_experiment=term.effect.next_experiment(term.variant),
    )  # fmt: skip


def ordered(findings: list[Finding], names: int) -> list[Finding]:
    """Strongest first; behind a name (they come first) what was fitted to the rest that it left on its channel."""
    leading = findings[:names]
    ranked = [(f.strength, f) for f in leading]
    for f in findings[names:]:
        ahead = [0.999 * name.strength for name in leading if set(name.channels) & set(f.channels)]
        ranked.append((min([f.strength, *ahead]), f))
    return [f for _, f in sorted(ranked, key=lambda pair: -pair[0])]
