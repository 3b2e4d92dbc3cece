"""Light of a blurred image at edges that a fine rendering softens, against many finer rays that are scattered."""

import numpy as np
import pytest
from scipy.special import ndtri

from arl_fixtures.reconcile.effects_camera import Camera
from arl_fixtures.reconcile.effects_rays import Optics, Pose, Spots, look
from arl_fixtures.twin.scene import SceneSettings

CAMERA = Camera(fx=58.1, fy=66.0, cx=63.5, cy=15.5, k4=0.198)
NORMAL = ndtri((np.arange(11) + 0.5) / 11)


def light_of(optics: Optics, spots: Spots, pose: Pose) -> np.ndarray:
    return look(optics, spots, pose)[0]


@pytest.mark.parametrize("sigma_px", [0.05, 0.12])
def test_a_blur_smaller_than_the_soft_edge_is_that_of_scattered_rays(sigma_px):
    u = np.arange(56.0, 72.0, 0.25)  # over the edges of three stripes
    spots = Spots(u=u, v=np.full(u.size, 14.0), stage_deg=np.full(u.size, 1.3), height_m=np.zeros(u.size))
    soft = Optics(camera=CAMERA, rays=3, soft_rad=1.0 / (3 * CAMERA.fx), scene=SceneSettings())
    dense = Optics(camera=CAMERA, rays=15, soft_rad=1.0 / (15 * CAMERA.fx), scene=SceneSettings())
    unit = NORMAL / NORMAL.std()
    scattered = np.mean([light_of(dense, spots.beside(sigma_px * du, 0.0), Pose()) for du in unit], axis=0)
    added = scattered - light_of(dense, spots, Pose())
    predicted = light_of(soft, spots, Pose(blur_px=sigma_px)) - light_of(soft, spots, Pose())
    size = np.max(np.abs(added))
    assert size > 1e-4
    assert np.max(np.abs(predicted - added)) < 0.15 * size
