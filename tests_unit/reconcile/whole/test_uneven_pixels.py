"""Pixels are made one by one: what is alike among neighbours is no pattern of their gains."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.uneven_pixels import is_smooth

KNOWN = [library()[name] for name in ("detector.pixel_response", "detector.gain_temperature")]


def still_camera(seed, pattern):
    """A camera that always sees one wall, 12 by 9 pixels, 14 temperatures."""
    rng = np.random.default_rng(seed)
    step, v, u = (a.ravel() for a in np.meshgrid(np.arange(14), np.arange(9), np.arange(12), indexing="ij"))
    light = 900.0 - 6.0 * (u - 6.0) ** 2
    return columns_of(pa.table({
        "step": step, "tof_temperature_c": 10.0 + 4.0 * step, "pixel_u": u * 10, "pixel_v": v * 10,
        "n_frames": np.full(u.size, 10), "sim_intensity_counts": light, "sim_intensity_counts_std": 0.02 * light,
        "sim_intensity_counts_repeat_std": 0.002 * light,
        "intensity_counts": light * (1.0 + pattern[v, u]) * (1.0 + 0.002 * rng.normal(size=14)[step])
        + 0.02 / np.sqrt(10.0) * light * rng.normal(size=u.size),
    }))  # fmt: skip


def stray():
    """What a lamp's light does on its way over two mirrors: rays by the thousand, counted where they land."""
    rng = np.random.default_rng(3)
    landed = np.stack([rng.normal(8.0, 2.4, 40000), rng.normal(3.0, 2.0, 40000)])
    counted = np.histogram2d(landed[1], landed[0], bins=[np.arange(10) - 0.5, np.arange(13) - 0.5])[0]
    return 0.03 * counted / counted.max()


def test_uneven_pixels_are_named_and_stray_light_is_not():
    uneven = 0.006 * np.random.default_rng(5).normal(size=(9, 12))
    named = [[f.effect for f in diagnose(still_camera(2, p), effects=KNOWN)[0].findings] for p in (uneven, stray())]
    assert named[0] == ["detector.pixel_response"]
    assert set(named[1]) == {"unknown"}


@pytest.mark.parametrize("units", [1, 3])
def test_likeness_is_that_of_neighbours_of_one_device(units):
    rng = np.random.default_rng(units)
    keys = [(f"{k}", f"{u}", f"{v}") for k in range(units) for u in range(8) for v in range(6)]
    names = ("dut", "pixel_u", "pixel_v")
    bowl = np.array([(float(u) - 3.5) ** 2 + int(k) for k, u, _ in keys])
    assert is_smooth(names, keys, bowl + rng.normal(size=bowl.size))
    assert not is_smooth(names, keys, rng.normal(size=bowl.size))
    assert not is_smooth(names, keys, np.where(bowl > 12.0, np.nan, rng.normal(size=bowl.size)))
    assert not is_smooth(("dut",), [("a",), ("b",)], np.array([1.0, 2.0]))
