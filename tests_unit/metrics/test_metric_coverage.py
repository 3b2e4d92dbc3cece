"""The promise of `docs/metrics.md`: intervals that cover, units without a change that pass (`make soak`)."""

from __future__ import annotations

import pytest

from benchmarks.metric_coverage import coverage, run_seed

SEEDS = 200


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_intervals_cover_and_an_unchanged_dut_passes():
    results = [run_seed(seed) for seed in range(SEEDS)]
    assert sum(result.unchanged_passed for result in results) >= 0.99 * SEEDS
    assert sum(result.missing for result in results) == 0
    found = coverage(results)
    good, total = (sum(counts) for counts in zip(*found.values(), strict=True))
    assert 0.93 <= good / total <= 0.97
    # values of one seed share unit, chamber and reference: 200 witnesses each, not 200 times the cases
    allowance = 4 * (0.05 * 0.95 / SEEDS) ** 0.5
    outside = {name: counts for name, counts in found.items() if abs(counts[0] / counts[1] - 0.95) > allowance}
    assert outside == {}
