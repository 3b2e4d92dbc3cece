"""Dark counts of a gated array, beside a level that is found anew at every step and that nobody declared."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.reconcile.command import reconcile

CELLS, BAND_GAP_EV, BOLTZMANN_EV = 1000.0, 0.62, 8.617e-5


def counted(seed):
    """Gates of an array whose cells fire by light or heat, at 13 temperatures, before five plates, two devices."""
    rng = np.random.default_rng(seed)
    shape = np.meshgrid(range(2), range(13), range(5), range(4), range(4), indexing="ij")
    dut, step, plate, u, v = (a.ravel() for a in shape)
    held = np.linspace(-20.0, 80.0, 13)
    warm = (held[None, :] + 10.0 + rng.normal(0.0, 0.8, (2, 13)))[dut, step]
    far, grey = np.array([0.4, 0.8, 1.2, 2.0, 3.0])[plate], np.array([0.88, 0.5, 0.18, 0.5, 0.88])[plate]
    light = 260.0 * grey / far**2 * np.exp(-((u - 1.5) ** 2 + (v - 1.5) ** 2) / 12.0)
    kelvin = warm + 273.15
    heat = kelvin**2 * np.exp(-BAND_GAP_EV / (BOLTZMANN_EV * kelvin))
    fired = 1.0 - np.exp(-(light + 10.0 * heat / heat.max()) / CELLS)
    frames = rng.binomial(int(CELLS), fired, (16, len(light))) + rng.normal(0.0, 0.9, (2, 13))[dut, step]
    own = CELLS * -np.expm1(-light / CELLS)
    return {
        "dut": pa.array([f"D{k}" for k in dut]), "step": step.astype(float), "set_temperature_c": held[step],
        "tof_temperature_c": warm, "pixel_u": u.astype(float), "pixel_v": v.astype(float), "true_range_m": far,
        "reflectance": grey, "n_frames": np.full(len(u), 16.0), "signal_counts": frames.mean(axis=0),
        "sim_signal_counts": own, "sim_signal_counts_std": np.sqrt(own + 3.0),
    }  # fmt: skip


def test_steps_that_differ_by_an_amount_leave_a_dark_signal_its_name(tmp_path):
    for seed in (5, 6):
        pq.write_table(pa.table(counted(seed)), tmp_path / "t.parquet")
        found = reconcile(tmp_path / "t.parquet", tmp_path / "d")
        assert [finding.effect for finding in found.findings] == ["detector.dark_offset"]
