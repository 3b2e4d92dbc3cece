"""What the tool says of measurements by others. They lie beside the repository, not in it."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import load_table

REAL = Path(__file__).parents[4] / "shared" / "real"


@pytest.mark.parametrize(
    ("name", "effect"), [("tmf8820", "detector.pile_up"), ("edge_laser", "laser.thermal_rolloff")]
)
def test_the_missing_physics_of_a_real_sensor_is_named_first(name, effect):
    path = REAL / name / "observations.parquet"
    if not path.exists():
        pytest.skip("the real measurements lie beside the repository and are absent here")
    diagnosis, _, _ = diagnose(load_table(path))
    assert diagnosis.findings[0].effect == effect


def test_a_drifting_offset_gets_no_name():
    path = REAL / "vl53l0x" / "observations.parquet"
    if not path.exists():
        pytest.skip("the real measurements lie beside the repository and are absent here")
    diagnosis, _, _ = diagnose(load_table(path))
    assert {f.effect for f in diagnosis.findings} <= {"unknown"}


@pytest.mark.parametrize("band", [0, 1, 2])
def test_a_lasers_curve_is_foretold_where_it_was_not_compared(tmp_path, band):
    path = REAL / "edge_laser" / "observations.parquet"
    if not path.exists():
        pytest.skip("the real measurements lie beside the repository and are absent here")
    table = pq.read_table(path)
    held = np.floor(table["drive_current_a"].to_numpy() / 0.1 + 1e-9) % 3 == band
    unseen = table.filter(pa.array(held))
    pq.write_table(table.filter(pa.array(~held)), tmp_path / "seen.parquet")
    pq.write_table(unseen.drop_columns(["photodiode_a"]), tmp_path / "unseen.parquet")
    reconcile(tmp_path / "seen.parquet", tmp_path / "out")
    predict(tmp_path / "out", tmp_path / "unseen.parquet", tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_photodiode_a"].to_numpy()
    off = (said - unseen["photodiode_a"].to_numpy())[np.isfinite(unseen["sim_photodiode_a"].to_numpy())]
    assert np.sqrt(np.nanmean(off**2)) < 2e-3  # amperes; the simulation is off by 50e-3
