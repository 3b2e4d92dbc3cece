"""Reflectances that were fitted to the recording hide the mean of a rough paint, and not that it is rough."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.pixel_calibration import calibrated_by_surface
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

TILTS_DEG, ROWS, STEPS, FRAMES = (8.0, 20.0, 32.0, 45.0, 58.0), 40, 8, 10.0


def board_table(seed, *, roughness, fitted):
    """Five boards, each seen under a range of angles, in a paint of Oren and Nayar's microfacets."""
    rng = np.random.default_rng(seed)
    step, board, row = (
        a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(5), np.arange(ROWS), indexing="ij")
    )
    incidence_deg = np.array(TILTS_DEG)[board] + np.linspace(-7.0, 7.0, ROWS)[row]
    incidence = np.radians(incidence_deg)
    range_m = 2.0 + 0.5 * board + 0.01 * row
    reflectance = np.array([0.2, 0.8, 0.4, 0.6, 0.5])[board]
    simulated = 4000.0 * reflectance * np.cos(incidence) / range_m**2
    square = np.radians(roughness) ** 2
    flat, steep = 1.0 - 0.5 * square / (square + 0.33), 0.45 * square / (square + 0.09)
    paint = flat + steep * np.sin(incidence) * np.tan(incidence)
    sigma = np.hypot(4.0, 0.02 * simulated)
    shared = 1.0 + 0.001 * rng.normal(size=STEPS)[step]
    measured = simulated * paint * shared + sigma / np.sqrt(FRAMES) * rng.normal(size=step.size)
    if fitted:
        weight = (simulated / sigma) ** 2
        gain = np.bincount(board, weight * measured / simulated) / np.bincount(board, weight)
        simulated, sigma = simulated * gain[board], sigma * gain[board]
    return columns_of(pa.table({
        "step": step, "surface": np.array(["b1", "b2", "b3", "b4", "b5"])[board], "incidence_deg": incidence_deg,
        "true_range_m": range_m, "reflectance": reflectance, "n_frames": np.full(step.size, FRAMES),
        "intensity_counts": measured, "sim_intensity_counts": simulated, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 1e-3 * simulated,
    }))  # fmt: skip


@pytest.mark.parametrize("fitted", [True, False])
def test_fitted_reflectances_are_told_from_a_good_simulation(fitted):
    assert calibrated_by_surface(board_table(1, roughness=0.0, fitted=fitted), "intensity_counts") == fitted


def test_a_rough_paint_is_named_although_each_board_was_fitted():
    findings = diagnose(board_table(2, roughness=8.0, fitted=True))[0].findings
    assert [f.effect for f in findings] == ["target.non_lambertian"]
