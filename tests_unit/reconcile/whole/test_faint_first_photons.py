"""Faint dead time pulls a range by little more than its error: the name needs no shape of a tail to be told by it."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[name] for name in ("detector.pile_up", "detector.compression", "timing.range_walk",
         "target.reflectance_error")]  # fmt: skip
TOP, SIGMA_M = 4000.0, 0.35
LOAD = 0.02


def fired(photons):
    """Share of pulses that fire a counter, and where its first photon stands from the pulse's middle, metres."""
    across = np.linspace(-5.0, 5.0, 801)
    pulse = np.exp(-0.5 * across**2)
    rate = np.multiply.outer(photons, pulse / pulse.sum())
    alive = np.exp(-(np.cumsum(rate, axis=1) - 0.5 * rate))
    first = rate * alive
    return first.sum(axis=1), SIGMA_M * (first @ across) / first.sum(axis=1)


def full(electrons):
    """Share of charge that a storage node of a finite depth holds: its junction takes less the fuller it is."""
    held, step = np.zeros_like(electrons), electrons / 400.0
    for _ in range(400):
        held += step * np.sqrt(1.0 - np.minimum(held, 1.0))
    return held


def counters(seed, load, photons=True):
    """Twelve by eight counters (or storage nodes) before a board of six greys, at eight steps and four angles."""
    rng = np.random.default_rng(seed)
    step, stop, u, v = (x.ravel() for x in np.meshgrid(np.arange(8), np.arange(4), np.arange(12), np.arange(8),
                        indexing="ij"))  # fmt: skip
    paint = np.array([0.04, 0.1, 0.22, 0.4, 0.65, 0.9])[(u // 2 + 2 * (v // 3) + stop) % 6]
    far = 1.6 + 0.5 * stop
    light = 0.95 * TOP * paint / 0.9 * (1.6 / far) ** 2
    strain = load * light / TOP
    kept, early = fired(strain) if photons else (full(2.0 * strain), 0.0)
    kept = kept / (strain if photons else 2.0 * strain)
    noise = np.sqrt(100.0 + 4.0 * light)
    spread = 0.004 + 0.1 / np.sqrt(light)
    return columns_of(pa.table({
        "step": step.astype(float), "set_temperature_c": 5.0 + 5.0 * step, "stage_angle_deg": 15.0 * stop,
        "pixel_u": u, "pixel_v": v, "n_frames": np.full(step.size, 10.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": noise,
        "intensity_counts": light * kept + noise / np.sqrt(10.0) * rng.normal(size=step.size),
        "sim_distance_m": far, "sim_distance_m_std": spread,
        "distance_m": far + early + spread / np.sqrt(10.0) * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_faint_pull_beside_lost_counts_is_dead_time(seed):
    (found,) = diagnose(counters(seed, LOAD), effects=KNOWN)[0].findings
    assert found.effect == "detector.pile_up"


@pytest.mark.parametrize("seed", [1, 2])
def test_lost_charge_beside_an_unmoved_range_is_no_dead_time(seed):
    (found,) = diagnose(counters(seed, LOAD, photons=False), effects=KNOWN)[0].findings
    assert found.effect == "detector.compression"
