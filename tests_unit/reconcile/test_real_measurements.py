"""What the tool says of measurements by others. They lie beside the repository, not in it."""

from pathlib import Path

import pytest

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import load_table

REAL = Path(__file__).parents[3] / "shared" / "real"


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
