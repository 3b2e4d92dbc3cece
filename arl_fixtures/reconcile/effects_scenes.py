"""What a sensor is shown: one scene all the time, or another target, stand-off or paint in some images or sweeps.

A goniometer sweeps one board after another, at one distance after another. The same ray at the same stage angle then
has other ranges, and the same range other light where surfaces are painted otherwise: one curve through all of them
is none of any.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.effects_common import distances, per_table, signals
from arl_fixtures.reconcile.effects_still import apart, both, centred, scenes_before_still
from arl_fixtures.reconcile.view import View

_MOVED, _PAINTED = 0.01, 0.05
"""Change of a ray's range and of its light, as logarithms, from which sweeps do not see the same scene."""
_SMOOTH = 0.5
"""Step of such a change from one stage angle to the next, as a share of it, from which it is noise."""
_MOST_SCENES = 64


def scenes_shown(view: View) -> IntArray:
    """Code of the scene that each row of the whole table belongs to; all 0 where there is but one."""
    moving = view.varies("stage_angle_deg")
    return per_table(view, "scenes shown", lambda: _scenes_swept(view) if moving else scenes_before_still(view))


def _scenes_swept(view: View) -> IntArray:
    """The same before a moving stage.

    Light that changes alike along a whole sweep (a laser's temperature) is no other scene. What a column tells that
    is constant along each sweep is believed before the sweeps themselves are told apart.
    """
    table = view.columns
    found = np.zeros(table.n, dtype=np.int64)
    ray = table.group("dut", "pixel_u", "pixel_v", "stage_angle_deg")
    sweep = table.group(*table.sweep_columns)
    if int(sweep.max()) == 0 or int(ray.max()) + 1 >= table.n:
        return found
    for name, limit in [(n, _MOVED) for n in distances(view)[:1]] + [(n, _PAINTED) for n in list(signals(view))[:1]]:
        simulated = table.numbers[f"sim_{name}"]
        good = np.isfinite(simulated) & (simulated > 0.0)
        if not good.any():
            continue
        log = centred(ray, np.log(np.where(good, simulated, 1.0)), good)
        if name in signals(view):
            log = centred(both(found, sweep), log, good)
        if apart(both(found, ray), log, good) <= limit:
            continue
        for code in _told(view, sweep, log, good):
            parted = both(found, code)
            if int(parted.max()) < _MOST_SCENES and apart(both(parted, ray), log, good) <= limit:
                found = parted
                break
    return found


def _told(view: View, sweep: IntArray, log: FloatArray, good: NDArray[np.bool_]) -> Iterator[IntArray]:
    """What may tell scenes apart: conditions constant along each sweep, of few levels first; then sweeps."""
    table, sweeps = view.columns, int(sweep.max()) + 1
    levels = {name: int(table.group(name).max()) + 1 for name in (*view.covariates(), *table.categories)}
    for name in sorted((n for n in levels if 1 < levels[n] <= sweeps), key=lambda n: levels[n]):
        if int(both(sweep, table.group(name)).max()) + 1 == sweeps:
            yield table.group(name)
    ray = table.group("dut", "pixel_u", "pixel_v")
    rows = np.flatnonzero(good)
    rows = rows[np.lexsort((table.numbers["stage_angle_deg"][rows], ray[rows], sweep[rows]))]
    beside = (np.diff(sweep[rows]) == 0) & (np.diff(ray[rows]) == 0)
    if np.sum(np.abs(np.diff(log[rows]))[beside]) < _SMOOTH * np.sum(np.abs(log[rows][1:])[beside]):
        yield sweep
