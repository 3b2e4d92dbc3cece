"""Edges that few pixels see do not tell how the stage swings between them: any swing of three numbers hits three."""

import numpy as np
import pyarrow as pa
import pytest
from traced_bench import FIFTEENTHS, table

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

KNOWN = [library()[n] for n in ("target.edge_mixing", "stage.periodic_error", "stage.eccentricity")]
BOARD_M, WALL_M, HALF_DEG = 1.08, 3.17, 0.43


def sweep(seed):
    """A board before a wall: both echoes' centroid in pixels 0.9 degrees wide, at angles 2.7 degrees apart."""
    rng = np.random.default_rng(seed)
    step, angle, u = (a.ravel() for a in np.meshgrid(range(7), np.arange(-18.0, 18.1, 2.7), range(10), indexing="ij"))
    azimuth = 2.58 * (u - 4.5)
    fine = np.linspace(-HALF_DEG, HALF_DEG, 201)[:, None]
    bearing = azimuth + angle + fine
    board = np.abs(bearing + 1.3) < 11.9
    range_m = np.where(board, BOARD_M, WALL_M) / np.cos(np.radians(bearing))
    light = np.where(board, 0.5, 0.06) / range_m**2 * np.exp(-((2.0 * fine / HALF_DEG) ** 2))
    centre, mixed = board[100], board.any(axis=0) & ~board.all(axis=0)
    simulated = np.where(centre, BOARD_M, WALL_M) / np.cos(np.radians(azimuth + angle))
    seen = np.where(mixed, (light * range_m).sum(axis=0) / light.sum(axis=0), simulated)
    # a histogram's bins keep most of the two echoes apart
    seen = simulated + 0.15 * (seen - simulated)
    sigma = np.where(centre, 0.004, 0.03)
    return columns_of(pa.table({
        "step": 1.0 * step, "set_temperature_c": 15.0 * step - 10.0, "stage_angle_deg": angle, "pixel_u": 1.0 * u,
        "azimuth_deg": azimuth, "surface": np.where(centre, "board", "background"), "mixed": mixed,
        "true_range_m": simulated, "n_frames": np.full(u.size, 10.0),
        "distance_m": seen + sigma * rng.normal(size=u.size) / np.sqrt(10.0), "sim_distance_m": simulated,
        "sim_distance_m_std": sigma,
    }))  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_a_swing_of_the_stage_is_not_named_for_the_mixture_of_a_few_edges(seed):
    found = diagnose(sweep(seed), effects=KNOWN)[0].findings
    assert found  # a mismatch it is
    assert not any(f.effect.startswith("stage.") for f in found)


@pytest.mark.parametrize("seed", [2, 6])
def test_one_steep_edge_does_not_hide_what_all_the_others_tell_of_a_tilt(seed):
    tilted = table(seed=seed, places=FIFTEENTHS, tilt_deg=(-0.03, -0.03, 0.25), angles=3, pixels=16)
    (found,) = diagnose(tilted, effects=[*KNOWN, library()["mount.tilt"]])[0].findings
    assert found.effect == "mount.tilt"
