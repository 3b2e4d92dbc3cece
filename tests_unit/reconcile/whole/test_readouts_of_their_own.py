"""Read-outs with names of their own are calibrated one by one."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def filled(light, grows, size=3200.0, steps=400):
    """Voltage of a node whose capacitance grows while it discharges, charge by charge."""
    volts = np.zeros(light.size)
    for _ in range(steps):
        volts = volts + light / steps / (1.0 + grows * (volts / size) ** 2)
    return volts


def line_camera(seed, grows):
    """64 pixels, four lamp levels, seven temperatures; one read-out exposes 0.2 ms, the other 1 ms."""
    rng = np.random.default_rng(seed)
    step, lamp, readout, pixel = (
        x.ravel() for x in np.meshgrid(np.arange(7), np.arange(4), np.arange(2), np.arange(64), indexing="ij")
    )
    exposure = np.array([200.0, 1000.0])[readout]
    plain = 4.0 * np.array([0.1, 0.25, 0.5, 0.8])[lamp] * exposure
    true = filled(plain, grows)
    error = np.sqrt(36.0 + 0.22 * plain)
    measured = true * (1.0 + 0.003 * rng.normal(size=7))[step] + error / 4.0 * rng.normal(size=plain.size)
    sim = plain.copy()
    for k in range(2):
        mine = readout == k
        sim[mine] *= np.sum((measured * plain / error**2)[mine]) / np.sum((plain**2 / error**2)[mine])
    return columns_of(pa.table({
        "step": step.astype(float), "tof_temperature_c": 10.0 * step + 4.0, "pixel_u": pixel.astype(float),
        "lamp_level": np.array([0.1, 0.25, 0.5, 0.8])[lamp], "exposure_us": exposure,
        "readout_id": np.array(["a", "b"])[readout], "n_frames": np.full(step.size, 16.0),
        "sim_signal_counts": sim, "sim_signal_counts_std": error, "sim_signal_counts_repeat_std": 0.003 * sim,
        "signal_counts": measured,
    }))  # fmt: skip


def test_a_capacitance_that_grows_is_compression_whatever_gain_each_readout_has():
    for seed in (1, 2):
        (found,) = diagnose(line_camera(seed, 0.009))[0].findings
        assert "detector.compression" in (found.effect, *found.equivalent_to), seed
