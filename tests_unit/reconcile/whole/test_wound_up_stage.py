"""A stage whose angle is wrong by something that no name has: every row shows it by how steep the scene is there.

A coupling winds up by speed and grease, a clock runs off between two synchronisations. Rows before edges tell of it,
brighter or darker by which way the stage goes and which side of a board they see.
"""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

STEPS, ANGLES, PIXELS = 14, 31, 12


def bright(bearing_deg):
    """Light of four boards with soft edges, counts."""
    boards = sum(
        share * 0.5 * (1.0 + np.tanh((4.0 - np.abs(bearing_deg - middle)) / 0.9))
        for middle, share in ((-29.0, 0.3), (-13.0, 0.6), (5.0, 1.0), (21.0, 0.5))
    )
    return 130.0 + 2500.0 * boards


def swept(seed, error_deg):
    """Sweeps to and fro at three speeds over seven temperatures; `error_deg` of speed, temperature and time."""
    rng = np.random.default_rng(seed)
    step, stop, pixel = (
        a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(ANGLES), np.arange(PIXELS), indexing="ij")
    )
    speed = (np.array([3.0, 7.0, 12.0])[np.arange(STEPS) % 3] * np.where(np.arange(STEPS) % 2, -1.0, 1.0))[step]
    grease = (-10.0 + 12.0 * (np.arange(STEPS) // 2))[step]
    since = np.mod(1.7 * stop + 11.0 * step, 64.0)
    angle, azimuth = np.linspace(-18.0, 18.0, ANGLES)[stop], np.linspace(-15.0, 15.0, PIXELS)[pixel]
    simulated, true = bright(azimuth + angle), bright(azimuth + angle + error_deg(speed, grease, since))
    sigma = np.sqrt(20.0 + 0.8 * simulated)
    return columns_of(pa.table({
        "step": step.astype(float), "stage_angle_deg": angle, "pixel_u": 8.0 * pixel, "azimuth_deg": azimuth,
        "stage_speed_deg_s": speed, "bearing_temperature_c": np.round(grease + rng.normal(0.0, 0.2, step.size), 2),
        "time_since_sync_s": np.round(since, 2), "time_s": 1800.0 * step + 4.0 * stop,
        "n_frames": np.full(step.size, 8.0), "sim_intensity_counts": simulated, "sim_intensity_counts_std": sigma,
        "intensity_counts": true + sigma / np.sqrt(8.0) * rng.normal(size=step.size),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_coupling_that_winds_up_is_told_by_speed_and_grease(seed):
    def wound(speed, grease, since):
        return 0.004 * speed * np.exp(-grease / 40.0)

    (found,) = diagnose(swept(seed, wound))[0].findings
    assert found.effect == "unknown"
    assert found.drivers[0] == "stage_speed_deg_s"
    assert found.drivers[-1] == "stage_angle_deg"
    assert found.held_out.explained > 0.8
    assert "as if the stage stood elsewhere" in found.statement
    assert {p.unit for p in found.parameters} == {"deg"}


@pytest.mark.parametrize("seed", [1, 2])
def test_a_clock_that_runs_off_is_told_though_no_column_alone_shows_it(seed):
    def late(speed, grease, since):
        return 4e-5 * speed * (since - 32.0)

    (found,) = diagnose(swept(seed, late))[0].findings
    assert found.effect == "unknown"
    assert set(found.drivers) == {"stage_speed_deg_s", "time_since_sync_s", "stage_angle_deg"}


def test_a_stage_that_is_right_is_silent():
    assert diagnose(swept(3, lambda speed, grease, since: 0.0 * speed))[0].verdict == "consistent"


def test_an_angle_that_is_off_by_a_constant_keeps_its_name():
    (found,) = diagnose(swept(4, lambda speed, grease, since: 0.02 + 0.0 * speed))[0].findings
    assert "stage.zero_offset" in (found.effect, *found.equivalent_to)
