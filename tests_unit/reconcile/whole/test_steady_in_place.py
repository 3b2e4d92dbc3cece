"""A name whose strength changes with conditions leaves its place to one that cannot be told from it and is steady."""

import numpy as np
import pyarrow as pa
from scipy.ndimage import gaussian_filter

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[name] for name in ("detector.crosstalk", "optics.defocus", "optics.veiling_glare")]
FINE, WIDE, HIGH, ANGLES, STEPS = 3, 14, 10, 4, 3
"""Parts of a pixel in which the scene is drawn; pixels; stage angles, each two pixels on, and steps."""


def soft_camera(seed, sigma_px):
    """Posters on a wall before a camera whose lens blurs the light before the pixels add it up."""
    rng = np.random.default_rng(seed)
    wall = np.full((HIGH * FINE, (WIDE + 2 * ANGLES) * FINE), 0.4)
    for _ in range(20):
        top, left = rng.integers(0, wall.shape[0]), rng.integers(0, wall.shape[1])
        high, wide = rng.integers(FINE, 6 * FINE, 2)
        wall[top : top + high, left : left + wide] = rng.uniform(0.05, 0.95)

    def shot(scene, angle):
        seen = scene[:, 2 * angle * FINE : (2 * angle + WIDE) * FINE]
        return seen.reshape(HIGH, FINE, WIDE, FINE).mean(axis=(1, 3)).ravel()

    steps, angles = (a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(ANGLES), indexing="ij"))
    light = 2000.0 * np.concatenate([shot(wall, a) for a in angles])
    soft = 2000.0 * np.concatenate([shot(gaussian_filter(wall, sigma_px * FINE, mode="nearest"), a) for a in angles])
    v, u = (np.tile(a.ravel(), steps.size) for a in np.indices((HIGH, WIDE)))
    step = np.repeat(steps, HIGH * WIDE)
    return columns_of(pa.table({
        "step": step, "tof_temperature_c": 15.0 + 12.0 * step,
        "stage_angle_deg": np.repeat(2.0 * angles, HIGH * WIDE),
        "pixel_u": u, "pixel_v": v, "n_frames": np.full(u.size, 9),
        "sim_intensity_counts": light, "sim_intensity_counts_std": 0.03 * light,
        "sim_intensity_counts_repeat_std": 0.003 * light,
        "intensity_counts": soft * (1.0 + 0.003 * rng.normal(size=STEPS)[step])
        + 0.01 * light * rng.normal(size=u.size),
    }))  # fmt: skip


def test_a_blur_is_named_where_crosstalk_said_a_little_more_by_a_strength_that_changes():
    (found,) = diagnose(soft_camera(5, 0.25), effects=KNOWN)[0].findings
    assert found.effect == "optics.defocus"
    assert "detector.crosstalk" in found.equivalent_to
