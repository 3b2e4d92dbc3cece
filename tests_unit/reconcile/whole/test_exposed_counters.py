"""Exposures or an amplifier that were switched: what goes with the rate, and what is multiplied with the signal."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

DEAD_S = 20e-9


def recorded(settings, channel, plain, seen, sigma, rng):
    """A table of what was seen beside what was simulated: 25 frames a row, steps that share a thousandth."""
    steps, rows = int(settings["step"].max()) + 1, len(plain)
    shared = 1.0 + 1e-3 * rng.normal(size=steps)[settings["step"]]
    return columns_of(pa.table({
        **settings, "n_frames": np.full(rows, 25), f"sim_{channel}": plain, f"sim_{channel}_std": sigma,
        f"sim_{channel}_repeat_std": 1e-3 * plain,
        channel: seen * shared + sigma / 5.0 * rng.normal(size=rows),
    }))  # fmt: skip


def counted(seed):
    """Photons of a Poisson process with a dead time, counted one by one in a thousandth of each exposure."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(24), 40)
    exposure_s = np.array([1e-3, 2e-3, 5e-3])[step % 3]
    rate_hz = np.tile(np.geomspace(2e4, 3e6, 40), 24)
    share = {}
    for rate in np.unique(rate_hz):  # renewal: each photon that counts blinds what comes within the dead time
        waits = DEAD_S + rng.exponential(1.0 / rate, 400_000)
        share[rate] = len(waits) / waits.sum() / rate
    plain = rate_hz * exposure_s
    seen = plain * np.array([share[rate] for rate in rate_hz])
    settings = {"step": step, "integration_time_us": 1e6 * exposure_s, "photon_flux": rate_hz / 1e6}
    return recorded(settings, "signal_counts", plain, seen, np.sqrt(plain + 25.0), rng)


def test_pile_up_goes_with_the_photons_of_a_second_not_with_those_of_an_exposure():
    (found,) = diagnose(counted(7))[0].findings
    assert found.effect == "detector.pile_up"
    assert "integration_time_us" in found.drivers
    assert "detector.compression" not in found.equivalent_to


def amplified(seed):
    """A photodiode's dark charge, doubling every 8 K, before an amplifier of three gains."""
    rng = np.random.default_rng(seed)
    step = np.repeat(np.arange(27), 36)
    warm = np.linspace(10.0, 55.0, 9)[(step // 3) % 9]
    gain = np.array([1.0, 4.0, 16.0])[step % 3]
    light = np.tile(np.geomspace(0.003, 0.2, 36), 27)
    dark = 3e-4
    for _ in range(1000):  # from 55 °C down in steps of 0.045 K: each loses a share of what is left
        dark *= 2.0 ** (-0.045 / 8.0)
    current = light + dark * 2.0 ** ((warm - 10.0) / 8.0)
    read = warm + 0.05 * rng.normal(size=27)[step]
    settings = {"step": step, "gain_setting": gain, "housing_temperature_c": read}
    return recorded(settings, "signal_v", light * gain, gain * current, 3e-4 * gain + 2e-3 * light * gain, rng)


def test_a_dark_signal_is_amplified_with_the_light():
    (found,) = diagnose(amplified(8))[0].findings
    assert found.effect == "detector.dark_offset"
    assert "gain_setting" in found.drivers
    doubling = next(p for p in found.parameters if p.name == "doubling")
    assert doubling.value == pytest.approx(8.0, rel=0.15)
