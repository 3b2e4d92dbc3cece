"""An amplifier that gives way, and a threshold that walks: one cause or two, from pulses that are drawn here."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

TIME_NS = np.arange(-15.0, 40.0, 0.02)
METRES_PER_NS = 0.149896229


def pulse(height):
    """A Gaussian with a tail of 3 ns."""
    lead = np.exp(-0.5 * (TIME_NS / 2.0) ** 2)
    kernel = np.exp(-np.arange(0.0, 15.0, 0.02) / 3.0)
    shape = np.convolve(lead, kernel)[: TIME_NS.size]
    return height * shape / shape.max()


def read(height, gives_way, threshold):
    """Peak, and range by centroid or by a threshold on the rising edge, mm against a pulse without either."""
    raw = pulse(height)
    bent = gives_way * -np.expm1(-raw / gives_way)
    if threshold is None:
        middle = np.sum(TIME_NS * bent) / np.sum(bent)
        return bent.max(), 1000.0 * METRES_PER_NS * (middle - np.sum(TIME_NS * raw) / np.sum(raw))
    late = np.interp(threshold, bent[: np.argmax(bent)], TIME_NS[: np.argmax(bent)])
    return bent.max(), 1000.0 * METRES_PER_NS * late


def stripes(gives_way, threshold, part, error_mm=4.0):
    """Targets of many whites at several stage angles: their signals, and a part of their threshold's walk."""
    rng = np.random.default_rng(8)
    axes = np.arange(6.0), np.arange(-8.0, 8.1, 2.0), np.arange(6.0), np.arange(8.0)
    step, stage, v, u = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    target = ((u // 2 + (stage + 8.0) // 2 + 2 * v) % 4).astype(int)
    light = np.array([186.0, 556.0, 1340.0, 2570.0])[target] * (1.0 + 0.004 * (v - 2.5))
    ladder = np.geomspace(60.0, 3000.0, 120)
    peak, range_mm = np.array([read(height, gives_way, threshold) for height in ladder]).T
    mean = np.mean(range_mm) if threshold is None else range_mm[60]
    walk = part * (np.interp(light, ladder, range_mm) - mean)
    sigma, far = np.sqrt(9.0 + 0.2 * light), 1.1 + 0.02 * u + 0.003 * target
    return columns_of(pa.table({
        "dut": np.full(u.size, "A"), "step": step, "stage_angle_deg": stage, "pixel_u": u, "pixel_v": v,
        "target": np.array([f"white_{n}" for n in range(4)])[target], "n_frames": np.full(u.size, 25.0),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": np.interp(light, ladder, peak) + sigma / 5.0 * rng.normal(size=u.size),
        "sim_distance_m": far, "sim_distance_m_std": np.full(u.size, error_mm / 1e3),
        "distance_m": far + 1e-3 * (walk + error_mm / 5.0 * rng.normal(size=u.size)),
    }))  # fmt: skip


@pytest.mark.parametrize(
    ("gives_way", "part", "error_mm"), [(285e3, 0.02, 4.0), (285e3, 0.006, 16.0), (400e3, 0.004, 16.0)]
)
def test_a_threshold_that_walks_beside_an_amplifier_that_gives_way_a_little_is_a_second_name(
    gives_way, part, error_mm
):
    """One law of the signal moves both as well, with a shape that is drawn towards neither."""
    found = diagnose(stripes(gives_way, 12.0, part, error_mm))[0].findings
    assert {f.effect for f in found} == {"detector.compression", "timing.range_walk"}


def test_what_an_amplifier_alone_does_to_signals_and_ranges_is_one_name():
    (found,) = diagnose(stripes(60_000.0, None, 1.0))[0].findings
    assert found.effect in ("detector.compression", "detector.pile_up")
    assert {"intensity_counts", "distance_m"} <= set(found.channels)
