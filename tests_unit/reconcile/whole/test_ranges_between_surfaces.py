"""Pixels that see two surfaces have ranges that no other has: what only they show is no error of the clock."""

import numpy as np
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from tests_unit.reconcile.whole.test_seldom_names import columns_of

FAR = "distance_m"


def box_before_a_wall(late_mm, *, phase, mixed_only, seed=8):
    """A camera that a stage turns past a box: a third of its pixels see both, ranged by their light."""
    rng = np.random.default_rng(seed)
    step, pixel = (a.ravel() for a in np.meshgrid(np.arange(60), np.arange(48), indexing="ij"))
    part = np.where(pixel % 3 == 0, rng.uniform(0.05, 0.95, step.size), np.where(pixel < 24, 0.0, 1.0))
    true = 2.0 + 0.9 * part + 0.002 * np.cos(0.3 * pixel)
    mixed = (part > 0.0) & (part < 1.0)
    late = 1e-3 * late_mm * np.sin(2.0 * np.pi * (true - phase) / 0.45) * (mixed | (not mixed_only))
    columns = columns_of(
        {
            "step": step, "pixel_u": pixel, "n_frames": np.full(step.size, 30.0), f"sim_{FAR}": true,
            f"sim_{FAR}_std": np.full(step.size, 0.01), f"sim_{FAR}_repeat_std": np.full(step.size, 1e-4),
            FAR: true + late + 0.01 / np.sqrt(30.0) * rng.normal(size=step.size),
        }
    )  # fmt: skip
    columns.categories["surface"] = ((part > 0.5).astype(np.int64), ("box", "wall"))
    columns.categories["mixed"] = (mixed.astype(np.int64), ("false", "true"))
    return columns


@pytest.mark.parametrize(("phase", "mixed_only"), [(2.0, True), (2.1, False)])
def test_a_wave_over_ranges_that_only_mixed_pixels_have_is_no_clocks(phase, mixed_only):
    clock = [library()["timing.tdc_nonlinearity"]]
    columns = box_before_a_wall(4.0, phase=phase, mixed_only=mixed_only)
    findings = diagnose(columns, effects=clock)[0].findings
    assert findings
    assert ("timing.tdc_nonlinearity" in [found.effect for found in findings]) is not mixed_only
