"""A handful of pixels that look at a bright target once each, of odd rows one: it says most, the others the same."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

PLACES = [(27, 18), (35, 2), (36, 0), (61, 18), (85, 17), (90, 31), (117, 11)]
BRIGHT = {(0, 2): 1940.0, (1, 2): 2640.0, (2, 2): 2350.0, (3, 1): 1390.0, (6, 0): 2670.0}
READ_NOISE, ELECTRONS, SCATTER = 6.0, 4.0, 0.0045


def handful(seed, converters):
    """Seven pixels of three devices at three angles of a stage, fifty steps; `converters` read the rows in turn."""
    rng = np.random.default_rng(seed)
    shape = (np.arange(3), np.arange(50), np.arange(3), np.arange(7))
    dut, step, stop, pixel = (a.ravel() for a in np.meshgrid(*shape, indexing="ij"))
    u, v = np.array(PLACES, float).T[:, pixel]
    scene = np.array([[BRIGHT.get((k, s), 80.0 + 20.0 * ((2 * k + 3 * s) % 7)) for s in range(3)] for k in range(7)])
    light = scene[pixel, stop]
    laser = 1.0 + SCATTER * rng.normal(size=(3, 50))[dut, step]
    counted = rng.poisson(np.repeat((ELECTRONS * light * laser)[:, None], 5, axis=1))
    signal = (counted / ELECTRONS + READ_NOISE * rng.normal(size=counted.shape)).mean(axis=1)
    return columns_of(pa.table({
        "dut": np.array(["A", "B", "C"])[dut], "step": step.astype(float), "set_temperature_c": 15.0 * (step % 6),
        "stage_angle_deg": 36.0 * stop, "pixel_u": u, "pixel_v": v, "n_frames": np.full(step.size, 5.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": np.sqrt(READ_NOISE**2 + light / ELECTRONS),
        "sim_intensity_counts_repeat_std": SCATTER * light,
        "intensity_counts": signal * np.asarray(converters)[v.astype(int) % len(converters)],
    }))  # fmt: skip


def test_rows_read_by_two_converters_are_told_from_uneven_pixels():
    (found,) = diagnose(handful(5, [1.012, 0.988]))[0].findings
    assert found.effect == "readout.column_pattern"
    assert "rows" in found.statement


def test_one_converter_is_silent():
    assert diagnose(handful(6, [1.0]))[0].findings == []
