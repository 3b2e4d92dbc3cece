"""Stray light: the waveforms of an image's pixels are added up, and a receiver of pulses or phases reads the sum."""

import numpy as np
import pytest
from operator_tables import fit, table
from rendered_bench import corrected, variant_of

ROWS, COLUMNS, IMAGES = 12, 16, 6
SHARE, PULSE_M, AMBIGUITY_M = 0.01, 0.12, 7.5
"""Of the light that strays; standard deviation of a returned pulse, and turn of a modulation, as ranges."""


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


def received(light, far, share, *, by, turned_round=False):
    """Light and range that a receiver reads off the sum: of its peak, or of the window about it."""
    at = np.linspace(0.0, 5.0, 1001)
    pulses = light[..., None] * np.exp(-0.5 * ((at - far[..., None]) / PULSE_M) ** 2)
    strays = pulses[:, ::-1] if turned_round else pulses.mean(axis=1, keepdims=True)
    seen = (1.0 - share) * pulses + share * strays
    if by == "peak":
        top = seen.argmax(axis=-1)
        low, mid, high = (np.take_along_axis(seen, (top + k)[..., None], axis=-1)[..., 0] for k in (-1, 0, 1))
        bend = 0.5 * (low - high) / (low - 2.0 * mid + high)
        return mid - 0.25 * (low - high) * bend, at[top] + bend * (at[1] - at[0])
    window = seen * (np.abs(at - far[..., None]) < 2.5 * PULSE_M)
    energy = window.sum(axis=-1)
    return energy, (window * at).sum(axis=-1) / energy


def demodulated(light, far, share):
    """Light and range that a camera reads off four integrations, each gated a quarter of the modulation later."""
    taps = [light * (1.0 + np.cos(2.0 * np.pi * far / AMBIGUITY_M - 0.5 * np.pi * k)) for k in range(4)]
    a, b, c, d = ((1.0 - share) * tap + share * tap.mean(axis=1, keepdims=True) for tap in taps)
    return np.hypot(a - c, b - d), (np.arctan2(b - d, a - c) % (2.0 * np.pi)) * AMBIGUITY_M / (2.0 * np.pi)


def images(by, *, turned_round=False):
    """The table of a receiver that a share of the light reaches by way of the lens, and of a simulation without.

    It is spread over the image, or its image turned round about the middle.
    """
    light, far = scenes()
    (clean, clean_far), (veiled, veiled_far) = (
        demodulated(light, far, share) if by == "phase"
        else received(light, far, share, by=by, turned_round=turned_round)
        for share in (0.0, SHARE)
    )  # fmt: skip
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


@pytest.mark.parametrize("by", ["peak", "window"])
def test_of_a_ghost_too_only_what_comes_within_the_own_pulse_is_read(by):
    view = images(by, turned_round=True)
    middle = {"centre_u": 0.5 * (COLUMNS - 1), "centre_v": 0.5 * (ROWS - 1)}

    def left(**options):
        variant = variant_of(view, "optics.ghost", flip="point", **options)
        start = {"share": 0.02, "pull": 1.0, **middle} | ({"overlap": 0.2} if options else {})
        found = fit(view, variant, "distance_m", start)
        state = corrected(view, variant, **found)
        before, after = (view.number("distance_m") - one["distance_m"] for one in (view.sim, state))
        return float(np.sum(after**2) / np.sum(before**2)), found

    (pulsed, values), (all_of_it, _) = left(over="pulse"), left()
    assert pulsed < 0.2 < 0.5 < all_of_it
    if by == "peak":  # a window's edges cut pulses off
        assert values["share"] * values["pull"] == pytest.approx(SHARE, rel=0.25)  # a range tells their product
        assert values["overlap"] == pytest.approx(PULSE_M, rel=0.25)


def test_light_that_strays_in_a_camera_of_phases_is_added_with_its_phase():
    view = images("phase")

    def fitted(channel, **options):
        variant = variant_of(view, "optics.veiling_glare", **options)
        shapes = {"ambiguity": 9.0} if options["over"] == "phase" else {"pull": 1.0, "overlap": 2.0}
        found = fit(view, variant, channel, {"share": 0.02} | shapes)
        state = corrected(view, variant, **found)
        before, after = (view.number(channel) - one[channel] for one in (view.sim, state))
        return float(np.sum(after**2) / np.sum(before**2)), found

    left, found = fitted("distance_m", over="phase")
    assert left < 1e-4
    assert found["share"] == pytest.approx(SHARE, rel=0.02)
    assert found["ambiguity"] == pytest.approx(AMBIGUITY_M, rel=0.02)
    assert fitted("intensity_counts", over="phase")[0] < 1e-4 < 1e-3 < fitted("intensity_counts", over="pulse")[0]
