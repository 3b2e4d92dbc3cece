"""Find the effects: screen, fit the best jointly, accept only what chance and shared errors cannot give, look again.

Forward selection with a swap and a backward pass. A candidate is judged by the marginal likelihood with the group
scatters at their best for it, less a price per parameter, and must pass a test that is robust to errors shared by
steps, angles or pixels. Small problems rank (a part of the rows), the full one decides.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from arl_fixtures.reconcile.acceptance import (
    PATTERN_ODDS,
    Ranked,
    acts_alone,
    evidence,
    is_as_good,
    is_repeat,
    is_rounding,
    lacks_essential,
    simplest,
    worth,
)
from arl_fixtures.reconcile.calibrated_units import (
    Lines,
    calibrate_simulation,
    find_lines,
    free_fitted_zeros,
    free_lines,
)
from arl_fixtures.reconcile.carried_gains import carry_gains
from arl_fixtures.reconcile.columns import Columns, FloatArray, IntArray
from arl_fixtures.reconcile.crowded_out import only, other_variants, simpler_lookalikes, where_nothing_acts
from arl_fixtures.reconcile.dead import leave_out_dead
from arl_fixtures.reconcile.derived_rays import derive_rays
from arl_fixtures.reconcile.effect import Effect
from arl_fixtures.reconcile.effects_bench import is_zero_fitted
from arl_fixtures.reconcile.first_round_again import behind_zeros, with_constants_held
from arl_fixtures.reconcile.fit import Fit, finish, fit, hold_back_edges
from arl_fixtures.reconcile.fitted_scales import free_scales, with_fitted_scales
from arl_fixtures.reconcile.grouping import find_groups, typical_gaps
from arl_fixtures.reconcile.misfit import is_misfit
from arl_fixtures.reconcile.noise import ordered_like
from arl_fixtures.reconcile.pilot import Looker, Structure
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.ranking import POLISHED, polished, rank
from arl_fixtures.reconcile.readings import smooth_readings
from arl_fixtures.reconcile.sampling import draw_rows
from arl_fixtures.reconcile.scattered import more_than_rows
from arl_fixtures.reconcile.scores import Candidate
from arl_fixtures.reconcile.screen import Screening, Surcharge, all_variants, screen
from arl_fixtures.reconcile.settling import gains_of, in_each_place, settle, shortlist
from arl_fixtures.reconcile.small_problem import small_part
from arl_fixtures.reconcile.step_screen import where_steps_scatter_less
from arl_fixtures.reconcile.terms import Term, forward
from arl_fixtures.reconcile.two_in_place import SECOND_NAME, sides

FULL_ROWS = 48_000
MOST_TERMS = 4
LEVEL_NAME, LEVEL_FURTHER = 0.95, 0.99
"""Quantile of chance's best gain by which a first name and further ones are judged, see `Screening`."""

Progress = Callable[[str, float], None]


@dataclass(slots=True, kw_only=True)
class Stage:
    """One round of the search: what stood at its start, what was tried, what won.

    Attributes:
        gain: of what won, with the second effect where it is the first of two (see `_rather_two`).
    """

    base: Fit
    threshold: float
    p_value: float
    ranked: list[Ranked]
    chosen: Ranked | None
    gain: float = 0.0


@dataclass(slots=True, kw_only=True)
class Found:
    """Everything the search learnt.

    Attributes:
        problem: the full problem, with scatters of the best fit.
        null: fit without any effect.
        best: fit of the accepted effects.
        stages: rounds in order.
        before: physics-free structure per channel before any effect.
        after: the same after the accepted effects.
    """

    problem: Problem
    looker: Looker
    null: Fit
    best: Fit
    stages: list[Stage]
    before: dict[str, Structure]
    after: dict[str, Structure] = field(default_factory=dict)
    screening: Screening | None = None


class Search:
    """Search of one table.

    Args:
        columns: the table.
        effects: library.
        progress: called with a sentence and the share done.
    """

    def __init__(self, columns: Columns, effects: Sequence[Effect], progress: Progress | None = None) -> None:
        self.progress: Progress = progress if progress is not None else (lambda _text, _share: None)
        self.columns = columns
        derive_rays(columns)
        self.smoothed = smooth_readings(columns)
        columns.sweep_gap_deg, columns.frame_gap_s = typical_gaps(columns)
        self.groups = find_groups(columns)
        self.failed: dict[str, str] = {}
        self.progress("first look", 0.05)
        self.lines: Lines = {}
        self.scaled: dict[str, FloatArray] = {}
        self.before: dict[str, Structure] = {}
        self._open(draw_rows(columns, self.groups, FULL_ROWS))
        self.lines = find_lines(self.full, self.before)
        if self.lines:
            calibrate_simulation(columns, self.groups.unit_columns, self.lines)
            self._open(self.full.view.rows)
        if leave_out_dead(self.full, effects):
            self.before = self._structure()
        self.scaled = with_fitted_scales(self.full, self.before)
        free_scales(self.full, self.scaled)
        self.small = small_part(self.full)
        self._free(self.small)
        self.variants = all_variants(self.small, effects, self.failed)
        self.gains: dict[int, float] = {}
        self.surcharge = Surcharge()
        untouched = self.full.view.fresh_state()
        self.shared = any(more_than_rows(d, untouched) for d in self.full.data)

    def _open(self, rows: IntArray) -> None:
        """The full problem of some rows, and what is to be explained in it."""
        self.full = Problem(self.columns, rows, self.groups)
        self._free(self.full)
        self.looker = Looker(self.full)
        self.before = self._structure()

    def _free(self, problem: Problem) -> None:
        """Let free what whoever made the table has fitted to it."""
        free_lines(problem, self.lines)
        free_fitted_zeros(problem)
        free_scales(problem, self.scaled)

    def _structure(self) -> dict[str, Structure]:
        empty = forward([], self.full.view)
        return {d.channel.name: self.looker.calibrate(d, empty) for d in self.full.data}

    def prune(self, best: Fit, chance: Screening | None, certain: Container[str] = ()) -> Fit:
        """Drop, weakest first, what no longer gains a name's share of the threshold (the `certain`: all of it)."""
        while best.terms and chance is not None:
            threshold = self._first(chance) if len(best.terms) == 1 else chance.threshold(LEVEL_FURTHER)
            gains = []
            for index in range(len(best.terms)):
                rest = tuple(t for k, t in enumerate(best.terms) if k != index)
                without = finish(self.full, fit(self.full, rest, rounds=3))
                odds = PATTERN_ODDS if best.terms[index].effect.id in certain else 1.0
                gains.append((odds * worth(best, without), index, without))
            weakest = min(gains, key=lambda item: item[0])
            if weakest[0] >= PATTERN_ODDS * threshold:
                break
            best = weakest[2]
            self.gains = gains_of(self.full, best)
        return best

    def _seen_anew(self, best: Fit) -> Fit:
        """A fit again with the spread, outliers and scatters that it leaves."""
        self._look_again(best)
        return finish(self.full, fit(self.full, best.terms, rounds=4))

    def _look_again(self, best: Fit) -> None:
        """Set spread, outliers and group scatters anew from what a fit leaves, in both problems."""
        untouched = self.full.view.sim
        for d in self.full.data:
            if best.state[d.channel.name] is not untouched[d.channel.name]:
                moved = (best.state[d.channel.name] - untouched[d.channel.name])[d.use]
                if is_zero_fitted(self.full.view) and np.std(moved) > np.abs(np.mean(moved)):
                    d.free_zero()  # unless what was named is a zero itself
                d.follow(best.state)
                self.looker.calibrate(d, best.state)
        hold_back_edges(self.full, best)
        carry_gains(self.full, best.state)
        if self.small is not self.full:
            for part in self.small.data:
                whole = next(d for d in self.full.data if d.channel.name == part.channel.name)
                place = np.searchsorted(self.full.view.rows[whole.use], self.small.view.rows[part.use])
                part.trust, part.spread = whole.trust[place], whole.spread
                part.levels = ordered_like(whole.levels, part.levels)
                if any(level.name == "unit" for level in whole.levels):
                    part.free_zero()
                part.relate_to(whole.scale[place])
                part.differ_like(whole, place)
                part.rebuild(whole.tau)
            carry_gains(self.small, forward(best.terms, self.small.view))

    def run(self) -> Found:
        """All rounds."""
        best = finish(self.full, fit(self.full, ()))
        null = best
        stages: list[Stage] = []
        chance: Screening | None = None
        for round_number in range(MOST_TERMS):
            self.progress(f"search, round {round_number + 1}", 0.1 + 0.15 * round_number)
            screening = self.candidates(best.terms, with_chance=chance is None)
            chance = screening if chance is None else chance
            self.surcharge = chance.surcharge(LEVEL_FURTHER if best.terms else LEVEL_NAME)
            stage = self.ask(best, screening, chance)
            if round_number == 0:
                stage = with_constants_held(self, stage, chance)
                stage = behind_zeros(self, stage, chance)
            stages.append(stage)
            if stage.chosen is None:
                break
            best = self._taken(stage)
        if stages and chance is not None:
            best = self._look_beside(self.prune(best, chance), stages, chance)
            best = self._as_steps_differ(best, stages[-1])
        self.progress("what is left", 0.8)
        found = Found(
            problem=self.full, looker=self.looker, null=null, best=best, stages=stages, before=self.before,
            screening=chance,
        )  # fmt: skip
        found.after = {
            d.channel.name: (self.looker.look(d, best.state) if best.terms else self.before[d.channel.name])
            for d in self.full.data
        }
        return found

    def further(self, best: Fit, chance: Screening, refused: Container[str], *, apart: bool = False) -> Fit:
        """One more round beside names that stand where others fell; effects that are `refused` are not asked.

        With `apart` only those that tell steps apart where what stands acts within them, or the reverse.
        """
        best = self._seen_anew(best)
        self.gains = gains_of(self.full, best)
        found = self.candidates(best.terms, with_chance=False)
        left = [c for c in found.candidates if c.term.effect.id not in refused]
        if apart:
            left = [c for c in left if acts_alone(self.small, (*best.terms, c.term))]
        return self._taken(self.ask(best, replace(found, candidates=tuple(left)), chance))

    def _look_beside(self, best: Fit, stages: list[Stage], chance: Screening) -> Fit:
        """One more round for channels on which nothing acts: what mends a strong effect may have crowded them out."""
        untouched = self.full.view.sim
        free = {name for name in self.full.names if best.state[name] is untouched[name]}
        if not best.terms or not free:
            return best
        with only(self.full, free), only(self.small, free):
            screening = where_nothing_acts(self.candidates((), with_chance=False), free)
            promise = max((c.gain for c in screening.candidates), default=0.0)
            if promise < chance.threshold(LEVEL_FURTHER):
                return best
            stage = self.ask(finish(self.full, fit(self.full, ())), screening, chance)
        sure = chance.threshold(LEVEL_FURTHER)  # it is a further look
        if stage.chosen is None or evidence(stage.chosen, self.surcharge) <= sure:
            return best
        beside = finish(self.full, fit(self.full, (*best.terms, stage.chosen.fit.terms[-1]), rounds=4))
        stages.append(replace(stage, base=best, chosen=replace(stage.chosen, fit=beside)))
        return self._taken(stages[-1])

    def _as_steps_differ(self, best: Fit, stage: Stage) -> Fit:
        """The fit with steps that differ by an amount where they clearly do, and the variants that then do best.

        Asked once the names are found: a dark signal is one of them, and would be called scatter without its name.
        """
        untouched = self.full.view.sim
        told = [
            d for d in self.full.data
            if best.state[d.channel.name] is not untouched[d.channel.name]
            and d.tell_step_scatter(d.residual(best.state))
        ]  # fmt: skip
        if not told:
            return best
        # what was taken for a name's shape may have been the steps'
        return in_each_place(self, self._seen_anew(best), stage)

    def _taken(self, stage: Stage) -> Fit:
        """The fit with what a round has chosen; its base where that is nothing."""
        if stage.chosen is None:
            return stage.base
        settled = settle(self, stage.chosen.fit, stage)
        self.full.refit_scatter(settled.state, lost=float(len(settled.keys)))  # those that hid it would draw it back
        best = self._seen_anew(fit(self.full, settled.terms, rounds=4))
        self.gains = gains_of(self.full, best)  # with the scatters that it leaves, not with those that hid it
        return best

    def candidates(self, terms: Sequence[Term], *, with_chance: bool) -> Screening:
        """Candidates, also with a smaller scatter of the steps: what a candidate explains may pass for it."""
        found = screen(self.small, self.variants, terms, with_chance=with_chance)
        return where_steps_scatter_less(self.small, self.variants, terms, found)

    def ask(self, base: Fit, screening: Screening, chance: Screening) -> Stage:
        """One round: rank the candidates beside a base, and choose what may be named."""
        threshold = chance.threshold(LEVEL_FURTHER) if base.terms else self._first(chance)
        ranked = self.rank(base, shortlist([c for c in screening.candidates if not is_repeat(base, c)]))
        sure = self._sure(base, chance, ranked)
        close = [r for r in sure if is_as_good(r, sure[0])]
        gain = 0.0
        chosen = min(close, key=simplest, default=None)
        if chosen is not None:
            chosen = self._nearest([r for r in close if r.candidate.free == chosen.candidate.free], chosen)
        if chosen is not None and ranked[0] is not chosen and ranked[0].gain > 3.0 * max(chosen.gain, 1.0):
            chosen = None
        if chosen is not None:
            further = self.rank(base, other_variants(base, screening, chosen, ranked)[:POLISHED])
            better = [r for r in self._sure(base, chance, further) if not is_as_good(chosen, r)]
            if better:
                chosen = self._nearest([r for r in better if is_as_good(r, better[0])], better[0])
            simpler = self.rank(base, simpler_lookalikes(base, screening, chosen, ranked)[:POLISHED])
            best = chosen
            chosen = min(
                (r for r in self._sure(base, chance, simpler) if is_as_good(r, best)), key=simplest, default=chosen
            )
            chosen, gain = self._rather_two(base, screening, chance, chosen)
            ranked = sorted([*ranked, *further, *simpler], key=lambda r: -r.gain)
        p_value = chance.p_value(evidence(ranked[0], self.surcharge)) if ranked else 1.0
        return Stage(base=base, threshold=threshold, p_value=p_value, ranked=ranked, chosen=chosen, gain=gain)

    def _rather_two(
        self, base: Fit, screening: Screening, chance: Screening, chosen: Ranked
    ) -> tuple[Ranked, float]:  # fmt: skip
        """The stronger of two effects that say more than the chosen one, their parameters paid, else the chosen one.

        And what both of them gain, or the one.
        """
        single = [self.rank(base, part) for part in sides(screening, chosen)]
        best, gain, most = chosen, chosen.gain, chosen.gain + SECOND_NAME
        for one, other in product(*single):
            both = polished(self.full, base, other.candidate, (*one.fit.terms, other.fit.terms[-1]), rounds=4)
            first = max(self._sure(base, chance, [one, other]), key=lambda r: r.gain, default=None)
            if both.gain > most and first is not None:
                best, gain, most = first, both.gain, both.gain
        return best, gain

    def _nearest(self, close: Sequence[Ranked], chosen: Ranked) -> Ranked:
        """Of the chosen effect's drivers that tell the same the physically nearest, which comes first."""
        same = [r for r in close if r.candidate.term.effect is chosen.candidate.term.effect]
        return min(same, key=lambda r: (bool(r.candidate.term.unit), self._rank_of(r.candidate.term)))

    def _sure(self, base: Fit, chance: Screening, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Those that may be named beside the base's terms."""
        if not base.terms:
            least = other = self._first(chance)
        else:  # less where no name of its kind, of steps or within them, acts yet
            least, other = chance.threshold(LEVEL_FURTHER), chance.threshold(LEVEL_NAME)
        sure = [r for r in ranked if evidence(r, self.surcharge) > (other if r.alone else least)]
        return self.nameable(base, sure)

    def _first(self, chance: Screening) -> float:
        """What the first name must gain: all that free looks give where images or angles share what is not stated."""
        return chance.threshold(LEVEL_NAME) if self.shared else chance.first(LEVEL_NAME)

    def nameable(self, base: Fit, ranked: Sequence[Ranked]) -> list[Ranked]:
        """Those that do not only look like an effect of their own beside the base's terms."""
        fitting = [r for r in ranked if not is_misfit(self.full, base, r, self.gains)]
        return [r for r in fitting if not (is_rounding(self.full, base, r) or lacks_essential(r))]

    def _rank_of(self, term: Term) -> int:
        """Place of a term's variant among all: effects list their drivers in physical order."""
        return next(
            (k for k, (_, v) in enumerate(self.variants) if v.label == term.variant.label), len(self.variants)
        )

    def rank(self, base: Fit, candidates: Sequence[Candidate]) -> list[Ranked]:
        """Fit each candidate beside the base's terms, best first."""
        return rank(self.full, self.small, base, candidates)
