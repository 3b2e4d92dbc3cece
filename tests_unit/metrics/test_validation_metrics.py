"""Area metric, double validation metric, Wasserstein distance, against what they must be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.validation import area_metric, double_validation, wasserstein

SAMPLES = st.integers(1, 40).flatmap(lambda n: arrays(float, n, elements=st.floats(-1e3, 1e3)))


@settings(deadline=None)
@given(SAMPLES, SAMPLES)
def test_area_is_the_area_between_the_distribution_functions(x, y):
    assert area_metric(x, y) == pytest.approx(stats.wasserstein_distance(x, y), rel=1e-9, abs=1e-9)


@settings(deadline=None)
@given(SAMPLES, SAMPLES, st.floats(-100, 100))
def test_a_shift_of_both_changes_nothing_and_a_shift_of_one_only_the_bias(x, y, shift):
    found, moved = double_validation(x, y), double_validation(x + shift, y)
    assert double_validation(x + shift, y + shift).area == pytest.approx(found.area, abs=1e-6)
    assert moved.bias == pytest.approx(found.bias + shift, abs=1e-6)
    assert moved.corrected_area == pytest.approx(found.corrected_area, abs=1e-6)


@settings(deadline=None)
@given(SAMPLES, SAMPLES)
def test_order_two_splits_into_bias_and_the_rest(x, y):
    found = double_validation(x, y)
    centred = wasserstein(x - x.mean(), y - y.mean())
    assert found.wasserstein**2 == pytest.approx(found.bias**2 + centred**2, rel=1e-6, abs=1e-6)
    assert found.area <= found.wasserstein * (1 + 1e-9) + 1e-9
    assert abs(found.bias) <= found.area * (1 + 1e-9) + 1e-9


def test_twice_the_scatter_is_no_bias_and_a_known_area():
    rng = np.random.default_rng(1)
    found = double_validation(2.0 * rng.standard_normal(200_000), rng.standard_normal(150_000))
    assert found.bias == pytest.approx(0.0, abs=0.02)
    assert found.corrected_area == pytest.approx(np.sqrt(2 / np.pi), abs=0.02)
    assert found.wasserstein == pytest.approx(1.0, abs=0.02)


def test_missing_values_are_left_out_and_empty_samples_refused():
    assert area_metric(np.array([1.0, np.nan]), np.array([2.0])) == 1.0
    with pytest.raises(DataError, match="no measured values"):
        area_metric(np.array([np.nan]), np.array([1.0]))
    with pytest.raises(DataError, match="order of at least 1"):
        wasserstein(np.ones(2), np.ones(2), 0.5)
