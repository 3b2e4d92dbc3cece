"""Four samples of a phase, taken one after the other by a sensor that drives past what it measures."""

import numpy as np
import pyarrow.parquet as pq
from foretold import share_told

from arl_fixtures.reconcile.command import predict, reconcile

WAVELENGTH_M, APART_S = 3.0, 0.0006


def ranged(far_m, speed_m_s):
    """Distance of a correlation sensor whose four samples see the target come nearer, by the arctangent of these."""
    a = [np.cos(4.0 * np.pi * (far_m - k * APART_S * speed_m_s) / WAVELENGTH_M - k * np.pi / 2.0) for k in range(4)]
    phase = np.unwrap(np.stack([4.0 * np.pi * far_m / WAVELENGTH_M, np.arctan2(a[1] - a[3], a[0] - a[2])]), axis=0)[1]
    return phase * WAVELENGTH_M / (4.0 * np.pi)


def driven(seed, speeds_m_s):
    """A scanner that sees all around while it drives at a speed that each step holds, nearly."""
    rng = np.random.default_rng(seed)
    n = 700 * len(speeds_m_s)
    step = np.arange(n) // 700
    azimuth = np.radians(rng.choice(np.arange(-60, 60) * 3.0, n))
    far = 6.0 + 4.0 * np.sin(3.0 * azimuth) + rng.uniform(0.0, 3.0, n)
    speed = np.asarray(speeds_m_s)[step] + rng.uniform(-0.5, 0.5, n)
    true = ranged(far, speed * np.cos(azimuth))
    return {
        "step": step, "azimuth_deg": np.degrees(azimuth), "vehicle_speed_m_s": speed.round(2),
        "rail_3v3_v": 3.3 + 0.003 * rng.normal(size=n), "true_range_m": far, "sim_distance_m": far,
        "sim_distance_m_std": np.full(n, 0.02), "n_frames": np.full(n, 8),
        "distance_m": true + 0.0005 * rng.normal(size=12)[step] + rng.normal(size=n) * 0.02 / np.sqrt(8.0),
    }, true - far  # fmt: skip


def test_the_product_of_speed_and_bearing_is_nil_where_nothing_moves(tmp_path, save):
    fast = [4.8, 14.6, 0.6, 9.4, 12.3, 11.1, 8.4, 9.9, 7.0, 13.2]
    (found,) = reconcile(save(tmp_path / "train.parquet", driven(1, fast)[0]), tmp_path / "out").findings
    assert found.effect == "unknown"
    assert set(found.drivers[:2]) == {"vehicle_speed_m_s", "azimuth_deg"}
    table, off = driven(2, [1.6, -0.6])
    predict(tmp_path / "out", save(tmp_path / "unseen.parquet", table), tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_distance_m"].to_numpy() - table["sim_distance_m"]
    off = off - off.mean()  # of the two an offset is calibration
    left = off - (said - said.mean())
    assert share_told(off, left) > 0.5
