"""A module of single-photon detectors that tells the light behind the echo, too: each detector answers once a pulse.

Histograms are made bin by bin from the photons' rates, the floor is told by the bins before the echo.
"""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

BIN_M, PULSES, WINDOW, STRONGEST, FLOOR = 0.06, 3e4, (-5, 8), 0.05, 4e-4
RIVALS = [
    library()[name]
    for name in (
        "detector.pile_up", "detector.compression", "timing.range_walk", "target.reflectance_error",
        "timing.clock_scale", "readout.noise_excess", "air.multipath", "detector.dark_offset",
    )
]  # fmt: skip


def histograms(far, rate, floor_rate, busy):
    """Counts in 60 bins before targets at `far`; busy: whether a photon is the last that its detector tells."""
    edges = np.arange(61) * BIN_M
    # a pulse that rises within half a bin and decays over one, its mean at the target
    since = edges[None, :] - (far - 1.5 * BIN_M)[:, None]
    passed = np.where(since > 0.0, 1.0 - np.exp(-(np.maximum(since, 0.0) ** 1.5) / (1.7 * BIN_M) ** 1.5), 0.0)
    rates = rate[:, None] * np.diff(passed, axis=1) + floor_rate[:, None]
    if not busy:
        return PULSES * rates
    awake = np.exp(-(np.cumsum(rates, axis=1) - rates))
    return PULSES * awake * -np.expm1(-rates)


def read_out(counts, far):
    """Echo, its centre and the floor of histograms."""
    floor = counts[:, :6].mean(axis=1)
    first = np.floor(far / BIN_M).astype(int)[:, None] + np.arange(*WINDOW)
    inside = np.take_along_axis(counts, first, axis=1)
    echo = (inside - floor[:, None]).sum(axis=1)
    centre = ((inside - floor[:, None]) * (first + 0.5) * BIN_M).sum(axis=1) / echo
    noise = np.sqrt(inside.sum(axis=1) + len(inside[0]) ** 2 * floor / 6.0)
    return echo, centre, floor, noise, 0.5 * BIN_M * len(inside[0]) * noise / echo


def measured(seed, busy):
    """Targets of three greys at twelve ranges under three lamps, in five steps."""
    rng = np.random.default_rng(seed)
    step, place, grey, lamp = (
        part.ravel() for part in np.meshgrid(*(np.arange(n) for n in (5, 12, 3, 3)), indexing="ij")
    )
    far = 0.55 + 0.2 * place
    albedo, bright = np.array([0.08, 0.35, 0.85])[grey], np.array([0.1, 1.0, 4.0])[lamp]
    rate, floor_rate = STRONGEST * (albedo / 0.85) * (0.55 / far) ** 2, FLOOR * albedo * bright + 1e-5
    sim = read_out(histograms(far, rate, floor_rate, busy=False), far)
    told = read_out(histograms(far, rate, floor_rate, busy=busy), far)
    frames = 12.0
    draw = lambda error: error / np.sqrt(frames) * rng.normal(size=far.size)  # noqa: E731
    return columns_of(pa.table({
        "step": step.astype(float), "true_range_m": far, "reflectance": albedo, "lamp_level": bright,
        "housing_temperature_c": 20.0 + 10.0 * step, "n_frames": np.full(far.size, frames),
        "sim_intensity_counts": sim[0], "sim_intensity_counts_std": sim[3],
        "intensity_counts": told[0] + draw(told[3]),
        "sim_range_m": sim[1], "sim_range_m_std": sim[4], "range_m": told[1] + draw(told[4]),
        "sim_ambient_counts": sim[2], "sim_ambient_counts_std": np.sqrt(sim[2] / 6.0) + 0.1,
        "ambient_counts": told[2] + draw(np.sqrt(told[2] / 6.0) + 0.1),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_detectors_that_the_background_has_fired_are_named(seed):
    (found,) = diagnose(measured(seed, busy=True), effects=RIVALS)[0].findings
    assert found.effect == "detector.pile_up"
    assert {"intensity_counts", "range_m"} <= set(found.channels)
    said = {p.name: p for p in found.parameters}
    assert found.held_out.explained > 0.85
    assert said["load"].low < STRONGEST < said["load"].high


def test_detectors_that_are_soon_ready_again_are_not():
    assert diagnose(measured(3, busy=False), effects=RIVALS)[0].verdict == "consistent"
