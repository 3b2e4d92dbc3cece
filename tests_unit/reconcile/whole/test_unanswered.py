"""Pixels that stop answering in a table that has no share of frames with a return: their rows are simply empty."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[n] for n in ("detector.dead_pixels", "detector.pixel_response", "optics.window_contamination")]
BINS, FRAMES = 64, 10


def recorded(seed, gone=lambda *_: False, dim=0.3):
    """Two cameras of 30 pixels over 3 cycles of 4 steps: counts of photons, a return where a bin's count is high."""
    rng = np.random.default_rng(seed)
    axes = np.meshgrid(np.arange(2), np.arange(3), np.arange(4), np.arange(5), np.arange(30), indexing="ij")
    dut, cycle, step, angle, pixel = (a.ravel() for a in axes)
    light = 60.0 * np.where(pixel % 10 == 4, dim, np.array([0.5, 1.0])[pixel % 2]) * (1.0 + 0.1 * angle)
    sigma = np.sqrt(light + 3.0)
    level = rng.poisson(0.05, (dut.size, BINS)).max(axis=1) + 2.0 * np.sqrt(3.0)  # a threshold over the background
    lost = (rng.poisson(light) < level) | (rng.random(dut.size) < 0.01)
    lost |= np.array([gone(*row) for row in zip(dut, cycle, step, pixel, strict=True)])
    seen = light + sigma / np.sqrt(FRAMES) * rng.normal(size=dut.size)
    return {
        "dut": np.array(["A", "B"])[dut], "cycle": cycle, "step": step, "stage_angle_deg": 10.0 * angle,
        "housing_temperature_c": 20.0 * step, "pixel_u": pixel % 6, "pixel_v": pixel // 6,
        "n_frames": np.full(dut.size, FRAMES), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": np.where(lost, np.nan, seen),
        "sim_distance_m": np.full(dut.size, 2.0), "sim_distance_m_std": np.full(dut.size, 0.01),
        "distance_m": np.where(lost, np.nan, 2.0 + 0.01 / np.sqrt(FRAMES) * rng.normal(size=dut.size)),
    }  # fmt: skip


def findings(columns):
    return diagnose(columns_of(pa.table(columns)), effects=KNOWN)[0].findings


def stops_late(dut, cycle, step, pixel):
    return dut == 1 and pixel == 13 and cycle == 2 and step >= 2


def test_a_pixel_that_stops_answering_on_the_way_is_dead():
    (found,) = findings(recorded(1, stops_late))
    assert found.effect == "detector.dead_pixels"
    assert found.where["pixel_u"] == [1.0]
    assert found.where["pixel_v"] == [2.0]


def test_one_that_never_answered_is_dead():
    (found,) = findings(recorded(2, lambda dut, _cycle, _step, pixel: dut == 0 and pixel == 5))
    assert found.effect == "detector.dead_pixels"


def test_dim_pixels_that_mostly_miss_are_not():
    """They hardly ever reach the threshold: some have no return in all of a cycle."""
    columns = recorded(3, dim=0.02)
    dim = columns["sim_intensity_counts"] < 3.0
    assert np.mean(np.isnan(columns["intensity_counts"][dim])) > 0.9
    assert findings(columns) == []


@pytest.mark.parametrize("lacks", [
    lambda dut, cycle, step, _pixel: dut == 1 and cycle == 2 and step >= 2,  # the camera was taken away
    lambda _dut, cycle, step, pixel: pixel == 13 and cycle == 1 and step == 2,  # and it came back
])  # fmt: skip
def test_what_all_pixels_lack_or_what_comes_back_is_no_death(lacks):
    assert findings(recorded(4, lacks)) == []
