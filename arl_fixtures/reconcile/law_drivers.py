"""Which of a law's columns comes first: the one without which it would say least.

A law of two columns changes with both, but seldom by as much: rain that falls or not, over ranges that differ by a
fifth. What it would lose without a column is what differs between rows that are alike in all of its others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile.cells import alike_in, parts_of, within_cells
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import Features

SAME = 1e-9
"""Share of a column's variance that another one leaves of it where both say the same."""


def told_once(features: Features) -> Features:
    """Columns without the steps' numbers where these go with the time exactly: a wave has so many seconds, not steps.

    Args:
        features: values of all columns, (n,) each.
    """
    if not {"step", "time_s"} <= set(features):
        return features
    step, time = features["step"], features["time_s"]
    both = np.isfinite(step) & np.isfinite(time)
    if both.sum() < 3 or not np.array_equal(np.isfinite(step), both) or np.ptp(step[both]) == 0.0:
        return features
    together = float(np.corrcoef(step[both], time[both])[0, 1]) if np.ptp(time[both]) > 0.0 else 0.0
    if 1.0 - together**2 > SAME:
        return features
    return {name: values for name, values in features.items() if name != "step"}


def strongest_first(names: Sequence[str], features: Features, change: FloatArray, weight: FloatArray) -> list[str]:
    """Columns in the order of what a law would lose without each of them; as they were where too few rows tell.

    Args:
        names: columns of the law.
        features: values of all columns, (n,) each.
        change: what the law changes, (n,); weight: of each row, (n,).
    """
    if len(names) < 2:
        return list(names)
    parts = {name: parts_of(np.nan_to_num(features[name])) for name in names}
    lost: dict[str, float] = {}
    for name in names:
        cell = alike_in([parts[other] for other in names if other != name])
        if cell is None:
            return list(names)
        lost[name] = float(np.sum(weight * within_cells(change, cell, weight) ** 2))
    return sorted(names, key=lambda name: -lost[name])
