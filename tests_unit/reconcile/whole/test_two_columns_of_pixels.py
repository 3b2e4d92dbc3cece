"""The bench's table with pixels in two columns only: at few angles they see an edge, and then most of it."""

from arl_fixtures.reconcile.command import reconcile
from benchmarks.reconcile_speed import large_table


def test_two_effects_and_no_pattern_are_found_in_two_columns(tmp_path):
    large_table(10_000, tmp_path / "table.parquet")
    diagnosis = reconcile(tmp_path / "table.parquet", tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["laser.power_decay", "timing.temperature_offset"]
