"""Total power from several targets: what it is worth, by its scatter over many drawn maps."""

from __future__ import annotations

import numpy as np
import pytest

from arl_fixtures.metrics.power_total import total_power
from arl_fixtures.metrics.reference import NotMeasurableError

SHAPE = (6, 20)


@pytest.fixture
def maps():
    """Three targets of 18, 50 and 80 %; the outer ones are not seen by some columns at either end."""
    rng = np.random.default_rng(5)
    truth = 1.0 - 0.3 * np.linspace(-1, 1, SHAPE[1]) ** 2 + 0.02 * rng.standard_normal(SHAPE)
    power = np.stack([level * truth for level in (1.02, 1.0, 0.97)])
    power[0, :, :2] = power[2, :, -3:] = np.nan
    weight = np.stack([np.full(SHAPE, each) for each in (0.18, 0.5, 0.8)])
    variance = np.stack([np.full(SHAPE, each**2) for each in (0.05, 0.02, 0.01)])
    return power, variance, weight


def test_stated_uncertainty_is_the_scatter_of_the_total(maps):
    power, variance, weight = maps
    rng = np.random.default_rng(6)
    found = [
        total_power(power + np.sqrt(variance) * rng.standard_normal(power.shape), variance, weight).value
        for _ in range(4000)
    ]
    stated = total_power(power, variance, weight)
    assert np.std(found) / stated.value == pytest.approx(stated.relative_u, rel=0.05)
    # the merged map's pixels taken as independent would promise much more
    share = weight / weight.sum(axis=0)
    naive = np.sqrt((share**2 * variance).sum()) / stated.value
    assert stated.relative_u > 1.3 * naive


def test_a_relative_error_of_one_pixel_acts_as_its_sensitivity_says(maps):
    power, variance, weight = maps
    stated = total_power(power, variance, weight)
    for target, pixel in ((0, 45), (1, 0), (2, 119), (2, 40)):
        moved = power.copy()
        moved[target].flat[pixel] *= 1.0 + 1e-6
        if np.isnan(moved[target].flat[pixel]):
            assert stated.sensitivities[target, pixel] == 0.0
            continue
        by = (total_power(moved, variance, weight).value / stated.value - 1.0) / 1e-6
        assert by == pytest.approx(stated.sensitivities[target, pixel], rel=1e-3)


def test_the_same_loss_everywhere_is_the_loss_of_the_total_whoever_saw_what(maps):
    power, variance, weight = maps
    before, after = total_power(power, variance, weight), total_power(0.97 * power, variance, weight)
    assert after.value / before.value == pytest.approx(0.97, rel=1e-12)


def test_pixels_that_only_one_target_saw_count_in_the_total(maps):
    power, variance, weight = maps
    darker = power.copy()
    darker[:, :, :2] *= 0.9
    lost = 0.1 * np.nanmean(power[1][:, :2]) * 2 / SHAPE[1]
    change = total_power(darker, variance, weight).value / total_power(power, variance, weight).value - 1.0
    assert change == pytest.approx(-lost / np.mean(power[1]), rel=1e-2)


def test_no_pixel_in_common_is_no_total(maps):
    power, variance, weight = maps
    power[0, :, :10] = power[1, :, 10:] = np.nan
    with pytest.raises(NotMeasurableError, match="no pixel saw all"):
        total_power(power, variance, weight)
