"""A laser spot that a warm lens images elsewhere: the range of a triangulating sensor follows its temperature."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [
    library()[name] for name in ("optics.focal_drift", "timing.temperature_offset", "timing.clock_scale",
                                 "timing.tdc_nonlinearity", "air.multipath")
]  # fmt: skip
BASE_M, FOCAL_M, PIXEL_M, FOCUSED_C = 0.05, 0.012, 5.5e-6, 20.0


def range_m(metres, warm_c):
    """Range that a sensor states whose singlet of glass and whose barrel both change with the temperature."""
    bent = (1.51 - 1.0) / (1.51 + 1.1e-5 * (warm_c - FOCUSED_C) - 1.0)
    focal = FOCAL_M * bent * (1.0 + 8e-6 * (warm_c - FOCUSED_C))
    spot_px = focal * BASE_M / metres / PIXEL_M
    return FOCAL_M * BASE_M / (spot_px * PIXEL_M)


def gauge(seed, coldest, *, timed=False):
    """Two sensors before a target at forty ranges, five temperatures; the user adjusts each one's offset."""
    rng = np.random.default_rng(seed)
    dut, step, k = (a.ravel() for a in np.meshgrid(np.arange(2), np.arange(5), np.arange(40), indexing="ij"))
    metres, warm = 0.06 + 0.006 * k, np.linspace(coldest, 47.0, 5)[step] + 0.7 * dut
    real, error = range_m(metres, warm), 3e-5 * (metres / 0.1) ** 2
    offset = (np.bincount(dut, real - metres) / np.bincount(dut))[dut]
    table = {
        "dut": np.array(["A", "B"])[dut], "step": step.astype(float), "housing_temperature_c": warm,
        "n_frames": np.full(k.size, 20.0), "sim_distance_m": metres + offset, "sim_distance_m_std": error,
        "distance_m": real + error / np.sqrt(20.0) * rng.normal(size=k.size),
    }  # fmt: skip
    if timed:
        table["tof_temperature_c"] = warm + 12.0
    return diagnose(columns_of(pa.table(table)), effects=KNOWN)[0].findings


@pytest.mark.parametrize("coldest", [15.0, 31.0])
def test_a_lens_that_warms_is_named_alone_with_the_temperature_of_its_focus(coldest):
    (found,) = gauge(1, coldest)
    assert found.effect == "optics.focal_drift"
    drift, nominal = (p.value for p in found.parameters)
    assert drift == pytest.approx(8e-6 - 1.1e-5 / 0.51, rel=0.1)
    assert nominal == pytest.approx(FOCUSED_C, abs=3.0)


def test_a_scale_that_warms_may_be_a_clock_s_as_well():
    assert "timing.temperature_offset" in gauge(1, 15.0)[0].equivalent_to
    assert "optics.focal_drift" not in {f.effect for f in gauge(1, 15.0, timed=True)}
