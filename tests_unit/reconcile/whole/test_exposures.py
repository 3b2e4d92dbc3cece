"""A dark current fills a pixel for as long as it is exposed."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

BOLTZMANN_EV_K = 8.617e-5


def radiometer(rng, *, rate=0.0, gap_ev=0.68):
    """Eight pixels at several exposures and temperatures; carriers that heat sets free add to the light's."""
    steps = np.repeat(np.arange(48), 5 * 8)
    exposure = np.tile(np.repeat([1.0, 2.0, 5.0, 10.0, 20.0], 8), 48)
    detector = np.repeat(rng.uniform(-5.0, 50.0, 48), 40) + 0.05 * rng.normal(size=steps.size)
    radiance = np.repeat(np.exp(rng.uniform(np.log(0.5), np.log(30.0), 48 * 5)), 8)
    light = 20.0 * radiance * exposure
    per_kelvin = gap_ev / BOLTZMANN_EV_K
    dark = rate * exposure * np.exp(per_kelvin * (1.0 / 323.15 - 1.0 / (detector + 273.15)))
    std = np.sqrt(100.0 + 0.5 * light)
    return {
        "step": steps, "pixel_u": np.tile(np.arange(8), 240), "exposure_ms": exposure, "radiance_wm2": radiance,
        "detector_c": detector, "supply_v": 12.0 + 0.05 * rng.normal(size=steps.size),
        "n_frames": np.full(steps.size, 6), "sim_signal_counts": light, "sim_signal_counts_std": std,
        "signal_counts": light + dark + std / np.sqrt(6.0) * rng.normal(size=steps.size),
    }  # fmt: skip


def test_a_dark_signal_grows_with_the_exposure():
    columns = radiometer(np.random.default_rng(11), rate=0.6)
    findings = diagnose(columns_of(pa.table(columns)))[0].findings
    assert [f.effect for f in findings] == ["detector.dark_offset"]
    assert "exposure_ms" in findings[0].drivers
    dark = next(p for p in findings[0].parameters if p.name == "dark")
    assert dark.low < 0.6 * 20.0 < dark.high


def test_without_a_dark_current_no_exposure_is_named():
    assert diagnose(columns_of(pa.table(radiometer(np.random.default_rng(13)))))[0].findings == []
