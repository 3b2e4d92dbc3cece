"""A camera that samples a wave with harmonics at four phases: ranges swing with the range, and so does the light."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

LIGHT_M_S, MODULATION_HZ = 299_792_458.0, 9e6
AMBIGUITY_M = LIGHT_M_S / (2.0 * MODULATION_HZ)
BOARDS = {"near": (-14.3, 4.1, 0.1), "second": (-5.4, 7.2, 0.25), "third": (2.2, 9.9, 0.5), "far": (9.6, 12.6, 0.8)}
"""Left edge, degrees; range, metres; reflectance. All are 4.6 degrees wide, before a wall at 15.4 m."""
NAMES = ("wall", *BOARDS)
ACROSS = (np.arange(41) - 20.0) / 41.0


def sampled(bearing_deg, third, fifth):
    """Light, range and what each surface fills of pixels: sums over rays of four samples of the wave that returns."""
    rays = bearing_deg[:, None] + ACROSS[None, :]
    which = np.zeros(rays.shape, dtype=int)
    for number, (left, _, _) in enumerate(BOARDS.values(), start=1):
        which[(rays > left) & (rays < left + 4.6)] = number
    far = np.array([15.4, *(at for _, at, _ in BOARDS.values())])[which]
    paint = np.array([0.6, *(white for *_, white in BOARDS.values())])[which]
    size = 9e4 * paint / far**2 / len(ACROSS)
    phase = 2.0 * np.pi * far / AMBIGUITY_M
    taps = []
    for tap in range(4):
        late = phase - tap * np.pi / 2.0
        wave = np.cos(late) + third * np.cos(3.0 * late + 0.5) + fifth * np.cos(5.0 * late - 0.4)
        taps.append(np.sum(size * wave, axis=1))
    real, imaginary = 0.5 * (taps[0] - taps[2]), 0.5 * (taps[1] - taps[3])
    turn = np.arctan2(imaginary, real) % (2.0 * np.pi)
    fills = np.stack([np.mean(which == one, axis=1) for one in range(len(NAMES))])
    return np.hypot(real, imaginary), turn / (2.0 * np.pi) * AMBIGUITY_M, fills


def test_a_signal_that_swings_with_the_range_is_the_harmonics_and_no_paint():
    rng = np.random.default_rng(5)
    axes = np.arange(6.0), np.arange(-12.0, 12.1, 1.5), np.arange(0.0, 9.0, 4.0), np.arange(20.0, 45.0, 3.0)
    step, stage, v, u = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    bearing = 0.9 * (u - 32.0) + stage
    light, far, fills = sampled(bearing, 0.0, 0.0)
    real, real_far, _ = sampled(bearing, 0.004, -0.0016)
    sigma = np.sqrt(25.0 + 0.3 * light)
    table = {
        "dut": np.full(u.size, "A"), "step": step, "tof_temperature_c": 20.0 + 5.0 * step, "stage_angle_deg": stage,
        "pixel_u": u, "pixel_v": v, "azimuth_deg": 0.9 * (u - 32.0), "n_frames": np.full(u.size, 40.0),
        "surface": np.array(NAMES)[np.argmax(fills, axis=0)], "mixed": fills.max(axis=0) < 1.0,
        "true_range_m": far, "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": real + sigma / np.sqrt(40.0) * rng.normal(size=u.size),
        "sim_distance_m": far, "sim_distance_m_std": np.full(u.size, 0.04),
        "distance_m": real_far + 0.04 / np.sqrt(40.0) * rng.normal(size=u.size),
    }  # fmt: skip
    (found,) = diagnose(columns_of(pa.table(table)))[0].findings
    assert found.effect == "timing.tdc_nonlinearity"
    assert set(found.channels) == {"distance_m", "intensity_counts"}
    values = {p.name: p.value for p in found.parameters}
    assert abs(values["period"] / (AMBIGUITY_M / 4.0) - 1.0) < 0.01
    swing_m = np.hypot(values["sine"], values["cosine"])
    there = AMBIGUITY_M / (2.0 * np.pi) * abs(0.004 * np.exp(0.5j) + 0.0016 * np.exp(0.4j))
    assert abs(swing_m / there - 1.0) < 0.1
