"""Signals at the end of a converter's scale: they say that there was at least so much light, and no more.

A mean over frames feels the end before it reaches it, as soon as single frames do; and a simulation that stops at
an end says nothing of what a change of gain makes of such a row. Both are left out of the comparison.
"""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.roles import Role, role_of

FEWEST, LEAST_SHARE = 10, 0.003
"""Rows, and their share of a channel's, that stand at a ceiling at least."""
STANDS_OUT = 5.0
"""How many times the rows just below a ceiling must be fewer than those at it: rounded values pile up everywhere."""
AGREES = 0.05
"""Share by which recorded values differ from a simulation's ceiling where both stand at one."""
FRAMES_OFF = 2.0
"""Scatters of a frame below a ceiling from which frames feel it."""


def ceiling_of(values: FloatArray) -> float | None:
    """End of the scale at which measured values pile up, None where they do not.

    >>> rng = np.random.default_rng(1)
    >>> ceiling_of(np.minimum(rng.normal(900.0, 100.0, 1000), 1000.0)), ceiling_of(rng.normal(900.0, 100.0, 1000))
    (1000.0, None)
    """
    good = values[np.isfinite(values)]
    if len(good) < FEWEST:
        return None
    levels, count = np.unique(good, return_counts=True)
    at = int(count[-1])
    if at < max(FEWEST, LEAST_SHARE * len(good)) or len(levels) < 2 * FEWEST:
        return None
    return float(levels[-1]) if at > STANDS_OUT * float(np.max(count[-11:-1])) else None


def leave_out_ceilings(
    numbers: dict[str, FloatArray], channels: tuple[str, ...], ignored: dict[str, str]
) -> dict[str, float]:
    """Take rows at the ceiling of a signal as not observed, with a note; the ceilings by channel."""
    found: dict[str, float] = {}
    for name in channels:
        if role_of(name, set(channels)) is not Role.INTENSITY:
            continue
        simulated = numbers[f"sim_{name}"]
        top, cut = ceiling_of(numbers[name]), ceiling_of(simulated)
        if cut is not None and not _stands_there(numbers[name][simulated >= cut], cut):
            cut = None  # a curve that was drawn on beyond its end, not a converter's
        if top is None and cut is None:
            continue
        over = np.zeros(len(simulated), dtype=bool)
        if top is not None:
            frame = numbers.get(f"sim_{name}_std", np.zeros(len(simulated)))
            least = top - FRAMES_OFF * np.nan_to_num(frame)
            over |= (numbers[name] >= least) | (simulated >= least)
        if cut is not None:
            over |= simulated >= cut
        over &= np.isfinite(numbers[name])
        for column in (name, f"{name}_std"):
            if column in numbers:
                numbers[column] = np.where(over, np.nan, numbers[column])
        top = min(x for x in (top, cut) if x is not None)
        found[name] = top
        ignored[f"{name} (ceiling)"] = (
            f"{int(over.sum())} rows stand at the end of the scale, {top:.6g}, or feel it, measured or simulated; "
            f"they are not compared"
        )
    return found


def _stands_there(measured: FloatArray, top: float) -> bool:
    good = measured[np.isfinite(measured)]
    return bool(len(good)) and abs(float(np.median(good)) / top - 1.0) < AGREES


def under_ceiling(values: FloatArray, simulated: FloatArray, top: float) -> FloatArray:
    """Corrected values; where the simulation stands at a ceiling, or they would, the prediction stands there, too."""
    return np.where(simulated >= top * (1.0 - 1e-9), simulated, np.minimum(values, top))
