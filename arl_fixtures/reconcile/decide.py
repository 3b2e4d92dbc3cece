"""From what the search found to findings: which names stand, what is unknown, what is only calibration.

The adequacy gate: a name stands only if, with it, the columns predict next to nothing of what is left. A wrong name
is worse than none: where the gate fails, the channel's mismatch is `unknown` and gets an empirical law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.acceptance import TWIN_GAIN, worth
from arl_fixtures.reconcile.calibration_findings import constant_finding, line_finding
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.consequences import is_back_action, is_within_noise_law, read_alike, without_back_actions
from arl_fixtures.reconcile.cross_fit import cross_fitted
from arl_fixtures.reconcile.dead import bring_back, dead_first, leave_out_their_scatter
from arl_fixtures.reconcile.diagnosis import ChannelFit, Finding
from arl_fixtures.reconcile.effect import Effect, State
from arl_fixtures.reconcile.findings import law_finding, named_finding, ordered, pattern_finding, scatter_finding
from arl_fixtures.reconcile.fit import Fit, finish, fit
from arl_fixtures.reconcile.followed import followed_law
from arl_fixtures.reconcile.free_constants import constant_z
from arl_fixtures.reconcile.held_out import held_out_without, mean_square
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.law_of_rest import law_of_rest
from arl_fixtures.reconcile.misfit import MISFIT_SHARE
from arl_fixtures.reconcile.one_cause import join_readouts
from arl_fixtures.reconcile.patterns import PATTERN_GAIN, Pattern, find_patterns, is_calibration
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.rivals import (
    has_other_place,
    is_outdone,
    is_structure,
    lies_where_names_act,
    pictures_beside,
    plain_gain,
    says_the_same,
    share_beside,
)
from arl_fixtures.reconcile.roles import FIELD_COLUMNS, PIXEL, PIXEL_COLUMNS, Role
from arl_fixtures.reconcile.search import LEVEL_FURTHER, Found, Search
from arl_fixtures.reconcile.shared_scatter import Scatter, find_scatter
from arl_fixtures.reconcile.spots import spots_instead
from arl_fixtures.reconcile.standing import Standing
from arl_fixtures.reconcile.steadiness import is_unsteady
from arl_fixtures.reconcile.terms import Term, default_values, forward
from arl_fixtures.reconcile.unit_conditions import law_of_units
from arl_fixtures.reconcile.unit_strengths import with_strengths

LEAST_ENERGY = 1.0
"""Squared standard errors by which an effect must move a channel to act in it."""
LEAST_OUTSIDE = 4.0
"""Log-likelihood that a name must gain in channels where it stands, to stand though it does not in others."""
UNKNOWN_SHARE = 0.08
"""Share above which what is left is reported as a finding of its own."""
SCATTER_SHARE = 0.4
"""Share of what names do to the groups of a channel below which what is left between these is their own error."""
CONSTANT_Z = 8.0
"""A unit's constant gain or offset this many standard errors from none is a mismatch if nothing else explains it."""


class Decision:
    """Findings of one search.

    Args:
        search: with its problems and variants.
        found: its result.
        effects: the library.
    """

    def __init__(self, search: Search, found: Found, effects: Sequence[Effect]) -> None:
        self.search, self.found = search, found
        self.effects = [effect for effect in effects if effect.id not in search.failed]
        self.problem: Problem = found.problem
        bring_back(self.problem)
        self.best: Fit = found.best
        self.patterns: list[Pattern] = []
        self.laws: list[Law] = []
        self.scatters: list[Scatter] = []
        self.fallen: dict[str, Law] = {}
        self.refused: set[str] = set()
        self.asked_for_spots = False
        self.after = dict(found.after)
        self.standing = Standing(self)

    def run(self) -> tuple[list[Finding], dict[str, ChannelFit]]:
        """All findings, strongest first, and the agreement of each channel."""
        self._add_patterns()
        while self._gate():
            pass  # what stands beside fewer names is asked anew
        own = without_back_actions(self.best.terms, self.problem.view)
        if len(own) < len(self.best.terms):
            self._keep(own)
            self._look()
        self._tell_units_apart()
        self._find_laws()
        self._drop_shadowed()
        self._find_scatters()
        findings = join_readouts(
            [named_finding(self, index) for index in range(len(self.best.terms))],
            lambda some, channels: held_out_without(
                self, [t for f in some for t in f.terms], channels, sum(f.strength for f in some)
            ),
        )
        names = len(findings)
        findings += [pattern_finding(self, p) for p in self.patterns]
        findings += [law_finding(self, law) for law in self.laws]
        findings += [scatter_finding(self, s) for s in self.scatters]
        acted = {channel for finding in findings for channel in finding.channels}
        findings += [
            constant_finding(self, d) for d in self.problem.data
            if d.channel.name not in acted and self._is_constant(d)
        ]  # fmt: skip
        if not findings:  # beside others, calibration is no finding
            findings = [line_finding(self, d) for d in self.problem.data if d.channel.name in self.search.lines]
        return ordered(findings, names), self._fits()

    def _tell_units_apart(self) -> None:
        """Let units that are not alike have the names in strengths of their own."""
        terms = with_strengths(self.problem, self.best.terms)
        if any(t.strengths for t in terms):
            self.best = finish(self.problem, replace(self.best, terms=terms))
            self._look()

    def _is_constant(self, d: ChannelData) -> bool:
        """Whether a channel that no finding moves is off by a constant that no scatter of its steps explains."""
        return d.calibrated and constant_z(d, self.problem.view.fresh_state()) > CONSTANT_Z

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
        found = find_patterns(self.problem, self.effects, self.best.terms)
        if self._add_spots(found):
            found = find_patterns(self.problem, self.effects, self.best.terms)
        for pattern in dead_first(self.problem, self.effects, self.best.terms, found)[:2]:
            calibration = is_calibration(self.problem, pattern, self.best.terms)
            shares = self._shares(pattern, self.best.terms)
            if calibration or self.patterns or pattern.gain <= max(shares, default=0.0):
                continue
            if is_unsteady(self.found.looker, [*self.best.terms, pattern.bare], pattern.bare):
                continue
            if shares or not has_other_place(self.found.looker, self.best.terms, pattern):
                self.patterns.append(pattern)
        if self.patterns:
            leave_out_their_scatter(self.problem, self.patterns)
            self._look()
            pictures = pictures_beside(self.best.terms, self.patterns)
            best = self.search.prune(self.best, self.found.screening, certain=pictures) if pictures else self.best
            if len(best.terms) < len(self.best.terms):  # it had the likeness of the pattern
                self.best, self.patterns = best, []
                self._add_patterns()

    def _shares(self, pattern: Pattern, terms: Sequence[Term]) -> list[float]:
        """What a pattern must gain beside each of these terms that acts in its channels."""
        channels = set(pattern.term.variant.channels)
        return [
            share_beside(self.problem, self.best.terms, t) for t in terms if channels & set(t.variant.channels)
        ]  # fmt: skip

    def _add_spots(self, patterns: Sequence[Pattern]) -> bool:
        """Take spots in the place of the first pattern of gains, where they say as much; tells whether it did."""
        pattern = next((p for p in patterns if p.is_dense), None)
        if pattern is None or self.patterns or self.found.screening is None or self.asked_for_spots:
            return False
        others = [t for t in self.best.terms if not t.effect.several]  # a spot beside spots is another one
        if pattern.gain <= max(self._shares(pattern, others), default=0.0):
            return False
        self.asked_for_spots = True  # those that fell would come back as long as the pattern stands
        threshold = self.found.screening.threshold(LEVEL_FURTHER)
        spots = spots_instead(self.search, self.best, pattern, threshold)
        if spots is None:
            return False
        self.problem.refit_scatter(spots.state, lost=float(len(spots.keys)))
        self._keep(spots.terms)
        self._look()
        return True

    def _look(self) -> None:
        state = forward(self.terms, self.problem.view)
        for d in self.problem.data:
            self.after[d.channel.name] = self.found.looker.look(d, state)

    def _gate(self) -> bool:
        """Drop the names of channels in which too much stays predictable, or which a law without physics beats.

        And names whose strength is another one under other conditions, errors of readings that several show alike,
        and names that undo each other. Tells whether any fell.
        """
        if not self.best.terms:
            return False
        bad = {d.channel.name for d in self.problem.data if self.standing.is_left(d)}
        bad |= {d.channel.name for d in self.problem.data if d.channel.name not in bad and self.standing.is_beaten(d)}
        unsteady = [t for t in self.best.terms if is_unsteady(self.found.looker, self.terms, t)]
        alike = read_alike(self.best.terms, self.problem.view)
        undone = {d.channel.name: self.standing.undone(d) for d in self.problem.data}
        void = [t for t in self.best.terms if any(t in terms for terms in undone.values())]
        gone = (*unsteady, *alike, *void)
        kept = tuple(t for t in self.best.terms if not self._mostly_in(t, bad) and t not in gone)
        if len(kept) == len(self.best.terms):
            return False
        if self._widen(kept):
            return True
        mismatches = [self._mismatch_of(t) for t in gone]
        self.fallen |= {name: law for name, law in mismatches if not undone[name]}
        self.refused |= {t.effect.id for t in unsteady}
        for d in self.problem.data:
            d.follow(forward(kept, self.problem.view))
        self._keep(kept)
        # a name may only have mended one that does not stand
        self.best = self.search.prune(self.best, self.found.screening)
        self.patterns = []  # found beside what does not stand
        self._look()
        self._add_patterns()
        return True

    def _widen(self, kept: Sequence[Term]) -> bool:
        """Give a name that would fall the freedom that its effect has besides; tells whether it gains by it."""
        for index, term in enumerate(self.best.terms):
            if term in kept:
                continue
            for variant in term.effect.wider(term.variant, self.problem.view):
                wide = replace(term, variant=variant, values={**default_values(variant), **term.values})
                terms = tuple(wide if k == index else t for k, t in enumerate(self.best.terms))
                found = finish(self.problem, fit(self.problem, terms, rounds=8))
                if worth(found, finish(self.problem, self.best)) > TWIN_GAIN:
                    self.best, self.patterns = found, []
                    self._look()
                    self._add_patterns()
                    return True
        return False

    def _keep(self, terms: Sequence[Term]) -> None:
        """Fit the names that are left anew."""
        self.best = finish(self.problem, fit(self.problem, terms, rounds=4))

    def _mismatch_of(self, term: Term) -> tuple[str, Law]:
        """Channel that a term moves most, and a law without terms: what passed for a name is a mismatch for sure."""
        energy = self.energy(term)
        name = max(energy, key=lambda n: energy[n], default=term.variant.channels[0])
        drivers = [c for c in term.variant.drivers if c in self.found.looker.features] or list(term.variant.drivers)
        relative = any(d.channel.name == name and d.channel.role is not Role.DISTANCE for d in self.problem.data)
        gain = plain_gain(self.problem, self.best.terms, term)
        return name, Law(channel=name, relative=relative, terms=[], drivers=drivers, gain=gain)

    def _mostly_in(self, term: Term, names: set[str]) -> bool:
        """Whether a name acts mostly in some channels, or only these gain by it."""
        energy = self.energy(term)
        total, there = sum(energy.values()), sum(v for k, v in energy.items() if k in names)
        if not there:
            return False
        return there > 0.5 * total or self._gain_outside(term, names) < LEAST_OUTSIDE

    def _gain_outside(self, term: Term, names: set[str]) -> float:
        """Drop of half the sum of squares that a term brings in other channels, beside the other terms."""
        states = (forward(some, self.problem.view) for some in ([t for t in self.terms if t is not term], self.terms))
        others = [d for d in self.problem.data if d.channel.name not in names]
        before, after = (sum(float(np.sum(d.whiten(d.residual(s)) ** 2)) for d in others) for s in states)
        return 0.5 * (before - after)

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
        return {name: value for name, value in energy.items() if value > LEAST_ENERGY}

    def _find_laws(self) -> None:
        state, features = forward(self.terms, self.problem.view), self.found.looker.features
        for d in self.problem.data:
            name = d.channel.name
            if d.tell_step_scatter(d.residual(state)):  # after all names: a dark signal is one of them
                self.found.looker.calibrate(d, state)
                self.after[name] = self.found.looker.look(d, state)
            acting = [t for t in self.terms if name in self.energy(t)]
            acted = bool(acting)
            if acted and d.channel.role is Role.SCATTER and not is_structure(self.found.before[name]):
                continue  # what is left came with a name's side effect on the scatter
            if lies_where_names_act(self.problem, d, acting, self.terms):
                continue  # and this is what a name cannot know of the edges that it moves
            if not acted or self.standing.left_share(name) > UNKNOWN_SHARE or name in self.standing.causes.found:
                try:
                    law = law_of_rest(self.found.looker, d, state, self.after[name], beside=acted)
                except np.linalg.LinAlgError as error:  # costs this law, not the answer
                    self.search.failed[f"law of {name}"] = f"was not found: {error}"
                    continue
                law = law or (None if acted else self.fallen.get(name) or law_of_units(self.problem, d, state))
                # trees beside a name only mend its shape, and so does what says the same in other words
                if law is None or (acted and (not law.terms or says_the_same(acting, law.drivers))):
                    continue
                if d.channel.role is Role.SCATTER and is_within_noise_law(law, features, state, acted=acted):
                    continue
                if not is_back_action(law, features, state, self.terms, self.problem.view):
                    self.laws.append(law)

    def _find_scatters(self) -> None:
        """What groups share beyond what is declared: a finding, or an unknown where it follows a condition."""
        lawful = {law.channel for law in self.laws}
        scatters = [
            s for s in find_scatter(self.problem, self.effects, self.final_state())
            if s.channel not in lawful and s.value > SCATTER_SHARE * self._moved(s) and not self._is_jitter(s)
        ]  # fmt: skip
        self.scatters = [s for s in scatters if not s.driver][:1]
        acted = {name for term in self.terms for name in self.energy(term)}
        for s in scatters:
            if s.driver and s.channel not in acted | {law.channel for law in self.laws}:
                d = next(d for d in self.problem.data if d.channel.name == s.channel)
                relative = d.channel.role in {Role.INTENSITY, Role.SCATTER}
                terms = followed_law(self.problem, d, s.level, self.final_state(), s.driver)
                law = Law(channel=s.channel, relative=relative, terms=terms, drivers=[s.driver], gain=s.gain)
                self.laws.append(law)

    def _is_jitter(self, scatter: Scatter) -> bool:
        """Whether images scatter because a name says that all rows of a frame do so together."""
        return scatter.level == "frame" and any(
            term.effect.common and f"{scatter.channel}_std" in term.variant.channels for term in self.best.terms
        )

    def _moved(self, scatter: Scatter) -> float:
        """Standard deviation, over a scatter's groups, of what the names and patterns do to its channel."""
        d = next(d for d in self.problem.data if d.channel.name == scatter.channel)
        level = next(level for level in d.levels if level.name == scatter.level)
        named = forward(self.terms, self.problem.view)[d.channel.name] - self.problem.view.sim[d.channel.name]
        count = np.maximum(np.bincount(level.code, minlength=level.count), 1)
        return float(np.std(np.bincount(level.code, named[d.use], minlength=level.count) / count))

    def _drop_shadowed(self) -> None:
        """Drop patterns of pixels that a law explains as well: its pixels merely see different conditions."""
        kept = [p for p in self.patterns if not any(self._shadows(law, p) for law in self.laws)]
        kept = [p for p in kept if not is_outdone(self.found.looker, self.best.terms, p, self.leading)]
        if len(kept) != len(self.patterns):
            self.patterns, self.laws = kept, []
            self._look()
            self._find_laws()

    def _shadows(self, law: Law, pattern: Pattern) -> bool:
        """Whether pixels share next to nothing any more where a law is found without the pattern."""
        if law.channel not in pattern.term.variant.channels:
            return False
        if law.gain > pattern.gain:
            return True
        d = next(d for d in self.problem.data if d.channel.name == law.channel)
        state = forward(self.best.terms, self.problem.view)
        alone = law_of_rest(self.found.looker, d, state, self.found.looker.look(d, state))
        if alone is None:
            return False
        numbers = PIXEL_COLUMNS | {PIXEL, *FIELD_COLUMNS}  # a table over these is the pattern in other words
        of_more = [t for t in alone.terms if not {a.column for a in t.axes} <= numbers]
        if len(of_more) < len(alone.terms):
            alone = replace(alone, terms=of_more, trees=[])
        add = alone.correction(self.found.looker.features, state[law.channel])
        left = d.measured - d.expect * (state[law.channel] + add)[d.use]
        shared = d.fit_scatter(left)[0] - d.fit_scatter(left, without=("pixel",))[0]
        return shared < max(PATTERN_GAIN, MISFIT_SHARE * pattern.gain)

    def leading(self, d: ChannelData) -> list[str]:
        """Columns that matter most to a channel's mismatch, with names and without."""
        before, after = self.found.before[d.channel.name], self.after[d.channel.name]
        drivers = [c for t in self.best.terms for c in t.variant.drivers if c in self.found.looker.features]
        return list(dict.fromkeys([*before.leading()[:3], *after.leading()[:2], *drivers]))

    def cross_fitted(self) -> State:
        """Corrected simulation in which each fold's rows use parameters of the other folds (one Newton step)."""
        patterns = tuple(p.term for p in self.patterns)
        return cross_fitted(self.problem, self.best, patterns, self.final_state())

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
