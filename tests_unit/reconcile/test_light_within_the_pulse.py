"""Stray light of a pulsed camera: the waveforms of an image's pixels are added up, and a receiver reads the sum."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import corrected, variant_of

ROWS, COLUMNS, IMAGES = 12, 16, 6
SHARE, PULSE_M = 0.01, 0.12
"""Of the light that strays; standard deviation of a returned pulse, as a range."""


def scenes():
    """Boards at six ranges before a wall, some dim; light and range of each pixel of each image."""
    rng = np.random.default_rng(4)
    v, u = np.mgrid[:ROWS, :COLUMNS]
    light, far = np.full((IMAGES, ROWS, COLUMNS), 150.0), np.full((IMAGES, ROWS, COLUMNS), 3.4)
    for image in range(IMAGES):
        for reach in (1.3, 1.6, 2.0, 2.2, 2.7, 3.1):
            x, y = rng.uniform(0.0, COLUMNS), rng.uniform(0.0, ROWS)
            on = (abs(u - x) < 2.5) & (abs(v - y) < 2.5)
            far[image][on] = reach + 0.02 * (u - x)[on]
            light[image][on] = rng.choice([80.0, 400.0, 2500.0])
    return light.reshape(IMAGES, -1), far.reshape(IMAGES, -1)


def received(light, far, share, *, by):
    """Light and range that a receiver reads off the sum: of its peak, or of the window about it."""
    at = np.linspace(0.0, 5.0, 1001)
    pulses = light[..., None] * np.exp(-0.5 * ((at - far[..., None]) / PULSE_M) ** 2)
    seen = (1.0 - share) * pulses + share * pulses.mean(axis=1, keepdims=True)
    if by == "peak":
        top = seen.argmax(axis=-1)
        low, mid, high = (np.take_along_axis(seen, (top + k)[..., None], axis=-1)[..., 0] for k in (-1, 0, 1))
        bend = 0.5 * (low - high) / (low - 2.0 * mid + high)
        return mid - 0.25 * (low - high) * bend, at[top] + bend * (at[1] - at[0])
    window = seen * (np.abs(at - far[..., None]) < 2.5 * PULSE_M)
    energy = window.sum(axis=-1)
    return energy, (window * at).sum(axis=-1) / energy


def images(by):
    """The table of a receiver that a share of the light reaches by way of the lens, and of a simulation without."""
    light, far = scenes()
    (clean, clean_far), (veiled, veiled_far) = (received(light, far, share, by=by) for share in (0.0, SHARE))
    v, u = np.mgrid[:ROWS, :COLUMNS]
    return table(
        step=np.repeat(np.arange(IMAGES), ROWS * COLUMNS),
        pixel_u=np.tile(u.ravel(), IMAGES), pixel_v=np.tile(v.ravel(), IMAGES), stage_angle_deg=0.0,
        sim_intensity_counts=clean.ravel(), sim_distance_m=clean_far.ravel(),
        intensity_counts=veiled.ravel(), distance_m=veiled_far.ravel(),
    )  # fmt: skip


@pytest.mark.parametrize("by", ["peak", "window"])
def test_only_light_that_comes_within_the_own_pulse_is_read_with_it(by):
    view = images(by)

    def left(channel, **options):
        variant = variant_of(view, "optics.veiling_glare", **options)
        start = {"share": 0.02, "pull": 1.0} | ({"overlap": 0.2} if "over" in options else {})
        state = corrected(view, variant, **fit(view, variant, channel, start))
        before, after = (view.number(channel) - one[channel] for one in (view.sim, state))
        return float(np.sum(after**2) / np.sum(before**2))

    assert left("distance_m", over="pulse") < 0.1 < 0.5 < left("distance_m")
    assert left("intensity_counts", over="pulse") < 0.1 < left("intensity_counts")


def test_the_width_of_the_pulse_is_found():
    view = images("peak")
    variant = variant_of(view, "optics.veiling_glare", over="pulse")
    found = fit(view, variant, "distance_m", {"share": 0.02, "pull": 1.0, "overlap": 0.3})
    assert found["overlap"] == pytest.approx(PULSE_M, rel=0.15)
