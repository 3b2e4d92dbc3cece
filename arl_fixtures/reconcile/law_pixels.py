"""Terms of a law in which every pixel follows a column in its own way, by chance: responses that drift apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from arl_fixtures.reconcile.columns import FloatArray, IntArray
from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import PRICE_CURVE, PRICE_PRODUCT, Basis, price_of
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.noise import fit_tau
from arl_fixtures.reconcile.roles import PIXEL, PIXEL_COLUMNS

MOST_PIXELS, LEAST_PIXELS = 130, 8
ROWS_EACH = 8.0
"""Rows that a pixel must have on average."""
MOST_DRIFTS = 2
_BESIDE = 0.25
"""Width of a pixel's own bin on either side of its number: between the bins lie pixels that were not seen."""


def drifts_of(work: Work, names: Sequence[str]) -> Iterator[Basis]:
    """Each pixel's own slope along the columns of which the pixels' slopes scatter most.

    Args:
        work: the rows.
        names: columns that they may follow.
    """
    number = work.features.get(PIXEL)
    if number is None or not np.isfinite(number).all():
        return
    pixels, code = np.unique(number, return_inverse=True)
    if not LEAST_PIXELS <= len(pixels) <= MOST_PIXELS or len(number) < ROWS_EACH * len(pixels):
        return
    code = code.astype(np.int64)
    table = Axis(
        column=PIXEL, kind="table", edges=tuple(float(x) for p in pixels for x in (p - _BESIDE, p + _BESIDE))
    )
    gains: list[tuple[float, str, Axis]] = []
    for name in names:
        x = work.features[name]
        low, high = float(np.nanmin(x)), float(np.nanmax(x))
        if name in PIXEL_COLUMNS or name.startswith(("~", "sim_")) or not high > low:
            continue
        line = Axis(column=name, kind="linear", middle=0.5 * (low + high), width=high - low)
        price = PRICE_CURVE + PRICE_PRODUCT + price_of((name,))
        gain = _scatter_of_slopes(work, line(work.features), code, len(pixels)) - price
        if gain > 0.0:
            gains.append((gain, name, line))
    for _, name, line in sorted(gains, key=lambda g: -g[0])[:MOST_DRIFTS]:
        price = PRICE_CURVE + PRICE_PRODUCT + price_of((name,))
        yield Basis(axes=(table, line), prior=np.eye(table.count), price=price)


def _scatter_of_slopes(work: Work, x: FloatArray, code: IntArray, pixels: int) -> float:
    """Log-likelihood that slopes of pixels scatter, beside a level of each and one slope of all."""
    weight = work.direction**2
    total = np.maximum(np.bincount(code, weight, pixels), 1e-300)
    x = x - (np.bincount(code, weight * x, pixels) / total)[code]
    score: FloatArray = np.bincount(code, work.direction * x * work.residual, pixels).astype(np.float64)
    power: FloatArray = np.bincount(code, weight * x**2, pixels).astype(np.float64)
    if not np.any(power > 1e-6 * total):
        return 0.0
    score = score - power * (score.sum() / max(power.sum(), 1e-300))
    return fit_tau(score, power, lost=1.0)[1]
