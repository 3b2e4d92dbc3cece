"""Exposures that begin while a sensor still looks at the stage position before: histograms of both add up."""

import numpy as np
import pytest
from rendered_bench import corrected, make_columns, variant_of

from arl_fixtures.reconcile.view import View

BINS_M, PULSE_M, SHARE = np.arange(0.0, 12.0, 0.02), 0.15, 0.08
PIXELS, ANGLES = 24, np.arange(-12.0, 13.0, 3.0)


def waveforms(steps):
    """Mean histogram of every pixel at every angle and step, and of what it would be without the delay."""
    rng = np.random.default_rng(5)
    shape = steps, ANGLES.size, PIXELS
    range_m = np.broadcast_to(rng.choice([2.5, 4.0, 7.5], shape[1:]) + rng.uniform(-0.2, 0.2, shape[1:]), shape)
    light = np.broadcast_to(rng.uniform(0.1, 0.9, shape[1:]) * 3e4, shape) / range_m**2
    clear = light[..., None] * np.exp(-0.5 * ((BINS_M - range_m[..., None]) / PULSE_M) ** 2)
    late = clear.copy()
    late[:, 1:] = (1.0 - SHARE) * clear[:, 1:] + SHARE * clear[:, :-1]
    return clear, late


def as_table(steps=3):
    clear, late = waveforms(steps)
    step, angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(steps), ANGLES, np.arange(PIXELS), indexing="ij"))
    found = {}
    for prefix, histogram in (("sim_", clear), ("", late)):
        light = histogram.sum(axis=-1)
        found[f"{prefix}intensity_counts"] = light.ravel()
        found[f"{prefix}distance_m"] = (histogram @ BINS_M / light).ravel()
    numbers = found | {
        "step": step.astype(float), "stage_angle_deg": angle, "pixel_u": pixel.astype(float),
        "time_s": 900.0 * step + 10.0 * (angle - ANGLES[0]), "n_frames": np.full(step.size, 8.0),
        "sim_intensity_counts_std": 0.02 * found["sim_intensity_counts"],
        "sim_distance_m_std": np.full(step.size, 0.02),
    }  # fmt: skip
    return View(make_columns(numbers, {})[0])


def left(view, channel, **options):
    variant = variant_of(view, "acquisition.frame_lag", frames=1, **options)
    state = corrected(view, variant, share=SHARE)
    after = view.number("stage_angle_deg") > ANGLES[0]
    before, now = ((view.number(channel) - s[channel]) ** 2 for s in (view.sim, state))
    return float(now[after].sum() / before[after].sum())


@pytest.mark.parametrize("channel", ["intensity_counts", "distance_m"])
def test_histograms_of_two_places_add_up(channel):
    assert left(as_table(), channel, mean="by light") < 1e-6


def test_a_mean_over_frames_is_another_distance():
    """What tells a buffer that hands out stale frames from a shutter that opens too early."""
    assert left(as_table(), "distance_m") > 0.2
