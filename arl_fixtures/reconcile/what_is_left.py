"""What names and patterns leave: empirical laws, and scatter that groups share beyond what is declared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arl_fixtures.reconcile.consequences import is_back_action, is_within_noise_law
from arl_fixtures.reconcile.followed import followed_law
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.law_of_one_unit import law_of_one_unit
from arl_fixtures.reconcile.law_of_rest import law_of_rest
from arl_fixtures.reconcile.noise import PARTS_OF_STEPS
from arl_fixtures.reconcile.rivals import is_structure, lies_where_names_act, says_the_same
from arl_fixtures.reconcile.roles import Role
from arl_fixtures.reconcile.shared_scatter import Scatter, find_scatter
from arl_fixtures.reconcile.terms import forward
from arl_fixtures.reconcile.unit_conditions import law_of_units
from arl_fixtures.reconcile.wandering import is_slow, is_wander

if TYPE_CHECKING:
    from arl_fixtures.reconcile.decide import Decision

UNKNOWN_SHARE = 0.08
"""Share above which what is left is reported as a finding of its own."""
SCATTER_SHARE = 0.4
"""Share of what names do to the groups of a channel below which what is left between these is their own error."""


def find_laws(decision: Decision) -> None:
    """Laws of channels in which no name acts, or in which names leave much or what has another cause."""
    state, features = forward(decision.terms, decision.problem.view), decision.found.looker.features
    for d in decision.problem.data:
        name = d.channel.name
        if d.tell_step_scatter(d.residual(state)):  # after all names: a dark signal is one of them
            decision.found.looker.calibrate(d, state)
            decision.after[name] = decision.found.looker.look(d, state)
        acting = [t for t in decision.terms if name in decision.energy(t)]
        acted = bool(acting)
        if acted and d.channel.role is Role.SCATTER and not is_structure(decision.found.before[name]):
            continue  # what is left came with a name's side effect on the scatter
        if lies_where_names_act(decision.problem, d, acting, decision.terms):
            continue  # and this is what a name cannot know of the edges that it moves
        if not acted or decision.standing.left_share(name) > UNKNOWN_SHARE or name in decision.standing.causes.found:
            law = law_of_rest(decision.found.looker, d, state, decision.after[name], beside=acted)
            if not acted:
                law = law or decision.fallen.get(name) or law_of_units(decision.problem, d, state)
                law = law or law_of_one_unit(decision.found.looker, d, state)
            # trees beside a name only mend its shape, and so does what says the same in other words
            if law is None or (acted and (not law.terms or says_the_same(acting, law.drivers))):
                continue
            if d.channel.role is Role.SCATTER and is_within_noise_law(law, features, state, acted=acted):
                continue
            if is_wander(d, state, law, features):
                continue
            if not is_back_action(law, features, state, decision.terms, decision.problem.view):
                decision.laws.append(law)


def find_scatters(decision: Decision) -> None:
    """What groups share beyond what is declared: a finding, or an unknown where it follows a condition."""
    lawful = {law.channel for law in decision.laws}
    scatters = [
        s for s in find_scatter(decision.problem, decision.effects, decision.final_state())
        if s.channel not in lawful and s.value > SCATTER_SHARE * _moved(decision, s) and not _is_jitter(decision, s)
    ]  # fmt: skip
    decision.scatters = [s for s in scatters if not s.driver][:1]
    acted = {name for term in decision.terms for name in decision.energy(term)}
    for s in scatters:
        if s.driver and s.channel not in acted | {law.channel for law in decision.laws}:
            d = next(d for d in decision.problem.data if d.channel.name == s.channel)
            state = decision.final_state()
            if s.level == "step" and is_slow(d, state):
                continue  # what wanders follows all that is slow
            relative = d.channel.role in {Role.INTENSITY, Role.SCATTER}
            terms = followed_law(decision.problem, d, s.level, state, s.driver)
            law = Law(channel=s.channel, relative=relative, terms=terms, drivers=[s.driver], gain=s.gain)
            decision.laws.append(law)


def _is_jitter(decision: Decision, scatter: Scatter) -> bool:
    """Whether images scatter because a name says that all rows of a frame do so together."""
    return scatter.level == "frame" and any(
        term.effect.common and f"{scatter.channel}_std" in term.variant.channels for term in decision.best.terms
    )


def _moved(decision: Decision, scatter: Scatter) -> float:
    """Standard deviation, over a scatter's groups, of what the names and patterns do to its channel.

    Over parts of steps beyond what they do to the whole step: what is wrong of that the step's own scatter takes up.
    """
    d = next(d for d in decision.problem.data if d.channel.name == scatter.channel)
    level = next(level for level in d.levels if level.name == scatter.level)
    named = forward(decision.terms, decision.problem.view)[d.channel.name] - decision.problem.view.sim[d.channel.name]
    count = np.maximum(np.bincount(level.code, minlength=level.count), 1)
    moved = np.bincount(level.code, named[d.use], minlength=level.count) / count
    if scatter.level not in PARTS_OF_STEPS:
        return float(np.std(moved))
    step = np.zeros(level.count, dtype=np.int64)
    step[level.code] = decision.problem.groups.step[decision.problem.view.rows[d.use]]
    of_step = np.bincount(step, moved) / np.maximum(np.bincount(step), 1)
    return float(np.std(moved - of_step[step]))
