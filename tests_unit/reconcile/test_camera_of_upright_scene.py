"""A camera of which a table holds few pixels in each row: what all of them see of upright surfaces tells its lens."""

import numpy as np
import pytest
from rendered_bench import make_columns

from arl_fixtures.reconcile.swept_rays import camera_of_sweep
from arl_fixtures.reconcile.view import View

FOCUS_PX, CENTRE = 34.0, (21.5, 6.5)
DRUM_M, STRIPES_M, STRIPE_DEG = 2.6, 1.5, np.arange(-33.0, 34.0, 6.0)


def ranges(azimuth_deg, elevation_deg, lean):
    """Range of rays from the middle of a drum with stripes before its wall, which may lean with the height."""
    off = np.abs(azimuth_deg[:, None] - lean * elevation_deg[:, None] - STRIPE_DEG[None, :]).min(axis=1)
    return np.where(off < 1.7, STRIPES_M, DRUM_M) / np.cos(np.radians(elevation_deg))


def swept(pixels, lean, seed):
    """Some pixels of a camera that is turned in steps of 2.5 degrees; of each 9 × 9 rays."""
    rng = np.random.default_rng(seed)
    all_of_them = np.stack(np.meshgrid(np.arange(44.0), np.arange(14.0)), axis=-1).reshape(-1, 2)
    chosen = all_of_them[rng.choice(len(all_of_them), pixels, replace=False)]
    stage = np.repeat(np.arange(-20.0, 20.1, 2.5), pixels)
    u, v = np.tile(chosen, (stage.size // pixels, 1)).T
    total = np.zeros(stage.size)
    for du in (np.arange(9) - 4) / 9.0:
        for dv in (np.arange(9) - 4) / 9.0:
            x, y = (u + du - CENTRE[0]) / FOCUS_PX, (v + dv - CENTRE[1]) / FOCUS_PX
            elevation = np.degrees(np.arctan2(-y, np.hypot(1.0, x)))
            total += ranges(np.degrees(np.arctan(x)) + stage, elevation, lean) / 81.0
    numbers = {"pixel_u": u, "pixel_v": v, "stage_angle_deg": stage, "sim_distance_m": total, "distance_m": total}
    return View(make_columns(numbers, {}, shuffle=seed)[0])


@pytest.mark.parametrize(("pixels", "seed"), [(26, 1), (40, 2), (80, 3)])
def test_few_pixels_of_many_rows_tell_the_lens_before_upright_stripes(pixels, seed):
    camera = camera_of_sweep(swept(pixels, 0.0, seed))
    assert camera is not None
    assert camera.fx == pytest.approx(FOCUS_PX, rel=0.01)


def test_stripes_that_lean_are_not_taken_for_upright_ones():
    assert camera_of_sweep(swept(26, 0.9, 4)) is None
