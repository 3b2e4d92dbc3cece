"""A name that acts within images does not fall because steps differ by something else."""

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

LIGHT_M_PER_S = 2.998e8
DISTANCES = {"acquisition", "air", "bench", "electronics", "stage", "thermal", "timing"}
"""Where the effects come from that can shift distances of pixels and of steps."""


def skewed_table(make_table, rng, condition):
    """A start signal that passes a chain of buffers along the columns; `condition` sets each step's offset in m."""

    def change(columns, _rng):
        delay_s = 1.1e-12 * columns["pixel_u"]
        columns["distance_m"] = columns["distance_m"] + LIGHT_M_PER_S / 2.0 * (delay_s - delay_s.mean())
        columns["distance_m"] = columns["distance_m"] + condition(columns, rng)

    table = make_table(61, change, steps=7)
    return columns_of(pa.table({name: x for name, x in table.items() if "intensity_counts" not in name}))


def test_a_skew_of_columns_stands_beside_an_offset_that_follows_the_humidity(make_table):
    """No effect of the library knows the humidity: the skew keeps its name, and the rest is unknown."""

    def humid(columns, rng):
        key = columns["step"].astype(int)
        humidity = rng.uniform(20.0, 90.0, 200)[key]
        columns["relative_humidity"] = humidity
        return 8e-4 * np.sin((humidity - 55.0) / 15.0)

    of_distances = [e for name, e in library().items() if name.partition(".")[0] in DISTANCES]
    findings = diagnose(skewed_table(make_table, np.random.default_rng(62), humid), effects=of_distances)[0].findings
    named = [f.effect for f in findings]
    assert "timing.row_skew" in named
    assert set(named) <= {"timing.row_skew", "unknown"}


def test_a_skew_of_columns_and_a_slope_over_temperature_are_both_named(make_table):
    def warm(columns, _rng):
        return 2.5e-5 * (columns["tof_temperature_c"] - 40.0)

    of_distances = [e for name, e in library().items() if name.partition(".")[0] in DISTANCES]
    findings = diagnose(skewed_table(make_table, np.random.default_rng(63), warm), effects=of_distances)[0].findings
    assert {f.effect for f in findings} == {"timing.row_skew", "timing.temperature_offset"}
