"""Names that mix rows of a simulation with others only to average its noise.

A simulation of counted photons has noise of its own. Where a scene is all alike, or as it is mirrored, what adds a
row's neighbours to it leaves the scene and averages the noise: what was measured then fits better, with a share that
has nothing to do with any light. The noise of one row is not that of another in which the same pixel saw the same at
the same angle: there the change is another one, while the light of a neighbour would be the same.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import Stage
from arl_fixtures.reconcile.noise_of_the_simulation import own_noise, perturbed
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.roles import PIXEL_COLUMNS
from arl_fixtures.reconcile.seen_again import seen_again
from arl_fixtures.reconcile.terms import Term

_TESTED = 0.5
"""Share of a change on rows of which there are others of the same place, to tell anything."""
_TOLD = 0.25
"""Share of a gain that the change in the other rows of the places must tell."""
_MARGIN = 2.0
"""Times what noise explains that counts: what is stated of frames need not be what was simulated of them."""
_FIXED = frozenset((*PIXEL_COLUMNS, "stage_angle_deg", "azimuth_deg", "elevation_deg", "surface"))


def averages_noise(problem: Problem, term: Term, change: FloatArray, left: FloatArray) -> bool:
    """Whether a term that mixes rows gains by what is not the same where the same is simulated again.

    Args:
        problem: rows with weights; term: at work.
        change: of it, whitened, stacked rows, (n,); left: residual with it, (n,).
    """
    fixed = all(name in _FIXED or name.startswith("sim_") for name in term.variant.drivers)
    if not (term.effect.mixes and fixed) or term.effect.stage > Stage.DETECTOR:  # images before are not seen again
        return False
    if own_noise(problem.view) > 0.0 and _lives_on_noise(problem, term, change, left):
        return True
    found = [(*seen_again(problem.view, d.channel.name), d.use) for d in problem.data]
    place = np.concatenate([at[use] * len(found) + k for k, (at, _, use) in enumerate(found)])
    again = np.concatenate([same[use] for _, same, use in found])
    count = np.bincount(place[again], minlength=int(place.max()) + 1)
    total = np.bincount(place[again], change[again], minlength=count.size)
    tested = again & (count[place] > 1)
    own, before = change[tested], left[tested] + change[tested]
    if float(own @ own) < _TESTED * float(change @ change):
        return False
    others = (total[place[tested]] - own) / (count[place[tested]] - 1)
    gained = float(before @ own) - 0.5 * float(own @ own)
    told = max(float(before @ others), 0.0) ** 2 / (2.0 * max(float(others @ others), 1e-300))
    return gained > 0.0 and told < _TOLD * gained


def _lives_on_noise(problem: Problem, term: Term, change: FloatArray, left: FloatArray) -> bool:
    """Whether most of a term's gain is what it makes of noise that the simulation is known to have.

    What was measured lacks the simulation's noise δ: a change C that follows δ gains −E[δ'·dC/dδ·δ] by that alone
    (Stein, Ann. Statist. 9 (1981) 1135), which as much noise again shows.
    """
    view = problem.view
    fresh, noisy = view.fresh_state(), perturbed(view)
    follows = problem.whiten_change(noisy, term.apply(noisy, view)) - problem.whiten_change(
        fresh, term.apply(fresh, view)
    )
    by_noise = -float(problem.whiten_change(fresh, noisy) @ follows)
    power = max(float(change @ change), 1e-300)
    whole = float((left + change) @ change)
    return 0.5 * max(whole - _MARGIN * by_noise, 0.0) ** 2 / power < _TOLD * (whole - 0.5 * power)
