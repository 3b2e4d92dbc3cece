"""Pictures that a label, or two settings together, tell apart: neighbours are those of the same picture."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

WIDE, HIGH = 20, 14


def scene(shift):
    """Light and range of a bright bar before a wall and a leaning board, seen through wide boxes of rays."""
    fine = 12
    x = (np.arange(WIDE * fine) + 0.5) / fine
    y = (np.arange(HIGH * fine) + 0.5) / fine
    bar = (np.abs(x - 5.3 - shift) < 0.7)[None, :] & (np.abs(y - 7.0) < 4.4)[:, None]
    board = (x > 12.2)[None, :] & (y > 3.6)[:, None]
    light = np.where(bar, 6000.0, np.where(board, 900.0 + 20.0 * y[:, None], 300.0))
    far = np.where(bar, 2.4, np.where(board, 3.0 + 0.02 * x[None, :], 4.5))

    def boxes(values):
        return values.reshape(HIGH, fine, WIDE, fine).mean(axis=(1, 3))

    return boxes(light), boxes(light * far) / boxes(light)


def leak(image, beside, corner):
    """Every pixel gives a part of its charge to the eight about it."""
    framed = np.pad(image, 1)
    sides = framed[:-2, 1:-1] + framed[2:, 1:-1] + framed[1:-1, :-2] + framed[1:-1, 2:]
    corners = framed[:-2, :-2] + framed[:-2, 2:] + framed[2:, :-2] + framed[2:, 2:]
    return image * (1.0 - 4.0 * (beside + corner)) + beside * sides + corner * corners


def pictures(rng, labels):
    """A table of one picture for each label, in a random order of its rows."""
    v, u = (x.ravel() for x in np.mgrid[0:HIGH, 0:WIDE])
    parts = []
    for k, columns in enumerate(labels):
        light, far = scene(1.7 * k)
        true = leak(light, 0.004, 0.001)
        true_far = leak(light * far, 0.004, 0.001) / true
        sigma, sigma_far = np.sqrt(25.0 + 0.3 * light), 0.006 + 0.6 / np.sqrt(light)
        parts.append({
            **{name: np.full(u.size, value) for name, value in columns.items()},
            "pixel_u": u.astype(float), "pixel_v": v.astype(float), "n_frames": np.full(u.size, 4.0),
            "sim_intensity_counts": light.ravel(), "sim_intensity_counts_std": sigma.ravel(),
            "sim_distance_m": far.ravel(), "sim_distance_m_std": sigma_far.ravel(),
            "intensity_counts": rng.normal(true, sigma / 2.0).ravel(),
            "distance_m": rng.normal(true_far, sigma_far / 2.0).ravel(),
        })  # fmt: skip
    order = rng.permutation(u.size * len(labels))
    return columns_of(pa.table({n: np.concatenate([p[n] for p in parts])[order] for n in parts[0]}))


def test_pixels_of_pictures_that_a_label_tells_apart_leak_into_their_own_neighbours():
    table = pictures(np.random.default_rng(11), [{"scene": f"bar_{k}"} for k in range(4)])
    findings = diagnose(table)[0].findings
    assert [f.effect for f in findings] == ["detector.crosstalk"]


def test_two_settings_together_tell_pictures_apart():
    settings = [{"board_offset_m": x, "modulation_hz": f} for x in (0.1, 0.25) for f in (20e6, 35e6)]
    table = pictures(np.random.default_rng(12), settings)
    assert set(table.image_columns) > {"board_offset_m", "modulation_hz"}
    label_and_setting = [{"scene": s, "board_offset_m": x} for s in ("a", "b") for x in (0.1, 0.25)]
    assert set(pictures(np.random.default_rng(13), label_and_setting).image_columns) > {"scene", "board_offset_m"}
