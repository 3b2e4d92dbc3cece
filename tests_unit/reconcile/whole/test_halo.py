"""Light that a lens scatters falls off about its source: a bright panel veils its own half of the image more."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from arl_fixtures.reconcile.command import reconcile

IMAGES, ROWS, COLUMNS = 24, 18, 26


def scenes(rng):
    """Panels of several reflectances before a dark wall, elsewhere in each image; light and range."""
    v, u = np.mgrid[:ROWS, :COLUMNS]
    light, far = np.full((IMAGES, ROWS, COLUMNS), 55.0), np.full((IMAGES, ROWS, COLUMNS), 3.2)
    for image in range(IMAGES):
        for _ in range(4):
            x, y, wide, high = rng.uniform(0, COLUMNS), rng.uniform(0, ROWS), rng.uniform(2, 6), rng.uniform(2, 5)
            on = (abs(u - x) < wide) & (abs(v - y) < high)
            far[image][on] = rng.uniform(1.2, 2.6)
            light[image][on] = rng.choice([120.0, 500.0, 2300.0]) / far[image][on] ** 2 * 3.0
    return light, far


def veiled(seed, share, core_px):
    """Scattered by (1 + (r / core)²)^(−3/2), as dust on a lens does, out to the whole image; a share of the light."""
    rng = np.random.default_rng(seed)
    light, far = scenes(rng)
    y, x = np.mgrid[1 - ROWS : ROWS, 1 - COLUMNS : COLUMNS]
    kernel = (1.0 + (x**2 + y**2) / core_px**2) ** -1.5
    kernel /= kernel.sum()
    came = np.array([fftconvolve(image, kernel, mode="same") for image in light])
    seen = (1.0 - share) * light + share * came
    image, row, column = (a.ravel() for a in np.indices(light.shape))
    scatter = np.sqrt(20.0 + 0.4 * light.ravel())
    gain = float(np.sum(seen * light) / np.sum(light**2))  # the user's
    return {
        "step": image, "pixel_u": column, "pixel_v": row, "true_range_m": far.ravel(),
        "sim_intensity_counts": gain * light.ravel(), "sim_intensity_counts_std": scatter,
        "sim_intensity_counts_repeat_std": 0.002 * light.ravel(), "n_frames": np.full(image.size, 16),
        "intensity_counts": seen.ravel() + rng.normal(size=image.size) * scatter / 4.0
        + 0.002 * light.ravel() * rng.normal(size=IMAGES)[image],
    }  # fmt: skip


@pytest.mark.parametrize(("share", "core_px"), [(0.003, 5.0), (0.006, 2.5)])
def test_a_halo_is_a_glare_and_no_blur(tmp_path, save, share, core_px):
    found = reconcile(save(tmp_path / "table.parquet", veiled(1, share, core_px)), tmp_path / "out").findings
    assert [f.effect for f in found] == ["optics.veiling_glare"]


def test_a_clean_lens_has_none(tmp_path, save):
    assert reconcile(save(tmp_path / "table.parquet", veiled(1, 0.0, 5.0)), tmp_path / "out").findings == []
