"""Do cheap signals foretell the performance? Rank correlation of operating data with metrics, over steps and cycles.

Spearman's ρ with a confidence interval after Fisher's transformation, its variance after D. Bonett and T. Wright,
Psychometrika 65 (2000) 23–28. Steps follow one another in time, so neighbours resemble each other: the effective
number of steps is n / (1 + 2 Σ (1 − k/n) r_x(k) r_y(k)) (G. Bayley and J. Hammersley, J. R. Stat. Soc. Suppl. 8
(1946) 184–197). Everything on the bench follows the temperature, so correlation *given* the set temperature (partial
rank correlation) is what tells something.

Many pairs are tried: q values after Benjamini and Yekutieli (Ann. Stat. 29 (2001) 1165–1188), valid under any
dependence of the pairs, or after Benjamini and Hochberg (J. R. Stat. Soc. B 57 (1995) 289–300).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import ndtri, stdtr
from scipy.stats import rankdata

from arl_fixtures.errors import DataError

Float64Array = npt.NDArray[np.float64]

FEWEST_STEPS: Final = 6


class Multiplicity(StrEnum):
    """How the number of pairs tried is accounted for."""

    BENJAMINI_YEKUTIELI = "benjamini_yekutieli"
    BENJAMINI_HOCHBERG = "benjamini_hochberg"


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation:
    """One signal with one metric.

    Attributes:
        signal: name of the operating signal.
        metric: name of the performance metric.
        rho: Spearman's rank correlation, partial where something was given.
        low: lower end of the confidence interval.
        high: upper end.
        p: probability of a correlation at least as strong by chance, two-sided.
        q: smallest false discovery rate at which this pair is reported.
        steps: number of steps with both values.
        effective_steps: what they are worth, after autocorrelation.
        reason: why there is no correlation; empty when there is one. Then the numbers are NaN.
    """

    signal: str
    metric: str
    rho: float
    low: float
    high: float
    p: float
    q: float
    steps: int
    effective_steps: float
    reason: str = ""


def correlate(
    signals: Mapping[str, npt.ArrayLike],
    metrics: Mapping[str, npt.ArrayLike],
    *,
    given: Mapping[str, npt.ArrayLike] | None = None,
    confidence: float = 0.95,
    multiplicity: Multiplicity = Multiplicity.BENJAMINI_YEKUTIELI,
) -> list[Correlation]:
    """Correlate every signal with every metric of one DUT.

    Args:
        signals: name to (n,) values, one per step in the order of time; NaN where not measured.
        metrics: name to (n,) values at the same steps.
        given: name to (n,) values whose influence is taken out of both first (set temperature, ramp).
        confidence: of the intervals.
        multiplicity: account of the number of pairs.

    Returns:
        One result per pair, the strongest evidence first.

    Raises:
        DataError: the series differ in length.
    """
    fixed = {name: np.asarray(values, dtype=np.float64) for name, values in (given or {}).items()}
    columns = {name: np.asarray(values, dtype=np.float64) for name, values in [*signals.items(), *metrics.items()]}
    lengths = {values.size for values in [*columns.values(), *fixed.values()]}
    if len(lengths) > 1:
        raise DataError(f"series of different lengths to correlate: {', '.join(map(str, sorted(lengths)))}")
    found = [
        _pair(
            signal, metric, np.asarray(signals[signal], float), np.asarray(metrics[metric], float), fixed, confidence
        )
        for signal in signals
        for metric in metrics
    ]
    q = false_discovery([pair.p for pair in found], multiplicity)
    return sorted(
        (replace(pair, q=value) for pair, value in zip(found, q, strict=True)),
        key=lambda pair: (math.isnan(pair.p), pair.q, pair.p, -abs(pair.rho), pair.signal, pair.metric),
    )


def false_discovery(p: Sequence[float], multiplicity: Multiplicity) -> list[float]:
    """Adjusted p values (q values); NaN stays NaN and does not count."""
    known = np.array([value for value in p if not math.isnan(value)])
    m = known.size
    penalty = float((1.0 / np.arange(1, m + 1)).sum()) if multiplicity is Multiplicity.BENJAMINI_YEKUTIELI else 1.0
    order = np.argsort(known)
    raised = known[order] * m * penalty / np.arange(1, m + 1)
    smallest = np.minimum(np.minimum.accumulate(raised[::-1])[::-1], 1.0)
    adjusted = np.empty(m)
    adjusted[order] = smallest
    values = iter(adjusted.tolist())
    return [math.nan if math.isnan(value) else next(values) for value in p]


def effective_steps(x: Float64Array, y: Float64Array) -> float:
    """Number of independent steps that carry as much evidence of a correlation as these serially correlated ones."""
    n = x.size
    r = [
        np.correlate(v - v.mean(), v - v.mean(), "full")[n:] / max(float(((v - v.mean()) ** 2).sum()), 1e-300)
        for v in (x, y)
    ]
    # beyond a quarter of the series its autocorrelation is mostly noise
    lags = np.arange(1, max(n // 4, 1) + 1)
    product = r[0][: lags.size] * r[1][: lags.size]
    inflation = 1.0 + 2.0 * float(((1.0 - lags / n) * product).sum())
    return float(min(max(n / max(inflation, 1e-9), 3.0), n))


def _pair(
    signal: str, metric: str, x: Float64Array, y: Float64Array, given: Mapping[str, Float64Array], confidence: float
) -> Correlation:
    known = np.isfinite(x) & np.isfinite(y)
    for values in given.values():
        known &= np.isfinite(values)
    n = int(known.sum())
    nan = math.nan
    nothing = Correlation(
        signal=signal, metric=metric, rho=nan, low=nan, high=nan, p=nan, q=nan, steps=n, effective_steps=nan
    )
    if n < FEWEST_STEPS + len(given):
        return replace(nothing, reason=f"{n} steps hold both values, and {FEWEST_STEPS + len(given)} are needed")
    ranks = [rankdata(values[known]).astype(np.float64) for values in (x, y)]
    ranks = [
        _without(rank, [rankdata(values[known]).astype(np.float64) for values in given.values()]) for rank in ranks
    ]
    norms = [float(np.linalg.norm(rank - rank.mean())) for rank in ranks]
    if min(norms) < 1e-9 * n:
        return replace(nothing, reason=f"{signal if norms[0] <= norms[1] else metric} does not vary")
    left, right = (rank - rank.mean() for rank in ranks)
    rho = float(np.clip(left @ right / (norms[0] * norms[1]), -1.0, 1.0))
    n_eff = effective_steps(*ranks) - len(given)
    if n_eff <= 3.0:
        return replace(nothing, rho=rho, reason="too few independent steps for an interval", effective_steps=n_eff)
    centre = math.atanh(min(max(rho, -1.0 + 1e-12), 1.0 - 1e-12))
    half = float(ndtri(0.5 * (1.0 + confidence))) * math.sqrt((1.0 + rho**2 / 2.0) / (n_eff - 3.0))
    t = abs(rho) * math.sqrt((n_eff - 2.0) / max(1.0 - rho**2, 1e-15))
    return replace(
        nothing,
        rho=rho,
        low=math.tanh(centre - half),
        high=math.tanh(centre + half),
        p=2.0 * float(stdtr(n_eff - 2.0, -t)),
        effective_steps=n_eff,
    )


def _without(rank: Float64Array, given: Sequence[Float64Array]) -> Float64Array:
    """What linear regression on the given ranks leaves."""
    if not given:
        return rank
    design = np.stack([np.ones_like(rank), *given], axis=1)
    coefficients = np.linalg.lstsq(design, rank, rcond=None)[0]
    left: Float64Array = rank - design @ coefficients
    return left
