"""A read-out that mixes the noise of neighbours: patches that chance makes are no picture, a picture still is one."""

import numpy as np
import pyarrow as pa
from scipy.ndimage import convolve

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

ROWS, COLUMNS, STEPS, STOPS, FRAMES = 12, 26, 6, 3, 8
MIXED = np.array([[0.12, 0.35, 0.12], [0.35, 1.0, 0.35], [0.12, 0.35, 0.12]])
"""What an interpolating read-out makes of a pixel's own noise."""


def frames(rng):
    """Mean of some frames' noise, of unit size for one frame, each mixed over its neighbours."""
    kernel = MIXED / np.sqrt(np.sum(MIXED**2))
    noise = [convolve(rng.normal(size=(ROWS, COLUMNS)), kernel, mode="wrap") for _ in range(FRAMES)]
    return np.mean(noise, axis=0)


def camera(seed, narrower=0.0, repeats=0.0):
    """A camera before greys at six temperatures and three angles; its beam may be narrower than was thought.

    Its light may repeat from step to step to a share only, as the simulation states.
    """
    rng = np.random.default_rng(seed)
    v, u = np.meshgrid(np.arange(ROWS), np.arange(COLUMNS), indexing="ij")
    azimuth, elevation = 1.9 * (u - 12.5), 1.9 * (v - 5.5)
    rows = []
    for step in range(STEPS):
        gain = 1.0 + repeats * rng.normal() if repeats else 1.0
        for stop in range(STOPS):
            grey = np.array([0.1, 0.25, 0.5, 0.8])[(u // 7 + v // 4 + stop) % 4]
            beam, real = (np.exp(-((azimuth / (31.0 * k)) ** 2 + (elevation / (18.0 * k)) ** 2) / 2.0)
                          for k in (1.0, 1.0 - narrower))  # fmt: skip
            far = np.full(u.shape, 1.5 + 0.4 * stop)
            light = 2600.0 * grey / far**2
            noise, jitter = np.sqrt(60.0 + 0.7 * light * beam), 0.004 + 0.12 / np.sqrt(light * beam)
            rows.append({
                "step": np.full(u.shape, step), "set_temperature_c": np.full(u.shape, 10.0 * step),
                "stage_angle_deg": np.full(u.shape, 20.0 * stop), "pixel_u": u, "pixel_v": v,
                "azimuth_deg": azimuth, "elevation_deg": elevation, "n_frames": np.full(u.shape, FRAMES),
                "sim_intensity_counts": light * beam, "sim_intensity_counts_std": noise,
                "sim_intensity_counts_repeat_std": repeats * light * beam,
                "intensity_counts": gain * light * real + noise * frames(rng), "sim_distance_m": far,
                "sim_distance_m_std": jitter, "distance_m": far + jitter * frames(rng),
            })  # fmt: skip
    return columns_of(pa.table({n: np.concatenate([r[n].ravel() for r in rows]).astype(float) for n in rows[0]}))


def test_patches_of_noise_are_no_mismatch():
    assert [diagnose(camera(seed))[0].findings for seed in (1, 2)] == [[], []]


def test_patches_of_noise_are_no_mismatch_where_steps_scatter_more_than_rows():
    assert [diagnose(camera(seed, repeats=0.03))[0].findings for seed in (1, 2)] == [[], []]


def test_a_beam_is_still_seen_through_them():
    found = diagnose(camera(3, narrower=0.02))[0].findings
    assert [f.effect for f in found] == ["beam.profile_change"]
