"""Rank correlation of operating signals with metrics: intervals that cover, discoveries that are kept honest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.correlation import Multiplicity, correlate, effective_steps, false_discovery


def ar1(rng, n, r):
    noise = rng.standard_normal(n + 200)
    values = np.zeros(n + 200)
    for k in range(1, n + 200):
        values[k] = r * values[k - 1] + noise[k]
    return values[200:]


def test_rho_and_p_are_scipys_where_steps_are_independent():
    rng = np.random.default_rng(1)
    x = rng.standard_normal(200)
    y = 0.4 * x + rng.standard_normal(200)
    (found,) = correlate({"x": x}, {"y": y})
    expected = stats.spearmanr(x, y)
    assert found.rho == pytest.approx(expected.statistic)
    assert found.low < found.rho < found.high
    assert found.effective_steps == pytest.approx(200, rel=0.3)


def test_intervals_cover_the_true_rank_correlation():
    rng = np.random.default_rng(2)
    pearson = 0.6
    truth = 6 / math.pi * math.asin(pearson / 2)
    covered = 0
    for _ in range(400):
        x = rng.standard_normal(60)
        y = pearson * x + math.sqrt(1 - pearson**2) * rng.standard_normal(60)
        (found,) = correlate({"x": x}, {"y": y})
        covered += found.low <= truth <= found.high
    assert 0.92 <= covered / 400 <= 0.98


def test_slow_drifts_that_have_nothing_to_do_with_each_other_are_no_discovery():
    rng = np.random.default_rng(3)
    naive = corrected = 0
    for _ in range(200):
        x, y = ar1(rng, 80, 0.9), ar1(rng, 80, 0.9)
        (found,) = correlate({"x": x}, {"y": y})
        corrected += (not math.isnan(found.p)) and found.p < 0.05
        naive += stats.spearmanr(x, y).pvalue < 0.05
        assert found.effective_steps < 80
    assert naive > 60
    assert corrected < 24


def test_what_only_follows_the_temperature_is_nothing_given_the_temperature():
    rng = np.random.default_rng(4)
    temperature = np.tile(np.concatenate([np.arange(-10, 90, 5.0), np.arange(80, -10, -5.0)]), 3)
    signal = 0.03 * temperature + 0.3 * rng.standard_normal(temperature.size)
    metric = -0.1 * temperature + rng.standard_normal(temperature.size)
    foretelling = metric + 0.5 * rng.standard_normal(temperature.size)
    plain = {one.signal: one for one in correlate({"s": signal, "f": foretelling}, {"m": metric})}
    partial = {
        one.signal: one for one in correlate({"s": signal, "f": foretelling}, {"m": metric}, given={"t": temperature})
    }
    assert plain["s"].rho < -0.8
    assert abs(partial["s"].rho) < 0.3
    assert partial["f"].rho > 0.7
    assert partial["f"].q < 0.01


def test_discoveries_among_many_pairs_are_seldom_false():
    rng = np.random.default_rng(5)
    with_any = 0
    for _ in range(60):
        signals = {f"s{k}": rng.standard_normal(40) for k in range(10)}
        metrics = {f"m{k}": rng.standard_normal(40) for k in range(5)}
        found = correlate(signals, metrics, multiplicity=Multiplicity.BENJAMINI_HOCHBERG)
        with_any += any(one.q < 0.05 for one in found)
    assert with_any <= 9


def test_q_values_are_those_of_scipy():
    p = [0.001, 0.2, 0.03, math.nan, 0.04, 0.9]
    known = [value for value in p if not math.isnan(value)]
    for multiplicity, method in ((Multiplicity.BENJAMINI_HOCHBERG, "bh"), (Multiplicity.BENJAMINI_YEKUTIELI, "by")):
        q = false_discovery(p, multiplicity)
        assert math.isnan(q[3])
        expected = stats.false_discovery_control(known, method=method)
        np.testing.assert_allclose([value for value in q if not math.isnan(value)], expected)


def test_the_strongest_evidence_comes_first_and_what_cannot_be_told_last():
    rng = np.random.default_rng(6)
    x = rng.standard_normal(50)
    found = correlate({"weak": rng.standard_normal(50), "strong": x, "flat": np.ones(50)}, {"m": x + 0.1})
    assert [one.signal for one in found] == ["strong", "weak", "flat"]
    assert found[-1].reason == "flat does not vary"
    (short,) = correlate({"x": [1.0, 2.0, math.nan]}, {"y": [1.0, 2.0, 3.0]})
    assert short.reason.startswith("2 steps")
    with pytest.raises(DataError, match="different lengths"):
        correlate({"x": [1.0, 2.0]}, {"y": [1.0]})


def test_white_series_count_in_full():
    rng = np.random.default_rng(7)
    counts = [effective_steps(rng.standard_normal(100), rng.standard_normal(100)) for _ in range(50)]
    assert np.mean(counts) == pytest.approx(100, abs=8)
