"""From what the search found to findings: which names stand, what is unknown, what is only calibration.

The adequacy gate: a name stands only if, with it, the columns predict next to nothing of what is left. A wrong name
is worse than none: where the gate fails, the channel's mismatch is `unknown` and gets an empirical law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from arl_fixtures.reconcile.calibration_findings import constant_finding, line_finding
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.consequences import without_back_actions
from arl_fixtures.reconcile.cross_fit import cross_fitted
from arl_fixtures.reconcile.dead import bring_back
from arl_fixtures.reconcile.diagnosis import ChannelFit, Finding
from arl_fixtures.reconcile.effect import Effect, State
from arl_fixtures.reconcile.findings import law_finding, named_finding, ordered, pattern_finding, scatter_finding
from arl_fixtures.reconcile.fit import Fit, finish, fit
from arl_fixtures.reconcile.fitted_scales import hold_unneeded
from arl_fixtures.reconcile.free_constants import constant_z
from arl_fixtures.reconcile.gate import drop_fallen, drop_needless
from arl_fixtures.reconcile.held_out import held_out_without, mean_square
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.near_miss import drop_doubtful, name_near_miss
from arl_fixtures.reconcile.one_cause import join_readouts
from arl_fixtures.reconcile.patterns import Pattern
from arl_fixtures.reconcile.patterns_beside import add_patterns, drop_shadowed, find_smooth
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.rivals import is_structure
from arl_fixtures.reconcile.search import Found, Search
from arl_fixtures.reconcile.search_again import name_who_was_hidden
from arl_fixtures.reconcile.shared_name import share_names
from arl_fixtures.reconcile.shared_scatter import Scatter
from arl_fixtures.reconcile.standing import Standing
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.told_elsewhere import drop_told_elsewhere
from arl_fixtures.reconcile.unit_strengths import with_strengths
from arl_fixtures.reconcile.wandering import drop_wanderers, is_slow
from arl_fixtures.reconcile.what_is_left import find_laws, find_scatters

LEAST_ENERGY = 1.0
"""Squared standard errors by which an effect must move a channel to act in it."""
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
        if drop_wanderers(self):
            self.look()
        add_patterns(self)
        at_first = frozenset(t.effect.id for t in self.best.terms)
        while drop_fallen(self):
            pass  # what stands beside fewer names is asked anew
        name_who_was_hidden(self, at_first)
        own = without_back_actions(self.best.terms, self.problem.view)
        if len(own) < len(self.best.terms):
            self.keep(own)
            self.look()
        self._tell_units_apart()
        hold_unneeded(self)
        find_laws(self)
        for drop in (drop_doubtful, drop_needless, drop_shadowed, drop_told_elsewhere):
            if drop(self):
                self.laws = []
                self.look()
                hold_unneeded(self)
                find_laws(self)
        name_near_miss(self)
        find_smooth(self)
        find_scatters(self)
        named = self._named()
        if share_names(self, named):
            named = self._named()
        findings = join_readouts(
            named,
            lambda some, channels: held_out_without(
                self, [t for f in some for t in f.terms], channels, sum(f.strength for f in some)
            ),
        )
        names = len(findings)
        findings += [pattern_finding(self, p) for p in self.patterns]
        findings += [law_finding(self, law) for law in self.laws]
        findings += [scatter_finding(self, s) for s in self.scatters]
        acted = {channel for finding in findings for channel in finding.channels}
        # what a name does to a channel by the same amount everywhere is a constant that calibration takes up
        acted |= {channel for finding in findings for t in finding.terms for channel in t.variant.channels}
        findings += [
            constant_finding(self, d) for d in self.problem.data
            if d.channel.name not in acted and self._is_constant(d)
        ]  # fmt: skip
        if not findings:  # beside others, calibration is no finding
            findings = [line_finding(self, d) for d in self.problem.data if d.channel.name in self.search.lines]
        return ordered(findings, names), self._fits()

    def _named(self) -> list[Finding]:
        return [named_finding(self, index) for index in range(len(self.best.terms))]

    def _tell_units_apart(self) -> None:
        """Let units that are not alike have the names in strengths of their own."""
        terms = with_strengths(self.problem, self.best.terms)
        if any(t.strengths for t in terms):
            self.best = finish(self.problem, replace(self.best, terms=terms))
            self.look()

    def _is_constant(self, d: ChannelData) -> bool:
        """Whether a channel that no finding moves is off by a constant that no scatter of its steps explains."""
        untouched = self.problem.view.fresh_state()
        return d.calibrated and constant_z(d, untouched) > CONSTANT_Z and not is_slow(d, untouched)

    # ---- decisions -------------------------------------------------------------------------------------------

    @property
    def terms(self) -> tuple[Term, ...]:
        """Accepted effects, patterns included."""
        return (*self.best.terms, *(p.term for p in self.patterns))

    def final_state(self, without: Term | None = None) -> State:
        """Corrected simulation of the problem's rows with effects (or all but one), patterns and laws."""
        state = forward([t for t in self.terms if t is not without], self.problem.view)
        for law in self.laws:
            add = law.correction(self.found.looker.features, state[law.channel])
            state[law.channel] = state[law.channel] + add
        return state

    def look(self) -> None:
        """Structure that stays in each channel, as the names are now."""
        state = forward(self.terms, self.problem.view)
        for d in self.problem.data:
            self.after[d.channel.name] = self.found.looker.look(d, state)

    def keep(self, terms: Sequence[Term]) -> None:
        """Fit the names that are left anew."""
        self.best = finish(self.problem, fit(self.problem, terms, rounds=4))

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
