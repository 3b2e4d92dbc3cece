"""Which of a law's columns comes first: the one without which it would say least.

A law of two columns changes with both, but seldom by as much: rain that falls or not, over ranges that differ by a
fifth. What it would lose without a column is what differs between rows that are alike in all of its others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.law import Features

CELLS, FEWEST_IN_CELL = 12, 4
"""Parts into which a column is cut, and rows that a cell of all other columns must hold on average."""


def strongest_first(names: Sequence[str], features: Features, change: FloatArray, weight: FloatArray) -> list[str]:
    """Columns in the order of what a law would lose without each of them; as they were where too few rows tell.

    Args:
        names: columns of the law.
        features: values of all columns, (n,) each.
        change: what the law changes, (n,); weight: of each row, (n,).
    """
    if len(names) < 2:
        return list(names)
    parts = {name: _parts(features[name]) for name in names}
    lost: dict[str, float] = {}
    for name in names:
        cell = np.zeros(len(change), dtype=np.int64)
        for other in names:
            if other != name:
                cell = np.unique(cell * (CELLS + 1) + parts[other], return_inverse=True)[1]
        count = int(cell.max()) + 1
        if len(change) < FEWEST_IN_CELL * count:
            return list(names)
        total = np.maximum(np.bincount(cell, weight), 1e-300)
        left = change - (np.bincount(cell, weight * change) / total)[cell]
        lost[name] = float(np.sum(weight * left**2))
    return sorted(names, key=lambda name: -lost[name])


def _parts(values: FloatArray) -> IntArray:
    """Part of a column's range that each row lies in, as many rows in each."""
    filled = np.nan_to_num(values)
    edges = np.unique(np.quantile(filled, np.linspace(0.0, 1.0, CELLS + 1)[1:-1]))
    return np.searchsorted(edges, filled, side="left").astype(np.int64)
