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


def bent_drop(seed, loss):
    """Few pixels of a turning camera that warms up, behind a drop that dried in a bent shape (or a lens of one)."""
    rng = np.random.default_rng(seed)
    place = rng.choice(40 * 23, 24, replace=False)
    u, v = 50.0 + place % 40, 6.0 + place // 40
    step, angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(29), np.arange(24), indexing="ij"))
    light = 900.0 + 600.0 * np.sign(np.cos(0.25 * u[pixel] + 0.5 * angle))
    # all of the drop that a pixel's light passes
    beam = rng.normal(0.0, 1.2, (600, 2))
    across, along = (u[:, None] + beam[:, 0] - 77.0) / 11.0, (v[:, None] + beam[:, 1] - 19.0) / 5.0
    passed = 1.0 - loss * np.mean(np.hypot(across, along + 1.1 * np.sin(2.0 * across)) < 1.0, axis=1)
    warm = np.interp(10.0 + 18.0 * step, [10.0, 64.0], [1.08, 0.92]) * (1.0 + 0.02 * rng.normal(size=4)[step])
    return columns_of(pa.table({
        "step": step, "tof_temperature_c": 10.0 + 18.0 * step, "stage_angle_deg": 1.0 * angle,
        "pixel_u": u[pixel], "pixel_v": v[pixel], "n_frames": np.full(step.size, 3),
        "sim_intensity_counts": light, "sim_intensity_counts_std": 0.05 * light,
        "sim_intensity_counts_repeat_std": 0.02 * light,
        "intensity_counts": light * passed[pixel] * warm + 0.05 / np.sqrt(3.0) * light * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize(("loss", "also"), [(0.08, "optics.window_contamination"), (-0.08, "unknown")])
def test_what_neighbours_share_is_told_beside_a_name_of_the_same_channel(loss, also):
    known = [*KNOWN, library()["optics.window_contamination"]]
    found = diagnose(bent_drop(3, loss), effects=known)[0].findings
    assert {f.effect for f in found} == {"detector.gain_temperature", also}
    told = next(f for f in found if f.effect == also)
    assert set(told.drivers) == {"pixel_u", "pixel_v"}
