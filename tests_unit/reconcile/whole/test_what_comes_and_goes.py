"""A scene that stands elsewhere than the simulation has it, and stays there."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

WIDE, HIGH, STEPS = 18, 5, 9
ANGLES = (-11.0, -4.0, 0.0, 5.0, 12.0)
PITCH = 2.6


def light_of(edges, left, right):
    """Mean light over the pixels between two bearings, before panels whose edges these are."""
    total = np.full(left.shape, 110.0)
    for (low, high), own in zip(edges, (700.0, 2000.0, 3200.0), strict=True):
        part = np.clip(np.minimum(right, high) - np.maximum(left, low), 0.0, None) / (right - left)
        total += part * (own - 110.0)
    return total


@pytest.fixture
def table():
    """Panels that stand up to a twentieth of a pixel from where the simulation has them, each by its own amount."""

    def make(seed, change):
        rng = np.random.default_rng(seed)
        step, angle, v, u = (
            x.ravel() for x in np.meshgrid(
                np.arange(STEPS), np.array(ANGLES), np.arange(HIGH), np.arange(WIDE), indexing="ij"
            )
        )  # fmt: skip
        middle = (u - (WIDE - 1) / 2) * PITCH + angle
        left, right = middle - PITCH / 2, middle + PITCH / 2
        planned = np.array([(-16.2, -8.7), (-3.4, 4.1), (9.3, 16.8)])
        found = planned + np.array([(0.13, 0.09), (-0.11, -0.10), (0.04, 0.13)])
        sim, true = light_of(planned, left, right), light_of(found, left, right)
        edges = np.abs(middle[:, None] - planned.ravel()).min(axis=1) < PITCH / 2
        temperature = np.array([-15.0, 5.0, 25.0, 45.0, 65.0, 85.0, 55.0, 35.0, 0.0])[step] + 9.0
        mean = change(true, temperature)
        sigma = np.sqrt(30.0 + 0.3 * sim)
        shared = 1.0 + 0.003 * rng.standard_normal(STEPS)[step]
        return columns_of(pa.table({
            "step": step.astype(float), "set_temperature_c": temperature - 9.0, "stage_angle_deg": angle,
            "pixel_u": u.astype(float), "pixel_v": v.astype(float), "mixed": edges,
            "tof_temperature_c": temperature + 0.1 * rng.standard_normal(STEPS)[step],
            "n_frames": np.full(u.size, 10.0), "sim_intensity_counts": sim, "sim_intensity_counts_std": sigma,
            "sim_intensity_counts_repeat_std": 0.003 * sim,
            "intensity_counts": mean * shared + sigma / np.sqrt(10.0) * rng.standard_normal(u.size),
        }))  # fmt: skip

    return make


def test_panels_that_stand_elsewhere_are_no_gains_of_pixels(table):
    findings = diagnose(table(8, lambda light, _t: light))[0].findings
    assert [f.effect for f in findings] == ["unknown"]
