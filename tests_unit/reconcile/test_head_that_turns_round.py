"""A scanner's head that turns round: its azimuth is no angle in a lens's field of view."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def scanner(seed, polarised):
    """Four beams round a hall; its mirror, at half a right angle, passes two polarisations unlike."""
    rng = np.random.default_rng(seed)
    step, around, beam = (x.ravel() for x in np.meshgrid(np.arange(10), np.arange(20), np.arange(4), indexing="ij"))
    azimuth, elevation = 18.0 * around, np.array([-8.0, -3.0, 3.0, 8.0])[beam]
    walls = rng.integers(0, 8, 20)[around]
    far = rng.uniform(3.0, 10.0, 20)[around]
    sim = 6e4 * np.linspace(0.15, 0.85, 8)[walls] / far**2
    turned = np.radians(azimuth)  # plane of incidence on the mirror against the laser's plane of polarisation
    s, p = 0.94, 0.94 * (1.0 - polarised)
    passed = s * np.sin(turned) ** 2 + p * np.cos(turned) ** 2
    error = np.sqrt(9.0 + 1.2 * sim + (4e-3 * sim) ** 2)
    return columns_of(pa.table({
        "step": step.astype(float), "azimuth_deg": azimuth, "elevation_deg": elevation, "pixel_v": beam.astype(float),
        "surface": np.array([f"panel {k}" for k in range(8)])[walls], "n_frames": np.full(step.size, 8.0),
        "tof_temperature_c": 9.0 * step - 20.0, "true_range_m": far,
        "sim_intensity_counts": sim, "sim_intensity_counts_std": error,
        "intensity_counts": sim * passed / 0.92 + error / np.sqrt(8.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_what_goes_round_twice_is_no_passband():
    (found,) = diagnose(scanner(5, 0.05))[0].findings
    assert (found.effect, found.drivers[0]) == ("unknown", "azimuth_deg")
