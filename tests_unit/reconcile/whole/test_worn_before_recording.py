"""A device that aged before the first cycle that was recorded: the wear it had by then is no second effect."""

import numpy as np
import pyarrow as pa
from scipy.ndimage import gaussian_filter1d

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

RIVALS = [
    library()[name] for name in
    ("beam.profile_change", "beam.profile_shift", "optics.vignetting", "laser.power_decay", "optics.filter_shift")
]  # fmt: skip
CYCLES = np.array([40.0, 60.0, 90.0, 120.0, 150.0, 180.0])


def spread_beam(azimuth_deg, kernel_deg):
    """A far field that scatter centres in the diffuser widen: its top hat convolved with a growing kernel."""
    fine = np.linspace(-60.0, 60.0, 4801)
    hat = 1.0 / (1.0 + np.exp((np.abs(fine) - 24.0) / 1.5))
    return np.interp(azimuth_deg, fine, gaussian_filter1d(hat, kernel_deg / (fine[1] - fine[0])))


def campaign(seed, kernel_at_the_end_deg):
    rng = np.random.default_rng(seed)
    cycle, step, pixel = (x.ravel() for x in np.meshgrid(CYCLES, np.arange(6), np.arange(48), indexing="ij"))
    azimuth = np.linspace(-22.0, 22.0, 48)[pixel]
    light = 1800.0 * spread_beam(azimuth, 0.1)
    kernel = kernel_at_the_end_deg * np.sqrt(CYCLES / CYCLES[-1])  # its square, the wear, grows with the cycles
    worn = np.concatenate([spread_beam(azimuth[cycle == c], k) for c, k in zip(CYCLES, kernel, strict=True)])
    shared = 1.0 + 5e-4 * rng.normal(size=(CYCLES.size, 6))[np.searchsorted(CYCLES, cycle), step]
    sigma = np.sqrt(light + 40.0)
    return columns_of(pa.table({
        "cycle": cycle, "step": step, "time_s": step * 900.0, "pixel_u": pixel.astype(float), "azimuth_deg": azimuth,
        "housing_temperature_c": np.array([0.0, 20.0, 40.0, 60.0, 40.0, 20.0])[step],
        "n_frames": np.full(step.size, 40.0), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 5e-4 * light,
        "intensity_counts": 1800.0 * worn * shared + sigma / np.sqrt(40.0) * rng.normal(size=step.size),
    }))  # fmt: skip


def test_a_beam_that_was_worn_when_the_record_began_has_one_cause():
    (finding,) = diagnose(campaign(1, 2.0), effects=RIVALS)[0].findings
    assert finding.effect == "beam.profile_change"
    assert "cycle" in finding.drivers
