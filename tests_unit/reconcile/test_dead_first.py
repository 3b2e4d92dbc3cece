"""Pixels that die on the way are found as such, and nothing else is made of what they no longer see."""

import numpy as np

from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import load_table


def test_pixels_that_die_in_the_test_are_the_only_finding(tmp_path, make_table, save):
    def dying(columns, _rng):
        pixels = np.unique(columns["pixel_u"] * 100.0 + columns["pixel_v"])
        gone = np.isin(columns["pixel_u"] * 100.0 + columns["pixel_v"], pixels[[3]])
        dead = gone & (columns["cycle"] >= 3)
        columns["intensity_counts"] = np.where(dead, 0.0, columns["intensity_counts"])

    table = make_table(81, None, steps=16)
    cycle = 1.0 + np.floor(table["step"] / 4.0)
    table["cycle"], table["step"] = cycle, np.mod(table["step"], 4.0)
    dying(table, None)
    diagnosis, _, _ = diagnose(load_table(save(tmp_path / "table.parquet", table)))
    (found,) = diagnosis.findings
    assert found.effect == "detector.dead_pixels"
    assert found.statement.startswith("2 of 26 pixels")  # one of each device
