"""A reflection between two lens surfaces comes to a focus elsewhere: its image is turned round, and blurred."""

import numpy as np
import pyarrow as pa
import pytest
from scipy.ndimage import gaussian_filter
from traced_bench import LIGHT, RANGE, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effects_mirror import Mirror, mirrored_range
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

COLUMNS, ROWS = 32, 20
RIVALS = ("optics.ghost", "optics.veiling_glare")


def boards(angle):
    """An image of three boards before a wall, as a stage turns them past: light and range."""
    u, v = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS), indexing="ij")
    at = (u - 15.5) + 1.9 * angle
    light, far = np.full(u.shape, 90.0), np.full(u.shape, 1.7)
    for left, low, shade in ((-13.0, 3, 1400.0), (-2.0, 9, 2600.0), (8.0, 1, 700.0)):
        on = (at >= left) & (at < left + 7.0) & (v >= low) & (v < low + 9)
        light, far = np.where(on, shade, light), np.where(on, 1.1, far)
    return light * np.exp(-(((v - 9.5) / 16.0) ** 2)), far


def images(blur_px):
    """Whole images, each with the ghost that the finished image throws about a point beside its middle."""
    rng = np.random.default_rng(8)
    parts = []
    for angle in (-6.0, -2.0, 3.0):
        light, far = boards(angle)
        behind = [np.roll(x[::-1, ::-1], (1, -2), (0, 1)) for x in (light, light * far)]  # about (16, 8.5)
        stray, moment = (0.004 * gaussian_filter(x, blur_px, mode="nearest") for x in behind)
        u, v = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS), indexing="ij")
        inside = (u >= 1) & (v < ROWS - 2)
        stray, moment = np.where(inside, stray, 0.0), np.where(inside, moment, 0.0)
        noise = np.sqrt(25.0 + 0.2 * light)
        blur = 0.004 + 0.4 / light
        seen, mean = light + stray, (light * far + moment) / (light + stray)
        parts.append({
            "step": np.zeros(u.size), "time_s": np.full(u.size, 10.0 * angle),
            "stage_angle_deg": np.full(u.size, angle), "pixel_u": u.ravel(), "pixel_v": v.ravel(),
            "n_frames": np.full(u.size, 20.0),
            "sim_intensity_counts": light.ravel(), "sim_intensity_counts_std": noise.ravel(),
            "sim_distance_m": far.ravel(), "sim_distance_m_std": blur.ravel(),
            "intensity_counts": (seen + noise / np.sqrt(20.0) * rng.normal(size=u.shape)).ravel(),
            "distance_m": (mean + blur / np.sqrt(20.0) * rng.normal(size=u.shape)).ravel(),
        })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([part[name] for part in parts]) for name in parts[0]}))


@pytest.mark.parametrize("blur_px", [2.0])
def test_a_ghost_out_of_focus_is_nothing_else(blur_px):
    (found,) = diagnose(images(blur_px), effects=[library()[name] for name in RIVALS])[0].findings
    assert found.effect == "optics.ghost"
    values = {p.name: p for p in found.parameters}
    assert values["share"].value == pytest.approx(0.004, rel=0.15)
    assert values["blur"].value == pytest.approx(blur_px, rel=0.2)


def test_a_ghost_of_pixels_that_the_table_lacks_is_blurred_too():
    """Strewn pixels of the nominal bench: what their mirrored pixels see comes through scattered rays."""
    columns = table(seed=5, angles=9, pixels=50)
    u, v, stage = (columns.numbers[name] for name in ("pixel_u", "pixel_v", "stage_angle_deg"))
    rng = np.random.default_rng(5)
    stray, moment = np.zeros(u.size), np.zeros(u.size)
    for du, dv in rng.normal(0.0, 1.5, (60, 2)):
        light, far = trace(127.8 - u + du, 29.4 - v + dv, stage, 0.10, places=(0.0,))
        stray, moment = stray + light / 60.0, moment + light * far / 60.0
    own = trace(u, v, stage, 0.10)[0]
    share = 0.006 * stray / own
    columns.numbers[LIGHT] = columns.numbers[LIGHT] + share * columns.numbers[f"sim_{LIGHT}"]
    moved = share / (1.0 + share) * (moment / stray - columns.numbers[f"sim_{RANGE}"])
    columns.numbers[RANGE] = columns.numbers[RANGE] + moved
    (found,) = diagnose(columns, effects=[library()[name] for name in RIVALS])[0].findings
    assert found.effect == "optics.ghost"
    blur = next(p for p in found.parameters if p.name == "blur")
    assert 0.8 < blur.value < 2.5


def test_the_range_behind_a_blur_is_that_of_the_pixels_that_have_one():
    """A flat board, of which every third pixel's echo is too weak for a range."""
    columns = images(2.0)
    far = columns.numbers[f"sim_{RANGE}"] = np.full(columns.n, 1.3)
    far[::3] = np.nan
    range_ = mirrored_range(View(columns), RANGE, LIGHT, Mirror(15.5, 9.5), 2.0)
    np.testing.assert_allclose(range_[np.isfinite(range_)], 1.3)
    assert np.isfinite(range_).mean() > 0.9
