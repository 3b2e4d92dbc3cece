"""Sensors that tell distances only: what a surface returns stands for the signal."""

import pyarrow as pa

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def test_a_threshold_crossing_is_range_walk_also_where_no_signal_was_recorded(make_table, walk):
    table = make_table(6, walk, steps=6, duts=1)
    left = {name: values for name, values in table.items() if "intensity" not in name}
    diagnosis, _, _ = diagnose(columns_of(pa.table(left)))
    assert [f.effect for f in diagnosis.findings] == ["timing.range_walk"]
    assert diagnosis.findings[0].drivers[0] == "reflectance"
    assert diagnosis.findings[0].held_out.explained > 0.7
