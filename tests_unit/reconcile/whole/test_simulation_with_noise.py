"""A simulation that counts photons, too: what averages its noise is no light from elsewhere."""

import numpy as np
import pytest

from arl_fixtures.reconcile.columns import Columns
from arl_fixtures.reconcile.reconcile import diagnose
from tests_unit.reconcile.whole.test_seldom_names import columns_of

ROWS, COLUMNS, ANGLES, STEPS = 6, 16, np.array([-9.0, -4.0, 0.0, 5.0, 10.0]), 14
LIGHT, FAR = "intensity_counts", "distance_m"


def wall(mirrored: float, frames: float, seed: int) -> Columns:
    """A wall with upright boards, lit evenly from row to row; `mirrored` of each half's light is in the other one.

    Photons are counted in 60 frames, and in `frames` of the simulation.
    """
    rng = np.random.default_rng(seed)
    step, at, row, column = (
        a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(ANGLES.size), np.arange(ROWS), np.arange(COLUMNS),
                                       indexing="ij")
    )  # fmt: skip
    bearing = 3.0 * (column - 0.5 * (COLUMNS - 1)) + ANGLES[at]
    lift = 3.0 * (row - 0.5 * (ROWS - 1))
    far = np.where(np.abs(bearing - 4.0) < 7.0, 2.2, 3.6) / np.cos(np.radians(bearing)) / np.cos(np.radians(lift))
    light = 9e3 * np.where(far < 2.6, 0.8, 0.4) * np.cos(np.radians(bearing)) ** 2 / far**2
    lamp = 1.0 + (0.6 * (row >= ROWS // 2) if mirrored else 0.0)  # the upper half is lit more, where there is a ghost
    light = light * lamp
    image = light.reshape(STEPS, ANGLES.size, ROWS, COLUMNS)
    real = (image + mirrored * image[:, :, ::-1]).ravel()
    spread = {LIGHT: np.sqrt(50.0 + 2.0 * light), FAR: 0.9 / np.sqrt(light)}
    table = {
        "step": step, "stage_angle_deg": ANGLES[at], "pixel_u": column, "pixel_v": row,
        "azimuth_deg": bearing - ANGLES[at],
        "elevation_deg": lift, "n_frames": np.full(step.size, 60.0),
    }  # fmt: skip
    for name, (truth, nominal) in {LIGHT: (real, light), FAR: (far, far)}.items():
        table |= {f"sim_{name}": nominal + spread[name] / np.sqrt(frames) * rng.normal(size=step.size),
                  f"sim_{name}_std": spread[name], f"sim_{name}_repeat_std": np.full(step.size, 1e-4),
                  name: truth + spread[name] / np.sqrt(60.0) * rng.normal(size=step.size)}  # fmt: skip
    return columns_of(table)


@pytest.mark.parametrize("seed", [1, 2])
def test_an_image_like_its_mirror_is_no_ghost(seed):
    assert diagnose(wall(0.0, 600.0, seed))[0].findings == []


def test_a_ghost_beside_noise_of_the_simulation_is_named():
    assert [found.effect for found in diagnose(wall(0.004, 600.0, 3))[0].findings] == ["optics.ghost"]
