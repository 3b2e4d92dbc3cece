"""Pooling of variances from few frames: unbiased, quantisation taken out, honest uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.metrics.reference import NotMeasurableError
from arl_fixtures.metrics.scatter import c4, pool

STEP_M = 1 / 256


def test_c4_is_the_mean_of_the_sample_standard_deviation():
    rng = np.random.default_rng(1)
    samples = rng.standard_normal((400_000, 10)).std(axis=1, ddof=1)
    assert c4(9) == pytest.approx(samples.mean(), abs=5 * samples.std() / np.sqrt(samples.size))
    assert c4(9) == pytest.approx(0.9727, abs=5e-5)


@settings(deadline=None)
@given(st.floats(0.5, 1e7))
def test_c4_lies_below_one_and_approaches_it(dof):
    assert 0.0 < c4(dof) < 1.0
    assert c4(dof) == pytest.approx(1 - 1 / (4 * dof), abs=0.2 / dof**2)
    assert c4(100.0) == pytest.approx(c4(99.999999), rel=1e-9)


def test_rounding_to_the_sensors_step_leaves_the_scatter():
    rng = np.random.default_rng(2)
    true_m = 0.004
    values = 1.1 + 0.02 * rng.random((1, 40_000)) + true_m * rng.standard_normal((10, 40_000))
    rounded = np.rint(values / STEP_M) * STEP_M
    returns = np.full(40_000, 10, np.uint8)
    with_rounding = pool(rounded.var(axis=0, ddof=1).astype(np.float32), returns, 0.0)
    corrected = pool(rounded.var(axis=0, ddof=1).astype(np.float32), returns, STEP_M)
    assert corrected.sigma == pytest.approx(true_m, abs=4 * corrected.quantity("m").u)
    # without the correction it would be 3.9 % too large
    assert with_rounding.sigma / true_m == pytest.approx(np.sqrt(1 + STEP_M**2 / 12 / true_m**2), rel=0.002)


def test_stated_uncertainty_is_the_scatter_of_repeated_estimates():
    rng = np.random.default_rng(3)
    sigma = np.linspace(5.0, 50.0, 300)
    returns = rng.integers(3, 11, 300).astype(np.uint8)
    pooled = []
    for _ in range(400):
        nu = returns - 1
        variance = sigma**2 * rng.chisquare(nu) / nu
        pooled.append(pool(variance.astype(np.float32), returns, 0.0))
    values = np.array([one.variance for one in pooled])
    truth = float(((returns - 1) * sigma**2).sum() / (returns - 1).sum())
    assert values.mean() == pytest.approx(truth, rel=0.01)
    assert np.mean([one.u for one in pooled]) == pytest.approx(values.std(), rel=0.12)


def test_one_frame_has_no_scatter():
    with pytest.raises(NotMeasurableError, match="at least 3 returns"):
        pool(np.array([np.nan, 1.0], np.float32), np.array([1, 2], np.uint8), 0.0)
