"""A lens that grows with the temperature, before a scene that the sweep of three stops samples sparsely.

Samples that lie next to each other are then of different stops, and the sensor, a little before the stage's axis, saw
the scene from another place at each: what they differ by is no slope of the scene.
"""

import numpy as np
import pyarrow.parquet as pq
from foretold import share_told
from upright_boards import COLUMNS, F_PX, ROWS, seen

from arl_fixtures.reconcile.command import predict, reconcile

STOPS_DEG = np.array([-12.3, -0.6, 11.2])
BOARDS = ((-34.0, 9.0, 1.4, 0.7), (-15.0, 5.3, 1.1, 0.3), (-3.0, 2.2, 1.25, 0.15), (6.0, 3.4, 1.3, 0.5),
          (14.5, 2.6, 1.05, 0.25), (27.0, 6.0, 1.0, 0.8))  # fmt: skip
GROWTH, BEFORE_AXIS_M = 4e-5, 0.03


def at_stop(u, v, stop_deg):
    """Light and range of pixels at one of the stops, where parallax has moved the boards."""
    light, far = np.zeros(u.size), np.zeros(u.size)
    for angle in STOPS_DEG:
        here = stop_deg == angle
        boards = []
        for middle, half, distance, white in BOARDS:
            aside = np.degrees(BEFORE_AXIS_M * np.sin(np.radians(angle - middle)) / distance)
            boards.append((middle - aside, half, distance, white))
        light[here], far[here] = seen(u[here], v[here], angle, boards=boards)
    return light, far


def warmed(temperatures_c, seed):
    """A table of steps at some temperatures, and what its channels would be without noise."""
    rng = np.random.default_rng(seed)
    step, stop, v, u = (
        a.ravel()
        for a in np.meshgrid(
            np.arange(len(temperatures_c)), STOPS_DEG, np.arange(ROWS), np.arange(COLUMNS), indexing="ij"
        )
    )
    warm = np.asarray(temperatures_c, dtype=float)[step]
    middle = (COLUMNS - 1) / 2
    light, far = at_stop(u, v, stop)
    now, at = at_stop(middle + (u - middle) / (1.0 + GROWTH * (warm - 25.0)), v, stop)
    light, now = 3000.0 * light, 3000.0 * now
    scatter = np.sqrt(16.0 + 0.1 * light)
    columns = {
        "step": step, "set_temperature_c": warm, "housing_temperature_c": warm + 0.2 * rng.normal(size=len(step)),
        "stage_angle_deg": stop, "pixel_u": u, "pixel_v": v,
        "azimuth_deg": np.degrees(np.arctan((u - middle) / F_PX)),
        "elevation_deg": np.degrees(np.arctan2(((ROWS - 1) / 2 - v) / F_PX, np.hypot(1.0, (u - middle) / F_PX))),
        "sim_intensity_counts": light, "sim_intensity_counts_std": scatter, "n_frames": np.full(len(step), 60),
        "sim_distance_m": far, "sim_distance_m_std": np.full(len(step), 0.006),
        "intensity_counts": now + rng.normal(size=len(step)) * scatter / np.sqrt(60.0),
        "distance_m": at + rng.normal(size=len(step)) * 0.006 / np.sqrt(60.0),
    }  # fmt: skip
    return columns, {"intensity_counts": now, "distance_m": at}


def test_a_lens_that_grows_is_named_and_foretells_other_temperatures(tmp_path, save):
    columns, _ = warmed([-20.0, -6.0, 8.0, 23.0, 37.0, 66.0], 1)
    findings = reconcile(save(tmp_path / "train.parquet", columns), tmp_path / "out").findings
    assert findings[0].effect == "optics.focal_drift"
    table, true = warmed([51.0, 80.0], 2)
    predict(tmp_path / "out", save(tmp_path / "unseen.parquet", table), tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")
    for name, x in true.items():
        left, off = x - said[f"corrected_{name}"].to_numpy(), x - table[f"sim_{name}"]
        assert share_told(off, left) > 0.2, name
