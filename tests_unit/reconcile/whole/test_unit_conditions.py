"""Many units that differ by what each has once: their own constants are free, and all that tells of it."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def batch(seed, bend_mm, units=24):
    """Rangefinders before targets at twelve distances, each screwed on by its own torque; ten frames a stop."""
    rng = np.random.default_rng(seed)
    unit, stop = (a.ravel() for a in np.meshgrid(np.arange(units), np.arange(12), indexing="ij"))
    torque = rng.uniform(0.4, 1.6, units)
    metres = 0.5 + 0.4 * stop
    # a plate on three screws bends with the square root of what the friction leaves of the torque
    offset = bend_mm * (np.sqrt(torque - 0.2) - 0.9) + 0.3 * rng.normal(size=units)
    return columns_of(pa.table({
        "dut": [f"R{k:02d}" for k in unit], "step": stop.astype(float), "true_range_m": metres,
        "screw_torque_nm": torque[unit] + 0.002 * rng.normal(size=unit.size),
        "humidity_pct": rng.uniform(30.0, 60.0, units)[unit], "n_frames": np.full(unit.size, 10.0),
        "sim_distance_mm": 1000.0 * metres, "sim_distance_mm_std": np.full(unit.size, 2.0),
        "distance_mm": 1000.0 * metres + offset[unit] + 2.0 / np.sqrt(10.0) * rng.normal(size=unit.size),
    }))  # fmt: skip


EFFECTS = [library()[name] for name in ("timing.clock_scale", "timing.tdc_nonlinearity", "bench.repeatability")]


def test_units_that_follow_a_torque_are_a_mismatch_with_a_law():
    (finding,) = diagnose(batch(7, 2.5), effects=EFFECTS)[0].findings
    assert (finding.effect, finding.drivers, finding.channels) == ("unknown", ["screw_torque_nm"], ["distance_mm"])
    assert finding.law is not None
    width = finding.law.terms[0].axes[0].width
    assert finding.law.terms[0].value / width == pytest.approx(2.5 * 0.5 / 0.9, rel=0.25)  # slope of the root


def test_units_that_differ_by_chance_follow_nothing():
    found = [diagnose(batch(seed, 0.0), effects=EFFECTS)[0].findings for seed in range(2, 6)]
    assert [f.effect for findings in found for f in findings if f.drivers] == []


def test_of_many_units_one_is_always_off_and_that_names_no_effect():
    """Their offsets are chance; a scale in the one that is off most explains its offset in part."""
    found = [diagnose(batch(seed, 0.0), effects=EFFECTS[:1])[0].findings for seed in (23, 28, 32, 43)]
    assert [f.effect for findings in found for f in findings] == []
