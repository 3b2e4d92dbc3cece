"""Crosstalk before the echo is found: a neighbour's pulse adds to a trace, and is read where the own pulse is."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

COLUMNS, ROWS, PULSE_M = 20, 14, 0.45
TICKS_M = np.arange(0.0, 14.0, 0.05)


def scene(rng):
    """Ranges and light of a wall, a floor that comes nearer and boards, some of them of sheeting."""
    v, u = np.mgrid[0:ROWS, 0:COLUMNS]
    far = np.full(u.shape, rng.uniform(7.0, 10.0)) / np.cos(np.radians(2.0 * (u - 9.5)))
    far = np.where(v > 9, 6.5 - 0.8 * (v - 9), far)
    light = 9e4 * 0.3 / far**2
    for _ in range(6):
        left, top, wide = rng.integers(0, COLUMNS - 3), rng.integers(0, 8), rng.integers(1, 4)
        board = (u >= left) & (u < left + wide) & (v >= top) & (v < top + 4)
        near = rng.uniform(3.0, 9.0)
        far = np.where(board, near, far)
        light = np.where(board, 9e4 * rng.choice([0.1, 0.6, 6.0]) / near**2, light)
    return far, light


def read(far, light, leak):
    """Peak and its place of each pixel's trace about its own echo, by a parabola through three samples."""
    traces = light[..., None] * np.exp(-0.5 * ((TICKS_M - far[..., None]) / PULSE_M) ** 2)
    ringed = np.pad(traces, ((1, 1), (1, 1), (0, 0)), mode="edge")
    for dv in (-1, 0, 1):
        for du in (-1, 0, 1):
            if du or dv:
                beside = ringed[1 + dv : 1 + dv + ROWS, 1 + du : 1 + du + COLUMNS]
                traces = traces + leak * (0.25 if du and dv else 1.0) * beside
    about = np.abs(TICKS_M - far[..., None]) < PULSE_M
    top = np.argmax(np.where(about, traces, -1.0), axis=-1)[..., None]
    low, mid, high = (np.take_along_axis(traces, top + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = low - 2.0 * mid + high
    place = 0.5 * (low - high) / bend
    return TICKS_M[top[..., 0]] + 0.05 * place, mid - 0.25 * (low - high) * place


def camera_table(seed, leak, images=7):
    """Images of as many scenes, read with and without the leak; frames as a camera of few counts scatters them."""
    rng = np.random.default_rng(seed)
    rows = []
    for image in range(images):
        far, light = scene(rng)
        v, u = np.mgrid[0:ROWS, 0:COLUMNS]
        (range_m, counts), (true_m, true_counts) = (read(far, light, share) for share in (0.0, leak))
        sigma, sigma_m = np.sqrt(counts + 100.0), 0.6 / np.sqrt(counts)
        rows.append({
            "scene": np.full(u.shape, image), "pixel_u": u, "pixel_v": v, "n_frames": np.full(u.shape, 40),
            "sim_distance_m": range_m, "sim_distance_m_std": sigma_m, "sim_intensity_counts": counts,
            "sim_intensity_counts_std": sigma,
            "distance_m": true_m + sigma_m / np.sqrt(40.0) * rng.normal(size=u.shape),
            "intensity_counts": true_counts + sigma / np.sqrt(40.0) * rng.normal(size=u.shape),
        })  # fmt: skip
    return columns_of(pa.table({name: np.concatenate([r[name].ravel() for r in rows]) for name in rows[0]}))


@pytest.mark.parametrize("seed", [3, 4])
def test_what_leaks_before_the_echo_is_found_is_crosstalk(seed):
    (found,) = diagnose(camera_table(seed, 4e-3))[0].findings
    assert found.effect == "detector.crosstalk"
    share = next(p for p in found.parameters if p.name == "share")
    assert share.value == pytest.approx(4e-3, rel=0.25)
