"""Coded frames have the scatter that the noise model says, and are reproducible frame by frame."""

import dataclasses

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.twin.frame import Renderer
from arl_fixtures.twin.noise import (
    CountedNoise,
    FrameCoder,
    NoiseSettings,
    code_frames,
    normal_table,
    predicted,
    scatter,
)
from arl_fixtures.twin.settings import DutSettings

NOISE = NoiseSettings()
DUT = DutSettings(serial="N", dead_pixels=((5, 6),))
EXPECTED = Renderer(DUT).expected(3.6)
SPREAD = scatter(EXPECTED, NOISE)
N = 600


@pytest.fixture(scope="module")
def many():
    return code_frames(SPREAD, NOISE, seed=7, frame_numbers=range(N))


def flat(value, expected=EXPECTED, **changes):
    return dataclasses.replace(expected, intensity_counts=np.full_like(expected.intensity_counts, value), **changes)


def test_scatter_is_the_formula():
    i = EXPECTED.intensity_counts.astype(float)
    sigma = np.sqrt(6**2 + 0.25 * i + (0.004 * i) ** 2)
    assert np.allclose(SPREAD.intensity_std_counts, sigma, rtol=1e-5)
    assert np.allclose(SPREAD.distance_std_m, np.sqrt(0.004**2 + (0.30 * sigma / i) ** 2), rtol=1e-5)


def test_coded_frames_have_the_expected_mean_and_scatter(many):
    intensity, codes = many
    seen = SPREAD.returns
    z = (intensity.mean(axis=0) - SPREAD.intensity_counts)[seen] / (SPREAD.intensity_std_counts[seen] / np.sqrt(N))
    assert abs(z.mean()) < 5 / np.sqrt(z.size)
    assert z.std() == pytest.approx(1.0, abs=0.05)
    metres = codes * NOISE.range_step_m
    z = (metres.mean(axis=0) - SPREAD.distance_m)[seen] / (SPREAD.distance_std_m[seen] / np.sqrt(N))
    assert abs(z.mean()) < 5 / np.sqrt(z.size)
    forecast = predicted(SPREAD, NOISE)
    ratio = metres.var(axis=0, ddof=1)[seen].mean() / np.mean(forecast.distance_std_m[seen] ** 2)
    assert ratio == pytest.approx(1.0, abs=0.01)
    ratio = intensity.var(axis=0, ddof=1)[seen].mean() / np.mean(forecast.intensity_std_counts[seen] ** 2)
    assert ratio == pytest.approx(1.0, abs=0.01)


def test_noise_is_normal_and_independent_between_pixels_frames_and_channels():
    bright = flat(2000.0)
    spread = scatter(bright, NOISE)
    intensity, codes = code_frames(spread, NOISE, seed=11, frame_numbers=range(200))
    z = (intensity - 2000.0) / spread.intensity_std_counts
    z = z[:, ~EXPECTED.dead]
    # counts are whole numbers: spread them over their rounding interval
    smooth = z.ravel()[:60_000] + np.random.default_rng(1).uniform(-0.5, 0.5, 60_000) / 24.5
    assert scipy.stats.kstest(smooth, "norm").pvalue > 1e-3
    assert np.mean(z**4) == pytest.approx(3.0, abs=0.03)
    d = codes[:, ~EXPECTED.dead] * NOISE.range_step_m
    d = (d - d.mean(axis=0)) / d.std(axis=0)
    limit = 5 / np.sqrt(z.size)
    assert abs(np.mean(z * d)) < limit
    assert abs(np.mean(z[:, 1:] * z[:, :-1])) < limit
    assert abs(np.mean(z[1:] * z[:-1])) < limit


def test_normal_table_is_the_normal_distribution():
    table = normal_table().astype(float)
    assert table.mean() == pytest.approx(0.0, abs=1e-6)
    assert table.var() == pytest.approx(1.0, abs=1e-6)
    assert np.max(np.abs(scipy.stats.norm.cdf(table) - (np.arange(65536) + 0.5) / 65536)) < 1e-4


def test_a_frame_depends_on_seed_and_number_alone():
    coder = FrameCoder(SPREAD, NOISE)
    together = coder.code(7, (3, 4, 5))
    alone = coder.code(7, (5,))
    assert np.array_equal(together[0][2], alone[0][0])
    assert np.array_equal(together[1][2], alone[1][0])
    assert not np.array_equal(coder.code(8, (5,))[0], alone[0])
    assert not np.array_equal(coder.code(7, (6,))[0], alone[0])


def test_dead_and_dim_pixels_return_nothing(many):
    intensity, codes = many
    assert set(intensity[:, 6, 5]) == {0}
    assert set(codes[:, 6, 5]) == {65535}
    dim = code_frames(scatter(flat(29.9), NOISE), NOISE, seed=1, frame_numbers=(0,))
    assert set(np.unique(dim[0])) == {0}
    assert set(np.unique(dim[1])) == {65535}
    just = code_frames(scatter(flat(30.1), NOISE), NOISE, seed=1, frame_numbers=(0,))
    assert np.mean(just[1] != 65535) == pytest.approx(1 - 1 / 4096)


def test_full_scale_clips():
    bright = scatter(flat(5000.0), NOISE)
    intensity, _ = code_frames(bright, NOISE, seed=1, frame_numbers=(0,))
    assert intensity.max() == 4095
    assert predicted(bright, NOISE).intensity_counts[0, 0] == 4095
    assert predicted(bright, NOISE).intensity_std_counts[0, 0] == 0


def test_scatter_set_by_a_frame_model_replaces_the_noise_model():
    std = np.full_like(EXPECTED.intensity_counts, 50.0)
    spread = scatter(dataclasses.replace(flat(2000.0), intensity_std_counts=std), NOISE)
    intensity, _ = code_frames(spread, NOISE, seed=1, frame_numbers=range(20))
    assert intensity[:, ~EXPECTED.dead].std() == pytest.approx(50.0, rel=0.01)


def test_common_jitter_moves_all_pixels_of_a_frame_together_and_leaves_other_noise_alone():
    quiet = scatter(flat(2000.0), NOISE)
    jittery = scatter(flat(2000.0, frame_gain_std=0.05), NOISE)
    numbers = range(60)
    base, _ = code_frames(quiet, NOISE, seed=3, frame_numbers=numbers)
    moved, _ = code_frames(jittery, NOISE, seed=3, frame_numbers=numbers)
    alive = ~EXPECTED.dead
    shift = (moved.astype(float) - base)[:, alive]
    assert np.max(np.abs(shift - shift.mean(axis=1, keepdims=True))) <= 1.0
    assert shift.mean(axis=1).std() == pytest.approx(0.05 * 2000, rel=0.35)


def test_predicted_says_nothing_where_nothing_returns():
    forecast = predicted(SPREAD, NOISE)
    assert np.isnan(forecast.intensity_counts[6, 5])
    assert np.isnan(forecast.distance_std_m[6, 5])
    assert np.isfinite(forecast.distance_m[SPREAD.returns]).all()


@settings(max_examples=25, deadline=None)
@given(counts=st.lists(st.integers(0, 2**63), min_size=2, max_size=4, unique=True), seed=st.integers(0, 2**64))
def test_counted_noise_gives_the_same_numbers_in_any_order(counts, seed):
    noise, again = CountedNoise(seed), CountedNoise(seed)
    forward = {count: noise.at(count).standard_normal(5).tolist() for count in counts}
    backward = {count: again.at(count).standard_normal(5).tolist() for count in reversed(counts)}
    assert forward == backward
    assert len({tuple(values) for values in forward.values()}) == len(counts)
