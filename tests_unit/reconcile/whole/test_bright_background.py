"""A histogram of first photons, bin by bin: what the background has fired is blind when the pulse comes."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

SHOTS, BINS, BIN_M = 40_000, 160, 0.05


def histogram(photons, ambient, centre):
    """Expected first photons per bin of a Gaussian pulse over a background, and those without dead time."""
    place = np.arange(BINS) * BIN_M
    pulse = photons * np.exp(-0.5 * ((place - centre) / 0.12) ** 2)
    pulse = pulse / 0.12 / np.sqrt(2.0 * np.pi) * BIN_M
    rate = pulse + ambient / BINS
    before = np.concatenate([[0.0], np.cumsum(rate)[:-1]])
    fired = np.exp(-before) * (1.0 - np.exp(-rate))
    return SHOTS * np.sum(fired * pulse / rate), SHOTS * photons


@pytest.mark.parametrize("most", [0.0, 0.5])
def test_photons_of_the_background_take_shots_from_the_pulse(most):
    rng = np.random.default_rng(17)
    far = np.tile(np.linspace(3.0, 7.0, 40), 15)
    paint, level = np.repeat(np.tile([0.1, 0.2, 0.4, 0.7, 0.95], 3), 40), np.repeat([0.0, 0.5, 1.0], 200)
    photons = 0.4 * paint * (3.0 / far) ** 2
    # the gate opens right before the target: the pulse comes when half of the background has
    seen = np.array([histogram(p, most * a, 0.5 * BINS * BIN_M)[0] for p, a in zip(photons, level, strict=True)])
    plain = SHOTS * photons
    std = np.sqrt(plain + 25.0)
    findings = diagnose(columns_of(pa.table({
        "true_range_m": far, "reflectance": paint, "ambient_flux": level, "n_frames": np.full(600, 4),
        "sim_signal_counts": plain, "sim_signal_counts_std": std,
        "signal_counts": seen + 0.5 * std * rng.normal(size=600),
    })))[0].findings  # fmt: skip
    (found,) = findings
    # without a background an analog compression of the same curve is as good
    assert found.effect == "detector.pile_up" or (not most and "detector.pile_up" in found.equivalent_to)
    assert ("ambient_flux" in found.drivers) == (most > 0.0)
    if most:
        blocked = next(p for p in found.parameters if p.name == "blocked")
        assert blocked.value == pytest.approx(0.5 * most, rel=0.1)
