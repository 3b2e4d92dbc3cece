"""Reduction of frames: means, scatter split in own and common part, lost rows, order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arl_fixtures.errors import DataError
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.metrics.statistics import SweepStatistics

SHAPE = (32, 128)


def a_block(
    rng: np.random.Generator, *, n: int = 10, jitter: float = 0.0, wobble_m: float = 0.0, **more
) -> AngleBlock:
    level = np.linspace(60.0, 3000.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
    sigma = np.sqrt(36 + 0.25 * level + (0.004 * level) ** 2)
    gain = 1 + jitter * rng.standard_normal((n, 1, 1))
    intensity = np.zeros((n, 2, *SHAPE), np.uint16)
    intensity[:, 0] = np.rint(level * gain + sigma * rng.standard_normal((n, *SHAPE)))
    distance = np.full((n, 2, *SHAPE), np.nan, np.float32)
    offset = wobble_m * rng.standard_normal((n, 1, 1))
    distance[:, 0] = 1.1 + offset + 0.004 * rng.standard_normal((n, *SHAPE))
    values = {
        "dut": "A",
        "angle_index": 0,
        "stage_angle_deg": 0.0,
        "time_ns": np.arange(n),
        "intensity_counts": intensity,
        "distance_m": distance,
        "row_valid": np.ones((n, SHAPE[0]), bool),
        "operating": {"laser_current_a": 90.0},
    }
    return AngleBlock(**{**values, **more})


def summary_of(*blocks: AngleBlock):
    statistics = SweepStatistics("A")
    for block in blocks:
        statistics.add(block)
    return statistics.summary()


def test_mean_and_variance_are_those_of_numpy_when_nothing_is_common():
    block = a_block(np.random.default_rng(1))
    found = summary_of(block)
    np.testing.assert_allclose(found.intensity_counts[0], block.intensity_counts[:, 0].mean(axis=0), rtol=1e-6)
    plain = block.intensity_counts[:, 0].astype(float).var(axis=0, ddof=1)
    # the common part's estimate takes at most a few thousandths of a pixel's own scatter
    assert np.mean(found.intensity_variance[0] / plain) == pytest.approx(1.0, abs=0.004)
    np.testing.assert_allclose(found.distance_m[0], block.distance_m[:, 0].mean(axis=0), rtol=1e-6)


def test_common_jitter_is_taken_out_of_the_pixels_and_measured():
    rng = np.random.default_rng(2)
    found = summary_of(*(a_block(rng, n=20, jitter=0.03, wobble_m=0.01, angle_index=k) for k in range(10)))
    level = np.linspace(60.0, 3000.0, SHAPE[0] * SHAPE[1]).reshape(SHAPE)
    own = 36 + 0.25 * level + (0.004 * level) ** 2 + 1 / 12
    ratio = (found.intensity_variance / own).mean()
    assert ratio == pytest.approx(1.0, abs=5 * np.sqrt(2 / (190 * level.size)) + 1e-3)
    # 190 degrees of freedom: 5 % standard error of a standard deviation
    assert np.sqrt(found.intensity_common_variance.mean()) == pytest.approx(0.03, rel=0.2)
    assert np.sqrt(found.distance_common_variance.mean()) == pytest.approx(0.01, rel=0.2)
    assert np.sqrt(found.distance_variance.mean()) == pytest.approx(0.004, rel=0.005)


def test_without_common_jitter_its_estimate_is_the_noise_floor():
    rng = np.random.default_rng(3)
    found = summary_of(*(a_block(rng, angle_index=k) for k in range(60)))
    for raw, floor in (
        (found.intensity_common_variance, found.intensity_common_floor),
        (found.distance_common_variance, found.distance_common_floor),
    ):
        assert raw.mean() / floor.mean() == pytest.approx(1.0, abs=5 * np.sqrt(2 / (60 * 9)))


def test_lost_rows_are_left_out_of_means_and_counts():
    rng = np.random.default_rng(4)
    block = a_block(rng)
    valid = block.row_valid.copy()
    valid[3:5, 7] = False
    valid[:, 9] = False
    intensity, distance = block.intensity_counts.copy(), block.distance_m.copy()
    intensity[:, 0][~valid], distance[:, 0][~valid] = 0, np.nan
    found = summary_of(replace(block, row_valid=valid, intensity_counts=intensity, distance_m=distance))
    assert found.lost_rows == 12
    assert found.arrived[0, 7, 0] == 8
    assert set(np.unique(found.intensity_returns[0, 7])) == {8}
    kept = block.intensity_counts[valid[:, 7], 0, 7].mean(axis=0)
    np.testing.assert_allclose(found.intensity_counts[0, 7], kept, rtol=1e-6)
    assert np.isnan(found.intensity_counts[0, 9]).all()
    assert np.isnan(found.distance_variance[0, 9]).all()
    untouched = summary_of(block)
    np.testing.assert_allclose(found.intensity_counts[0, 20], untouched.intensity_counts[0, 20], rtol=1e-6)


def test_intensities_survive_where_only_the_distance_is_missing():
    block = a_block(np.random.default_rng(5))
    found = summary_of(replace(block, distance_m=np.full_like(block.distance_m, np.nan)))
    assert found.distance_returns.max() == 0
    np.testing.assert_allclose(found.intensity_counts, summary_of(block).intensity_counts)


def test_the_order_in_which_angles_were_driven_does_not_matter():
    rng = np.random.default_rng(6)
    blocks = [a_block(rng, angle_index=k, stage_angle_deg=10.0 - k) for k in range(5)]
    driven, sorted_ = summary_of(*blocks), summary_of(*sorted(blocks, key=lambda block: block.stage_angle_deg))
    np.testing.assert_array_equal(driven.stage_angle_deg, [6.0, 7.0, 8.0, 9.0, 10.0])
    np.testing.assert_array_equal(driven.angle_index, [4, 3, 2, 1, 0])
    np.testing.assert_array_equal(driven.intensity_variance, sorted_.intensity_variance)


def test_blocks_that_do_not_belong_together_are_refused():
    rng = np.random.default_rng(7)
    statistics = SweepStatistics("A")
    with pytest.raises(DataError, match="no frames"):
        statistics.summary()
    with pytest.raises(DataError, match="DUT B"):
        statistics.add(a_block(rng, dut="B"))
    statistics.add(a_block(rng))
    half = a_block(rng)
    with pytest.raises(DataError, match="image size"):
        statistics.add(
            replace(half, intensity_counts=half.intensity_counts[..., :64], distance_m=half.distance_m[..., :64])
        )


def test_a_signal_that_comes_and_goes_is_nan_where_it_was_not_reported():
    rng = np.random.default_rng(8)
    found = summary_of(
        a_block(rng), a_block(rng, angle_index=1, stage_angle_deg=1.0, operating={"tec_current_a": 1.0})
    )
    np.testing.assert_array_equal(found.operating["laser_current_a"], [90.0, np.nan])
    np.testing.assert_array_equal(found.operating["tec_current_a"], [np.nan, 1.0])


def test_a_single_frame_has_a_mean_and_no_scatter():
    found = summary_of(a_block(np.random.default_rng(9), n=1))
    assert np.isfinite(found.intensity_counts).all()
    assert np.isnan(found.intensity_variance).all()
