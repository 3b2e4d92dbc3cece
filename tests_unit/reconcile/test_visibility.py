"""What a table could not have shown: by its columns, by its noise, by the calibration."""

import re

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effect import Effect
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.visibility import NO_COLUMNS, NO_TRACE, invisible_effects

WATCHED = ("timing.clock_scale", "timing.temperature_offset", "detector.crosstalk", "electronics.rail_coupling")


def ask(columns, *effects):
    table = pa.table({n: pa.array(v.tolist() if v.dtype.kind == "U" else v) for n, v in columns.items()})
    _, _, decision = diagnose(columns_of(table), effects=[library()[e] for e in effects])
    return invisible_effects(decision)


def noisier(columns, factor):
    """The same table with `factor` times the noise in distance, stated so."""
    rng = np.random.default_rng(9)
    std = columns["sim_distance_m_std"] * factor
    return {
        **columns,
        "sim_distance_m_std": std,
        "sim_distance_m_repeat_std": columns["sim_distance_m_repeat_std"] * factor,
        "distance_m": columns["sim_distance_m"] + std / np.sqrt(columns["n_frames"]) * rng.normal(size=len(std)),
    }


def test_effects_without_their_columns_or_neighbours_could_not_be_seen(make_table):
    reasons = ask(make_table(1), *WATCHED)
    assert reasons["electronics.rail_coupling"] == NO_COLUMNS
    assert reasons["detector.crosstalk"] == NO_TRACE  # no two of the table's pixels are neighbours
    assert "timing.temperature_offset" not in reasons


def test_the_smallest_visible_size_grows_with_the_noise(make_table):
    sizes = []
    for factor in (20.0, 40.0):
        reasons = ask(noisier(make_table(1, steps=8), factor), "timing.temperature_offset")
        reason = reasons["timing.temperature_offset"]
        assert "would show only beyond" in reason
        sizes.append(float(re.search(r"beyond ([\d.e+-]+)", reason).group(1)))
    assert sizes[1] / sizes[0] == pytest.approx(2.0, rel=0.2)


class Broken(Effect):
    """A plug-in that cannot stand this table."""

    id, source = "detector.broken", "nobody"

    def variants(self, view):
        raise IndexError("tuple index out of range")

    def apply(self, variant, values, state, view):
        raise AssertionError

    def expression(self, variant):
        raise AssertionError

    def sentence(self, variant, values, view):
        raise AssertionError


@pytest.fixture(scope="module")
def walked(make_table, walk):
    """Diagnosis and decision of a table with a range walk, by that effect and a broken one."""
    table = make_table(2, walk, steps=8)
    columns = columns_of(pa.table({n: pa.array(v.tolist() if v.dtype.kind == "U" else v) for n, v in table.items()}))
    diagnosis, _, decision = diagnose(columns, effects=[Broken(), library()["timing.range_walk"]])
    return diagnosis, decision


def test_an_effect_that_fails_is_noted_and_costs_nothing_else(walked):
    diagnosis, decision = walked
    assert [f.effect for f in diagnosis.findings][:1] == ["timing.range_walk"]
    assert diagnosis.notes["detector.broken"] == "was not tried: IndexError tuple index out of range"
    assert "detector.broken" not in invisible_effects(decision)


def test_an_effect_that_was_found_is_not_called_invisible(walked):
    diagnosis, decision = walked
    assert "timing.range_walk" in [f.effect for f in diagnosis.findings]
    assert "timing.range_walk" not in invisible_effects(decision)
