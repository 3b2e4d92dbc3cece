"""A histogram of first photons: each detector answers once a pulse, to the background or to the echo.

What the background has fired is blind to the echo, ever more the farther that is; what the echo has fired is blind to
the background behind it. The floor that is taken away, told by the bins before, is then not the floor under the echo.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import Parameter, Values
from arl_fixtures.reconcile.effects_common import shape
from arl_fixtures.reconcile.roles import per_metre, unit_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Echo:
    """What is told of echoes, one value per row.

    Attributes:
        light: counts less the floor that is taken away.
        pull: of their centre, added to the distance, in its unit.
        scatter: factor of the distance's scatter.
    """

    light: FloatArray
    pull: FloatArray
    scatter: FloatArray


def window_parameters(distance: str) -> list[Parameter]:
    """Of the background and of the window that is summed.

    `ambient` is the background's photons up to the farthest echo for one of the brightest echo; the window reaches
    `reach`·(1 − late) before an echo and `reach`·(1 + late) behind it.

    Args:
        distance: channel, whose unit the reach has.
    """
    size, unit = per_metre(unit_of(distance)), unit_of(distance)
    return [
        shape("ambient", "1", 0.0, 200.0, 1.0, 10.0),
        shape("reach", unit, 0.01 * size, 3.0 * size, 0.3 * size),
        shape("late", "1", -1.0, 1.0, 0.0),
    ]


def counted(light: FloatArray, kept: FloatArray, background: FloatArray, top: float, far: float,
            place: FloatArray, values: Values) -> Echo:  # fmt: skip
    """Counts, centre and scatter of echoes over a background, all of which fire a detector once a pulse.

    Of a background of B photons up to the farthest echo, exp(−B·r/far) of the detectors are awake at the range r.

    Args:
        light: simulated signal, shape (n,); kept: share of it that is counted were there no background.
        background: over its brightest, shape (n,).
        top: brightest simulated signal; far: farthest range; place: range over `far`, shape (n,).
        values: of `load`, photons of the brightest signal per pulse, and `window_parameters`.
    """
    load, ambient, reach, late = (float(values[name]) for name in ("load", "ambient", "reach", "late"))
    awake = np.exp(-np.clip(load * ambient * background * place, 0.0, 50.0))
    left = np.exp(-np.clip(load * light / top, 0.0, 50.0))  # of those, asleep to nothing that the echo has fired
    floor = ambient * background * reach / far * top  # in half a window
    echo = light * kept * awake
    before, behind = (1.0 - late) * floor, (1.0 + late) * floor
    lost_before, lost_behind = before * (1.0 - awake), behind * (1.0 - awake * left)
    whole = echo - lost_before - lost_behind
    most = np.maximum(whole, 0.05 * light)
    moment = 0.5 * reach * ((1.0 - late) * lost_before - (1.0 + late) * lost_behind)
    counts = (echo + before + behind - lost_before - lost_behind) / np.maximum(light + before + behind, 1e-300)
    return Echo(light=whole, pull=moment / most, scatter=light / most * np.sqrt(counts))
