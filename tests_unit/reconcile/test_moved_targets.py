"""Targets on a carriage that no column tells of: a turned camera sees each at the distance at which it then stood."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

ACROSS, DOWN, STAGES, DISTANCES = 40, 14, (-6.0, 0.0, 6.0), (1.5, 2.1, 3.0, 4.2, 6.0)
WALL_M, HALF_DEG = 9.0, 15.0
PITCH_DEG = 0.12


def ahead(azimuth, elevation, stage, pitch):
    """How far rays lead along the stage's zero for one unit of range: pitched in their sensor, then turned; (n,)."""
    az, el, turn, tip = (np.radians(x) for x in (azimuth, elevation, stage, pitch))
    forward, left, up = np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)
    return (forward * np.cos(tip) - up * np.sin(tip)) * np.cos(turn) - left * np.sin(turn)


def carriage(pitch, seed=3, rows=6000):
    """A board before a wall, both facing the stage's zero; the board stands at one of five distances at a time."""
    rng = np.random.default_rng(seed)
    u, v, stage = rng.integers(ACROSS, size=rows), rng.integers(DOWN, size=rows), rng.choice(STAGES, size=rows)
    azimuth, elevation = 56.0 * ((u + 0.5) / ACROSS - 0.5), 20.0 * ((v + 0.5) / DOWN - 0.5)
    dut, step = rng.integers(101, 103, size=rows), rng.integers(12, size=rows)
    stood = rng.choice(DISTANCES, size=rows)
    board = np.abs(azimuth + stage) < HALF_DEG
    keep = np.abs(np.abs(azimuth + stage) - HALF_DEG) > 1.0  # who made the table left out what is near an edge

    def seen(tip):
        return np.where(board, stood, WALL_M) / ahead(azimuth, elevation, stage, tip)

    simulated = seen(0.0)
    measured = np.where(dut == 101, seen(pitch), simulated) + rng.normal(0.0, 0.003 / np.sqrt(10.0), rows)
    columns = {
        "dut": dut.astype(str), "step": step.astype(float), "stage_angle_deg": stage, "pixel_u": u, "pixel_v": v,
        "azimuth_deg": azimuth, "elevation_deg": elevation, "surface": np.where(board, "board", "wall"),
        "mixed": np.zeros(rows, dtype=bool), "n_frames": np.full(rows, 10.0), "distance_m": measured,
        "sim_distance_m": simulated, "sim_distance_m_std": np.full(rows, 0.003),
    }  # fmt: skip
    return columns_of(pa.table({name: np.asarray(values)[keep] for name, values in columns.items()}))


def test_a_tilt_is_named_on_targets_that_move_unseen():
    known = [library()[name] for name in ("mount.tilt", "timing.row_skew", "timing.clock_scale")]
    (finding,) = diagnose(carriage(PITCH_DEG), effects=known)[0].findings
    assert finding.effect == "mount.tilt"
    assert finding.where["dut"] == ["101"]
    assert finding.terms[0].values["pitch"] == pytest.approx(PITCH_DEG, abs=0.005)
