"""From what the search found to findings: which names stand, what is unknown, what cannot be told apart.

The adequacy gate: a name stands only if, with it, the columns predict next to nothing of what is left. A wrong name
is worse than none: where the gate fails, the channel's mismatch is `unknown` and gets an empirical law.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.diagnosis import Alternative, ChannelFit, Finding, HeldOut, ParameterValue
from arl_fixtures.reconcile.effect import Effect, State
from arl_fixtures.reconcile.fit import Fit, finish, fit, with_vector
from arl_fixtures.reconcile.intervals import half_widths
from arl_fixtures.reconcile.law import Law, find_law
from arl_fixtures.reconcile.patterns import Pattern, Scatter, find_patterns, find_scatter, is_calibration
from arl_fixtures.reconcile.pilot import Structure
from arl_fixtures.reconcile.problem import FOLDS, ChannelData, Problem
from arl_fixtures.reconcile.region import columns_as_drivers, energy_region
from arl_fixtures.reconcile.screen import screen
from arl_fixtures.reconcile.search import PRICE, Found, Search, shortlist
from arl_fixtures.reconcile.terms import Term, forward

STRUCTURE_Z, STRUCTURE_GAIN = 3.7, 12.0
"""A physics-free model must gain this much on unseen blocks before there is said to be a mismatch at all."""
LEFT_SHARE = 0.25
"""Largest share of a channel's mismatch that may stay predictable under a name."""
UNKNOWN_SHARE = 0.08
"""Share above which what is left is reported as a finding of its own."""
TWIN_GAIN, TWIN_SHARE = 3.0, 0.02
"""An alternative that loses less than this (log-likelihood, or share of the finding's gain) cannot be told apart."""


def is_structure(seen: Structure) -> bool:
    """Whether a channel's residual holds something that unseen blocks confirm."""
    return seen.z > STRUCTURE_Z and seen.gain > STRUCTURE_GAIN


class Decision:
    """Findings of one search.

    Args:
        search: with its problems and variants.
        found: its result.
        effects: the library.
    """

    def __init__(self, search: Search, found: Found, effects: Sequence[Effect]) -> None:
        self.search, self.found, self.effects = search, found, effects
        self.problem: Problem = found.problem
        self.best: Fit = found.best
        self.patterns: list[Pattern] = []
        self.laws: list[Law] = []
        self.scatters: list[Scatter] = []
        self.after = dict(found.after)

    def run(self) -> tuple[list[Finding], dict[str, ChannelFit]]:
        """All findings, strongest first, and the agreement of each channel."""
        self._add_patterns()
        self._gate()
        self._find_laws()
        if not any(is_structure(s) for s in self.after.values()) or self.laws:
            self.scatters = find_scatter(self.problem, self.effects, self.final_state())[:1]
        findings = [self._named(index) for index in range(len(self.best.terms))]
        findings += [self._of_pattern(p) for p in self.patterns]
        findings += [self._of_law(law) for law in self.laws]
        findings += [self._of_scatter(s) for s in self.scatters]
        findings.sort(key=lambda f: -f.strength)
        return findings, self._fits()

    # ---- decisions -------------------------------------------------------------------------------------------

    @property
    def terms(self) -> tuple[Term, ...]:
        """Accepted effects, patterns included."""
        return (*self.best.terms, *(p.term for p in self.patterns))

    def final_state(self) -> State:
        """Corrected simulation of the problem's rows with effects, patterns and laws."""
        state = forward(self.terms, self.problem.view)
        for law in self.laws:
            add = law.correction(self.found.looker.features, state[law.channel])
            state[law.channel] = state[law.channel] + add
        return state

    def _add_patterns(self) -> None:
        for pattern in find_patterns(self.problem, self.effects, self.best.terms)[:2]:
            if not is_calibration(self.problem, pattern, self.best.terms) and not self.patterns:
                self.patterns.append(pattern)
        if self.patterns:
            self._look()

    def _look(self) -> None:
        state = forward(self.terms, self.problem.view)
        for d in self.problem.data:
            self.after[d.channel.name] = self.found.looker.look(d, state)

    def left_share(self, name: str) -> float:
        """Share of a channel's mismatch that stays predictable."""
        left = self.after[name]
        if not is_structure(left):
            return 0.0
        now = self._gain_of_terms(name)
        return left.gain / max(self.found.before[name].gain, left.gain + max(now, 0.0), 1.0)

    def _gain_of_terms(self, name: str) -> float:
        """Drop of half the sum of squares of a channel that the accepted effects bring."""
        d = next(d for d in self.problem.data if d.channel.name == name)
        before = d.whiten(d.residual(self.problem.view.fresh_state()))
        after = d.whiten(d.residual(forward(self.terms, self.problem.view)))
        return 0.5 * float(before @ before - after @ after)

    def _gate(self) -> None:
        """Drop the names of channels in which too much stays predictable."""
        bad = {d.channel.name for d in self.problem.data if self.left_share(d.channel.name) > LEFT_SHARE}
        if not bad or not self.best.terms:
            return
        kept = tuple(t for t in self.best.terms if not self._mostly_in(t, bad))
        if len(kept) != len(self.best.terms):
            self.best = finish(self.problem, fit(self.problem, kept, rounds=4))
            self._look()

    def _mostly_in(self, term: Term, names: set[str]) -> bool:
        energy = self.energy(term)
        total = sum(energy.values())
        return total > 0 and sum(v for k, v in energy.items() if k in names) > 0.5 * total

    def energy(self, term: Term) -> dict[str, float]:
        """Squared whitened change of each channel that a term makes beside the others."""
        others = [t for t in self.terms if t is not term]
        base, moved = forward(others, self.problem.view), forward([*others, term], self.problem.view)
        energy = {}
        for d in self.problem.data:
            name = d.channel.name
            if moved[name] is not base[name]:
                z = d.whiten(d.expect * (moved[name] - base[name])[d.use])
                energy[name] = float(z @ z)
        return energy

    def _find_laws(self) -> None:
        state = forward(self.terms, self.problem.view)
        for d in self.problem.data:
            name = d.channel.name
            left = self.after[name]
            acted = bool(self.best.terms) and any(name in self.energy(t) for t in self.terms)
            if is_structure(left) and (not acted or self.left_share(name) > UNKNOWN_SHARE):
                law = find_law(self.found.looker, d, state, left)
                if law.terms or law.trees:
                    self.laws.append(law)

    # ---- findings --------------------------------------------------------------------------------------------

    def _named(self, index: int) -> Finding:
        term = self.best.terms[index]
        view = self.problem.view
        rest = tuple(t for k, t in enumerate(self.best.terms) if k != index)
        without = finish(self.problem, fit(self.problem, rest, rounds=3))
        full = finish(self.problem, self.best)
        gain = full.log_likelihood - without.log_likelihood
        energy = self.energy(term)
        channels = sorted(
            (c for c in energy if energy[c] > max(4.0, 0.01 * max(energy.values()))), key=lambda c: -energy[c]
        )
        channels = channels or list(term.variant.channels[:1])
        alternatives, twins = self._alternatives(index, without, gain)
        where = dict(term.effect.where(term.variant, term.values, view))
        if term.unit:
            where[term.unit_column] = [term.unit]
        for column, bounds in self._region(term, channels).items():
            where.setdefault(column, bounds)
        effect = term.effect
        sentence = effect.sentence(term.variant, term.values, view)
        return Finding(
            effect=effect.id, channels=channels, where=where, drivers=list(term.variant.drivers),
            expression=effect.expression(term.variant), source=effect.source, parameters=self._parameters(index),
            statement=statement(sentence, where, twins), alternatives=alternatives, equivalent_to=twins,
            held_out=self._held_out(index, channels, gain), strength=gain, term=term,
            next_experiment=effect.next_experiment(term.variant),
        )  # fmt: skip

    def _region(self, term: Term, channels: Sequence[str]) -> dict[str, list[float]]:
        others = [t for t in self.terms if t is not term]
        base, moved = forward(others, self.problem.view), forward([*others, term], self.problem.view)
        found: dict[str, list[float]] = {}
        for name in channels[:1]:
            d = next(d for d in self.problem.data if d.channel.name == name)
            power = ((moved[name] - base[name])[d.use] / (d.stated * d.spread)) ** 2
            for column in term.variant.drivers:
                if self.problem.view.varies(column):
                    bounds = energy_region(self.problem.view.number(column)[d.use], power)
                    if bounds is not None:
                        found[column] = bounds
        return found

    def _parameters(self, index: int) -> list[ParameterValue]:
        widths = half_widths(self.problem, self.best)
        made = []
        for (place, p), width in zip(self.best.keys, widths, strict=True):
            if place == index:
                value = self.best.terms[index].values[p.name]
                low, high = max(value - width, p.low), min(value + width, p.high)
                made.append(ParameterValue(name=p.name, value=value, unit=p.unit, low=float(low), high=float(high)))
        return made

    def _alternatives(self, index: int, without: Fit, gain: float) -> tuple[list[Alternative], list[str]]:
        """Other effects in the place of a term: refitted beside the remaining ones."""
        term = self.best.terms[index]
        again = screen(self.search.small, self.search.variants, without.terms)
        ranked = self.search.rank(without, shortlist(again.candidates)[:10])
        own = gain - PRICE * len(term.free())
        alternatives: list[Alternative] = []
        twins: list[str] = []
        for r in ranked:
            effect = r.fit.terms[-1].effect.id
            if effect == term.effect.id or any(a.effect == effect for a in alternatives):
                continue
            deficit = own - r.gain
            twin = deficit < max(TWIN_GAIN, TWIN_SHARE * own)
            reason = f"loses {deficit:.1f} of {own:.1f} in log-likelihood"
            alternatives.append(
                Alternative(
                    effect=effect,
                    gain=float(max(r.gain, 0.0) / max(own, 1e-9)),
                    indistinguishable=twin,
                    reason=reason,
                )
            )
            if twin:
                twins.append(effect)
        return alternatives[:6], twins

    def _held_out(self, index: int, channels: Sequence[str], gain: float) -> HeldOut:
        rest = tuple(t for k, t in enumerate(self.terms) if k != index)
        before_state = forward(rest, self.problem.view)
        after = self.cross_fitted()
        data = [d for d in self.problem.data if d.channel.name in channels]
        return held_out_of(data, before_state, after, self.problem.groups.block_name, gain)

    def cross_fitted(self) -> State:
        """Corrected simulation in which each fold's rows use parameters of the other folds (one Newton step)."""
        view = self.problem.view
        final = self.final_state()
        if not self.best.keys:
            return final
        vector = self.best.values()
        scale = np.sqrt(np.maximum(np.diag(self.best.jacobian.T @ self.best.jacobian), 1e-300))
        jacobian = self.best.jacobian / scale
        fold = np.concatenate([d.fold for d in self.problem.data])
        low, high = (np.array([getattr(p, end) for _, p in self.best.keys]) for end in ("low", "high"))
        result = {name: values.copy() for name, values in final.items()}
        for k in range(FOLDS):
            train = fold != k
            gram = jacobian[train].T @ jacobian[train] + 1e-9 * np.eye(len(vector))
            shift = np.linalg.lstsq(gram, jacobian[train].T @ self.best.residual[train], rcond=1e-10)[0] / scale
            terms = with_vector(self.best.terms, self.best.keys, np.clip(vector + shift, low, high))
            state = forward((*terms, *(p.term for p in self.patterns)), view)
            rows = self.problem.fold == k
            base = forward(self.terms, view)
            for name in result:
                result[name][rows] = (state[name] + (final[name] - base[name]))[rows]
        return result

    def _of_pattern(self, pattern: Pattern) -> Finding:
        term = pattern.term
        view = self.problem.view
        channels = [c for c in term.variant.channels if c in self.energy(term)]
        rest = [t for t in self.terms if t is not term]
        data = [d for d in self.problem.data if d.channel.name in channels]
        held = held_out_of(
            data, forward(rest, view), self.final_state(), self.problem.groups.block_name, pattern.gain
        )  # fmt: skip
        name, levels = next(iter((term.fields or {}).items()))
        parameter = next(p for p in term.variant.parameters if p.name == name)
        count = len(levels)
        sparse = parameter.low >= (parameter.null or 0.0)
        size = float(count) if sparse else pattern.size
        spread = 0.0 if sparse else 1.96 * pattern.size / np.sqrt(2.0 * max(count - 1, 1))
        shown = ParameterValue(
            name="count" if sparse else f"{name}_sd", value=size, unit="1" if sparse else parameter.unit,
            low=size - spread, high=size + spread,
        )  # fmt: skip
        where: dict[str, list[str] | list[float]] = dict(term.variant.where)
        if sparse:
            for axis in ("pixel_u", "pixel_v"):
                if axis in parameter.per:
                    place = [float(key[parameter.per.index(axis)]) for key in levels]
                    where[axis] = sorted(set(place)) if len(set(place)) <= 12 else [min(place), max(place)]
        return Finding(
            effect=term.effect.id, channels=channels, where=where, drivers=list(term.variant.drivers),
            expression=term.effect.expression(term.variant), source=term.effect.source, parameters=[shown],
            statement=statement(term.effect.sentence(term.variant, {**term.values, name: size}, view), where, []),
            held_out=held, strength=pattern.gain, term=term, next_experiment=term.effect.next_experiment(term.variant),
        )  # fmt: skip

    def _of_law(self, law: Law) -> Finding:
        d = next(d for d in self.problem.data if d.channel.name == law.channel)
        before = forward(self.terms, self.problem.view)
        drivers = columns_as_drivers(law.drivers, self.problem.view)
        parameters = [
            ParameterValue(
                name=f"c{k + 1}",
                value=t.value,
                unit=law.unit,
                low=t.value - 1.96 * t.error,
                high=t.value + 1.96 * t.error,
            )
            for k, t in enumerate(law.terms)
        ]
        left = self.after[law.channel].ceiling
        total = law.correction(self.found.looker.features, before[law.channel])[d.use]
        power = (total / (d.stated * d.spread)) ** 2
        where: dict[str, list[str] | list[float]] = {}
        for column in drivers[:3]:
            if self.problem.view.varies(column):
                bounds = energy_region(self.problem.view.number(column)[d.use], power)
                if bounds is not None:
                    where[column] = list(bounds)
        explained = (left.before - left.after) / max(left.before - 1.0, 1e-9)
        nearest = self._nearest(law.channel)
        text = (
            f"{law.channel} differs from the simulation with {', '.join(drivers[:3]) or 'no single column'} "
            f"(up to {_size_of(total, law, before[law.channel][d.use])}); no effect of the library explains it."
        )
        held = HeldOut(
            blocks=self.problem.groups.block_name, before=left.before, after=left.after,
            explained=float(min(max(explained, 0.0), 1.0)), gain=law.gain,
        )  # fmt: skip
        return Finding(
            effect="unknown", channels=[law.channel], where=where, drivers=drivers, expression=law.expression,
            source="", parameters=parameters, statement=statement(text, where, []), held_out=held,
            alternatives=nearest, strength=law.gain, law=law,
            next_experiment=f"Vary {drivers[0] if drivers else 'one condition'} alone and keep everything else still.",
        )  # fmt: skip

    def _nearest(self, channel: str) -> list[Alternative]:
        """What of the library came nearest in a channel, with the share it would explain."""
        ceiling_gain = max(self.found.before[channel].gain, 1.0)
        near: list[Alternative] = []
        for stage in self.found.stages[:1]:
            for r in stage.ranked:
                effect = r.fit.terms[-1].effect.id
                if channel in r.fit.terms[-1].variant.channels and all(a.effect != effect for a in near):
                    share = float(min(max(r.gain, 0.0) / ceiling_gain, 1.0))
                    near.append(
                        Alternative(
                            effect=effect, gain=share, indistinguishable=False,
                            reason=f"explains {100 * share:.0f} % of what the columns predict",
                        )
                    )  # fmt: skip
        return near[:4]

    def _of_scatter(self, scatter: Scatter) -> Finding:
        term = scatter.term
        amplitude = next(p for p in term.variant.parameters if p.is_amplitude)
        value = ParameterValue(
            name=amplitude.name, value=scatter.value, unit=amplitude.unit,
            low=max(scatter.value - scatter.half_width, 0.0), high=scatter.value + scatter.half_width,
        )  # fmt: skip
        data = [d for d in self.problem.data if d.channel.name == scatter.channel]
        state = self.final_state()
        held = held_out_of(data, state, state, self.problem.groups.block_name, scatter.gain)
        return Finding(
            effect=term.effect.id, channels=[scatter.channel], where=dict(term.variant.where),
            drivers=list(term.variant.drivers), expression=term.effect.expression(term.variant),
            source=term.effect.source, parameters=[value], held_out=held, strength=scatter.gain, term=term,
            statement=term.effect.sentence(term.variant, term.values, self.problem.view),
            next_experiment=term.effect.next_experiment(term.variant),
        )  # fmt: skip

    def _fits(self) -> dict[str, ChannelFit]:
        view = self.problem.view
        before, after = view.fresh_state(), self.cross_fitted()
        fits = {}
        for d in self.problem.data:
            name = d.channel.name
            seen, left = self.found.before[name], self.after[name]
            law = next((law for law in self.laws if law.channel == name), None)
            rest = left.gain - (law.gain if law else 0.0)
            share = max(rest, 0.0) / max(seen.gain, left.gain, 1.0) if is_structure(left) else 0.0
            fits[name] = ChannelFit(
                before=mean_square(d, before), after=mean_square(d, after, centred=bool(self.terms or self.laws)),
                unexplained=float(min(share, 1.0)),
            )  # fmt: skip
        return fits


def mean_square(d: ChannelData, state: State, *, centred: bool = False) -> float:
    """Mean squared residual in standard errors; outliers weigh as in the fit."""
    residual = d.residual(state)
    if centred and d.calibrated:
        residual = residual - d.scale * d.constants_of(d.whitener(residual))[d.unit]
    return float(np.sum(d.trust * (residual / d.stated) ** 2) / np.sum(d.trust))


def held_out_of(data: Sequence[ChannelData], before: State, after: State, blocks: str, gain: float) -> HeldOut:
    """Before and after over channels."""
    rows = np.array([float(len(d.use)) for d in data])
    first = float(np.average([mean_square(d, before) for d in data], weights=rows)) if data else 0.0
    last = float(np.average([mean_square(d, after, centred=True) for d in data], weights=rows)) if data else 0.0
    floor = min(float(np.average([d.spread**2 for d in data], weights=rows)), last) if data else 1.0
    share = (first - last) / max(first - floor, 1e-9)
    return HeldOut(blocks=blocks, before=first, after=last, explained=float(np.clip(share, -1.0, 1.0)), gain=gain)


def statement(sentence: str, where: dict[str, list[str] | list[float]], twins: Sequence[str]) -> str:
    """The sentence, where it holds, and what cannot be told from it."""
    text = sentence.strip()
    places = []
    for column, bounds in where.items():
        if bounds and isinstance(bounds[0], str):
            places.append(f"{column} {', '.join(str(b) for b in bounds)}")
        elif len(bounds) == 2:
            places.append(f"{column} {bounds[0]:.4g} to {bounds[1]:.4g}")
    if places:
        text += " Where: " + "; ".join(places) + "."
    if twins:
        text += " This table cannot tell it from " + " or ".join(twins) + "."
    return text


def _size_of(total: FloatArray, law: Law, sim: FloatArray) -> str:
    if law.relative:
        share = float(np.nanquantile(np.abs(total / np.where(sim == 0, np.nan, sim)), 0.98))
        return f"{100 * share:.2g} %"
    return f"{float(np.quantile(np.abs(total), 0.98)):.3g} {law.unit}"
