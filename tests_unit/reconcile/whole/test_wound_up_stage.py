"""A stage whose angle is wrong by something that no name has: every row shows it by how steep the scene is there.

A coupling winds up by speed and grease, a clock runs off between two synchronisations. Rows before edges tell of it,
brighter or darker by which way the stage goes and which side of a board they see.
"""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from foretold import share_told

from arl_fixtures.errors import DataError
from arl_fixtures.reconcile.command import predict, reconcile
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


def rows_of(seed, error_deg):
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
    return {
        "step": step.astype(float), "stage_angle_deg": angle, "pixel_u": 8.0 * pixel, "azimuth_deg": azimuth,
        "stage_speed_deg_s": speed, "bearing_temperature_c": np.round(grease + rng.normal(0.0, 0.2, step.size), 2),
        "time_since_sync_s": np.round(since, 2), "time_s": 1800.0 * step + 4.0 * stop,
        "n_frames": np.full(step.size, 8.0), "sim_intensity_counts": simulated, "sim_intensity_counts_std": sigma,
        "intensity_counts": true + sigma / np.sqrt(8.0) * rng.normal(size=step.size),
    }  # fmt: skip


def swept(seed, error_deg):
    return columns_of(pa.table(rows_of(seed, error_deg)))


def late(speed, grease, since):
    """The stage's clock runs off until it is set anew."""
    return 4e-5 * speed * (since - 32.0)


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
    (found,) = diagnose(swept(seed, late))[0].findings
    assert found.effect == "unknown"
    assert set(found.drivers) == {"stage_speed_deg_s", "time_since_sync_s", "stage_angle_deg"}


def test_rows_at_one_angle_are_foretold_and_rows_without_any_refused(tmp_path, save):
    reconcile(save(tmp_path / "table.parquet", rows_of(1, late)), tmp_path / "out")
    table = rows_of(5, late)
    angle = table["stage_angle_deg"]
    still = angle == angle[np.argmin(np.abs(angle - 3.0))]
    blind = {n: v[still] for n, v in table.items() if n != "intensity_counts"}
    error = late(blind["stage_speed_deg_s"], None, blind["time_since_sync_s"])
    true = bright(blind["azimuth_deg"] + blind["stage_angle_deg"] + error)
    predict(tmp_path / "out", save(tmp_path / "new.parquet", blind), tmp_path / "p.parquet")
    told = pq.read_table(tmp_path / "p.parquet")["corrected_intensity_counts"].to_numpy()
    off, left = true - blind["sim_intensity_counts"], true - told
    assert share_told(off, left) > 0.7
    del blind["stage_angle_deg"]
    with pytest.raises(DataError, match="lacks column 'stage_angle_deg'"):
        predict(tmp_path / "out", save(tmp_path / "no.parquet", blind), tmp_path / "q.parquet")
    assert not (tmp_path / "q.parquet").exists()


def test_a_stage_that_is_right_is_silent():
    assert diagnose(swept(3, lambda speed, grease, since: 0.0 * speed))[0].verdict == "consistent"


def test_an_angle_that_is_off_by_a_constant_keeps_its_name():
    (found,) = diagnose(swept(4, lambda speed, grease, since: 0.02 + 0.0 * speed))[0].findings
    assert "stage.zero_offset" in (found.effect, *found.equivalent_to)
