"""A name whose side effect is not there, and another one taken for mending it, both fall."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def seen_share(far_m, apart_m, *, beam_mrad=1.2, field_mrad=1.5):
    """Share of a beam's disc within the field of a receiver that stands beside it and looks at it 2 m away."""
    grid = np.linspace(-beam_mrad, beam_mrad, 61)
    x, y = np.meshgrid(grid, grid)
    lit = x * x + y * y <= beam_mrad**2
    off = 1e3 * apart_m * (1.0 / far_m - 1.0 / 2.0)
    within = (x[lit][:, None] - off) ** 2 + y[lit][:, None] ** 2 <= field_mrad**2
    return within.mean(axis=0)


def beside_each_other(seed):
    """A scanner in a hall: light by the overlap of a beam and a field whose axes stand apart, ranges as simulated."""
    rng = np.random.default_rng(seed)
    step, ray = (a.ravel() for a in np.meshgrid(np.arange(8), np.arange(110), indexing="ij"))
    azimuth = -110.0 + 2.0 * ray
    far = np.exp(np.interp(azimuth, np.linspace(-110.0, 110.0, 12), rng.permutation(np.linspace(-0.2, 3.2, 12))))
    grey = np.array([0.1, 0.3, 0.6])[ray // 4 % 3]
    light = 40000.0 * grey / (1.0 + far) ** 2
    sigma, jitter = np.sqrt(25.0 + light), 0.004 + 0.1 / np.sqrt(light)
    seen = light * seen_share(far, 0.001) / seen_share(far, 0.0)
    own = rng.normal(size=(2, 8))
    return columns_of(pa.table({
        "dut": np.full(step.size, "L1"), "step": step, "azimuth_deg": azimuth,
        "true_range_m": far, "reflectance": grey, "n_frames": np.full(step.size, 16),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.003 * light,
        "intensity_counts": seen * (1.0 + 0.003 * own[0][step]) + sigma / 4.0 * rng.normal(size=step.size),
        "sim_distance_m": far, "sim_distance_m_std": jitter, "sim_distance_m_repeat_std": np.full(step.size, 0.001),
        "distance_m": far + 0.001 * own[1][step] + jitter / 4.0 * rng.normal(size=step.size),
    }))  # fmt: skip


def test_light_lost_between_two_axes_is_no_second_path_with_stretched_distances():
    known = [library()[name] for name in ("air.multipath", "timing.clock_scale", "detector.pile_up")]
    found = diagnose(beside_each_other(3), effects=known)[0].findings
    assert [f.effect for f in found] == ["unknown"]
    assert found[0].channels == ["intensity_counts"]


def ladder(seed):
    """A module before greys at 34 distances: its field misses a rim of the beam, more of it the nearer it is."""
    rng = np.random.default_rng(seed)
    step, grey, far = (a.ravel() for a in np.meshgrid(
        np.arange(6), [0.1, 0.5, 0.88], np.geomspace(0.2, 8.0, 34), indexing="ij"))  # fmt: skip
    photons = 30000.0 * grey / (1.0 + far) ** 2
    sigma, jitter = np.sqrt(20.0 + photons), 0.003 + 0.12 / np.sqrt(photons)
    radius = 0.011 + 0.004 * far  # metres; a rim of 0.1 mm is not seen
    seen = photons * (radius / (radius + 0.0001)) ** 2 * (1.0 - 0.0035 / far)
    own = rng.normal(size=(2, 6))
    return columns_of(pa.table({
        "dut": 1 + step // 3, "step": step % 3, "true_range_m": far, "reflectance": grey,
        "tof_temperature_c": 19.0 + 15.0 * (step % 3), "n_frames": np.full(step.size, 24),
        "sim_photon_counts": photons, "sim_photon_counts_std": sigma, "sim_photon_counts_repeat_std": 0.006 * photons,
        "photon_counts": seen * (1.0 + 0.006 * own[0][step]) + sigma / np.sqrt(24.0) * rng.normal(size=step.size),
        "sim_distance_m": far, "sim_distance_m_std": jitter, "sim_distance_m_repeat_std": np.full(step.size, 0.0008),
        "distance_m": far + 0.0008 * own[1][step] + jitter / np.sqrt(24.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_light_lost_close_by_is_no_second_path_whose_way_no_range_shows():
    found = [diagnose(ladder(seed), effects=[library()["air.multipath"]])[0].findings for seed in (1, 2)]
    assert [[f.effect for f in one] for one in found] == [["unknown"], ["unknown"]]
