"""Words of findings: one statement of a size, as an engineer would send it to a supplier."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.law import Law
from arl_fixtures.reconcile.roles import unit_of


def separating(own: str, tests: dict[str, str]) -> str:
    """The measurement that would tell a finding from what this table cannot tell from it."""
    parts = [own] + [
        f"To check for {effect}: {text}" for effect, text in list(tests.items())[:2] if text and text != own
    ]
    return " ".join(part for part in parts if part)


def statement(sentence: str, where: dict[str, list[str] | list[float]], twins: Sequence[str]) -> str:
    """The sentence, where it holds, and what cannot be told from it."""
    text = tidy(sentence)
    places = []
    for column, bounds in where.items():
        if bounds and isinstance(bounds[0], str):
            places.append(f"{column} {', '.join(str(b) for b in bounds)}")
        elif len(bounds) == 2:
            unit = "" if unit_of(column) == "1" else f" {unit_of(column)}"
            places.append(f"{column} {bounds[0]:.4g} to {bounds[1]:.4g}{unit}")
    if places:
        text += " Where: " + "; ".join(places) + "."
    if twins:
        text += " This table cannot tell it from " + " or ".join(twins) + "."
    return text


def tidy(sentence: str) -> str:
    """A sentence without the unit 1 behind a number, signs before a rounded zero, and spaces before a full stop."""
    text = re.sub(r"(?<=\d) 1(?= of |[.,;)](?!\d)|$)", "", sentence.strip())
    text = re.sub(r"(?<![\w.^*])[+-](?=0\.0+(?:\s|%))", "", text)
    return re.sub(r"\s+(?=[.,;])", "", re.sub(r"  +", " ", text))


def size_of(total: FloatArray, law: Law, sim: FloatArray) -> str:
    """How far a law moves the rows that it moves at all, in brackets; empty for one that moves none."""
    moved = np.abs(total) > 0.0
    if not moved.any():
        return ""
    if law.relative:
        share = float(np.nanquantile(np.abs(total / np.where(sim == 0, np.nan, sim))[moved], 0.98))
        size = f"{100 * share:.{2 if share < 1.0 else 3}g} %" if share < 9.99 else f"{100 * share:.0f} %"
    else:
        amount = float(np.quantile(np.abs(total)[moved], 0.98))
        size = f"{1e3 * amount:.3g} mm" if law.unit == "m" and amount < 0.1 else tidy(f"{amount:.3g} {law.unit}")
    return f"(up to {size})"
