"""Which way round a temperature came: how far it has taken up the play of what it moves.

A lens that sticks in its seat or a joint that slips follows a temperature with dry friction: after full soak heating
and cooling differ all the same, and after a turn nothing moves until the play is taken up (Krasnosel'skii &
Pokrovskii, Systems with Hysteresis, 1989, ch. 1: the play operator, of which a Preisach hysteresis is made). The
direction of the ramp tells the branches apart, not the way from one to the other.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.roles import play_name
from arl_fixtures.reconcile.view import View

HALF_PLAY_K = 12.0
"""Half of the play, kelvin: a number of the feature and not of a table, so that unseen tables tell the same."""
LEAST_TURN = 0.5
"""Share of the play that must be taken up on either side: else nothing turned round."""
_BODIES = ("housing", "case", "plate", "set", "chamber", "coolant")
"""Words of the temperatures that a bench drives, the device's own first."""
MOST_NODES = 100_000


def leaning(node_c: FloatArray, group: FloatArray) -> FloatArray:
    """How far a temperature leans on either side of a play, −1…1; (n,), in order of time within each group.

    Args:
        node_c: temperatures, °C. group: run of each, in one piece; each run begins in the middle of its play.
    """
    found = np.zeros(len(node_c))
    for k in range(1, len(node_c)):
        if group[k] == group[k - 1]:
            moved = found[k - 1] * HALF_PLAY_K + node_c[k] - node_c[k - 1]
            found[k] = min(max(moved, -HALF_PLAY_K), HALF_PLAY_K) / HALF_PLAY_K
    return found


def turns(leans: FloatArray) -> bool:
    """Whether a temperature was seen to come from either side."""
    return bool(np.nanmin(leans) < -LEAST_TURN and np.nanmax(leans) > LEAST_TURN)


def play_of(view: View, temperature: str = "") -> dict[str, FloatArray]:
    """`~play(X)` of a temperature, by default the one that a bench drives, on the rows of a view.

    None where it never moves, or where nothing tells in which order it was where.
    """
    temperatures, order = view.temperatures(), next((n for n in ("step", "time_s") if view.varies(n)), "")
    driven = [name for word in _BODIES for name in temperatures if word in name.split("_")]
    name = temperature if temperature in temperatures else next(iter(driven), "") if not temperature else ""
    if not name or not order:
        return {}
    table = view.columns
    node_c, place = table.numbers[name], table.numbers[order]
    good = np.isfinite(node_c) & np.isfinite(place)
    run, condition = table.group("dut", "cycle"), table.group("dut", "cycle", order)
    count = np.bincount(condition[good], minlength=int(condition.max(initial=0)) + 1)
    # a condition is one number for all its rows: their readings agree but for their noise
    mean_c, when, of_run = (
        np.bincount(condition[good], x[good], len(count)) / np.maximum(count, 1) for x in (node_c, place, run)
    )
    met = np.flatnonzero(count)
    met = met[np.lexsort((when[met], of_run[met]))]
    if not 2 < len(met) <= MOST_NODES:
        return {}
    leans = np.full(len(count), np.nan)
    leans[met] = leaning(mean_c[met], of_run[met])
    found = np.where(good, leans[condition], np.nan)
    return {play_name(name): found[view.rows]}
