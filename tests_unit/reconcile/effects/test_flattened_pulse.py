"""A receiver that flattens a pulse's top changes its signal and the place of its middle, to either side."""

import numpy as np
import pytest
from operator_tables import table
from rendered_bench import corrected, variant_of
from scipy.optimize import least_squares

LIGHT_MPS = 299_792_458.0


def received(light, steep, timed_by):
    """Integral and range shift (m) of a pulse with a slow tail behind a soft limiter at 8000."""
    time = np.linspace(-6e-9, 30e-9, 3000)
    pulse = np.where(time < 0.0, np.exp(-0.5 * (time / 1.2e-9) ** 2), np.exp(-time / 4e-9))
    wave = light[:, None] * pulse
    wave = wave / (1.0 + (wave / 8000.0) ** steep) ** (1.0 / steep)
    if timed_by == "centre":
        when = (wave @ time) / wave.sum(axis=1)
    else:  # the rising edge at half of the top
        half = 0.5 * wave.max(axis=1)
        when = np.array([np.interp(h, w[: w.argmax()], time[: w.argmax()]) for h, w in zip(half, wave, strict=True)])
    return wave.sum(axis=1) / pulse.sum(), 0.5 * LIGHT_MPS * (when - when[0])


@pytest.mark.parametrize(("timed_by", "sign"), [("centre", 1.0), ("edge", -1.0)])
def test_a_flattened_pulse_is_compression_of_signal_and_distance_together(timed_by, sign):
    light = np.geomspace(20.0, 3000.0, 120)
    signal, moved = received(light, 1.3, timed_by)
    view = table(sim_signal_counts=light, signal_counts=signal, sim_distance_m=2.0, distance_m=2.0 + moved)
    variant = variant_of(view, "detector.compression", distance="distance_m")
    assert np.sign(moved[-1]) == sign

    def left(x):
        state = corrected(view, variant, strength=x[0], sharpness=x[1], shift=x[2])
        light_left = state["signal_counts"] / signal - 1.0
        return np.concatenate([light_left / 1e-3, (state["distance_m"] - 2.0 - moved) / np.ptp(moved)])

    best = least_squares(left, [0.2, 1.5, 0.05 * sign], bounds=([0.0, 0.5, -5.0], [20.0, 12.0, 5.0]))
    rest = left(best.x)
    assert np.abs(rest[:120]).max() < 8.0
    assert np.abs(rest[120:]).max() < 0.15
    assert np.sign(best.x[2]) == sign
