"""Targets that a sensor sees one at a time: told by a column of their own, or by their reflectances."""

from __future__ import annotations

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.view import View

WORDS = ("target", "panel", "board", "card", "patch", "paint", "material", "sample", "object", "stripe")
"""What tables without `surface` call the column that says what is looked at."""
MOST_TARGETS = 8


def target_column(view: View) -> tuple[str, tuple[str, ...]]:
    """The column of a table without surfaces that tells its targets, and each target; nothing where none does."""
    if view.labels("surface"):
        return "", ()
    for name in sorted(view.columns.categories):
        if any(word in name for word in WORDS) and 2 <= len(view.labels(name)) <= MOST_TARGETS:
            return name, tuple(view.labels(name))
    values = view.columns.numbers.get("reflectance")
    levels: list[float] = [] if values is None else list(np.unique(values[np.isfinite(values)])[: MOST_TARGETS + 1])
    return ("reflectance", tuple(str(float(x)) for x in levels)) if 2 <= len(levels) <= MOST_TARGETS else ("", ())


def before(view: View, column: str, target: str) -> FloatArray:
    """1 on rows before a target, (n,)."""
    if column == "reflectance":
        return np.asarray(np.isclose(view.number(column), float(target), rtol=1e-6), dtype=np.float64)
    return view.selects(column, target).astype(np.float64)


def rows_before(column: str, target: str) -> dict[str, list[str] | list[float]]:
    """The part of a table that is before a target, as a diagnosis gives it."""
    return {column: [float(target), float(target)] if column == "reflectance" else [target]}
