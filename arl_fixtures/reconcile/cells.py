"""Rows that are alike in some columns: cells over parts of the columns' ranges, and what is left within them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray

PARTS, FEWEST_IN_CELL = 12, 4
"""Parts into which a column's range is cut, and rows that a cell must hold on average."""


def parts_of(values: FloatArray | IntArray, parts: int = PARTS) -> IntArray:
    """Part of a column's range that each row lies in, of about as many rows each."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, parts + 1)[1:-1]))
    return np.searchsorted(edges, values).astype(np.int64)


def alike_in(parts: Sequence[IntArray]) -> IntArray | None:
    """Cell of each row, one for every combination of the columns' parts; None where too few rows share one."""
    cell = np.zeros(len(parts[0]), dtype=np.int64)
    for part in parts:
        cell = np.unique(cell * (PARTS + 1) + part, return_inverse=True)[1].astype(np.int64)
    return None if len(cell) < FEWEST_IN_CELL * (int(cell.max()) + 1) else cell


def within_cells(values: FloatArray, cell: IntArray, weight: FloatArray | None = None) -> FloatArray:
    """Values less their cell's mean, of all rows alike or by their weight; (n,) each."""
    total = np.bincount(cell, weight)
    mean = np.bincount(cell, values if weight is None else weight * values) / np.maximum(total, 1e-300)
    return np.asarray(values - mean[cell])
