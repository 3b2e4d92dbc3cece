"""A converter's uneven cells whose line a calibration has taken away: no clock is named that runs as it should."""

import numpy as np
import pyarrow as pa
import pytest
from foretold import share_told

from arl_fixtures.reconcile.command import reconcile
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

CELLS, PERIOD_M = 64, 0.93
STRETCH = 8e-3


def read_by_cells(range_m, depth):
    """Ranges that a tapped line reads whose cells are not alike: each counts as the mean one; (n,)."""
    widths = 1.0 + depth * np.cos(2.0 * np.pi * (np.arange(CELLS) + 0.5) / CELLS + 0.4)
    edges = np.concatenate([[0.0], np.cumsum(widths)]) * PERIOD_M / widths.sum()
    turns, within = np.divmod(range_m, PERIOD_M)
    return turns * PERIOD_M + np.interp(within, edges, np.arange(CELLS + 1) * PERIOD_M / CELLS)


def boards(seed, steps, *, calibrated, depth=0.025, stretch=0.0):
    """Steps in which boards at 40 places between 1 and 2.6 m are ranged; the truth beside the table."""
    rng = np.random.default_rng(seed)
    places = np.random.default_rng(7).uniform(1.0, 2.6, 40)
    step, place = (a.ravel() for a in np.meshgrid(steps, np.arange(40), indexing="ij"))
    read = read_by_cells(places, depth) * (1.0 + stretch)
    if calibrated:
        read = read - np.polyval(np.polyfit(places, read - places, 1), places)
    nominal, truth = places[place], read[place]
    table = {
        "step": step, "n_frames": np.ones(len(step), dtype=int), "sim_distance_m": nominal,
        "sim_distance_m_std": np.full(len(step), 0.002), "sim_distance_m_repeat_std": np.full(len(step), 3e-4),
        "distance_m": truth + 3e-4 * rng.normal(size=steps.max() + 1)[step] + 0.002 * rng.normal(size=len(step)),
    }  # fmt: skip
    return table, nominal, truth


@pytest.mark.parametrize(("seed", "depth"), [(1, 0.025), (2, 0.025), (1, 0.06)])
def test_cells_are_named_alone_behind_a_fitted_line(tmp_path, save, foretell, seed, depth):
    table, _, _ = boards(seed, np.arange(12), calibrated=True, depth=depth)
    diagnosis = reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["timing.tdc_nonlinearity"]
    (found,) = diagnosis.findings
    assert max(found.held_out.after, diagnosis.fit["distance_m"].after) < 1.3 < found.held_out.before
    unseen, nominal, truth = boards(seed + 10, np.arange(12, 16), calibrated=True, depth=depth)
    assert share_told(truth - nominal, truth - foretell(unseen, "distance_m")) > 0.97


def test_a_clock_that_runs_fast_is_named_beside_the_cells(tmp_path, save):
    table, _, _ = boards(3, np.arange(12), calibrated=False, stretch=STRETCH)
    diagnosis = reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out")
    assert {f.effect for f in diagnosis.findings} == {"timing.tdc_nonlinearity", "timing.clock_scale"}


def test_nothing_is_stretched_where_nothing_differs(tmp_path, save):
    table, _, _ = boards(4, np.arange(12), calibrated=True, depth=0.0)
    assert reconcile(save(tmp_path / "table.parquet", table), tmp_path / "out").verdict == "consistent"


def glazed(seed, steps):
    """The same behind a line, of which boards stand behind a pane that delays light by 3 mm where it is hung."""
    table, nominal, _ = boards(seed, steps, calibrated=True, depth=0.0)
    bearing = np.degrees(np.arccos(np.cos(7.0 * nominal)))
    delay = 0.003 * np.sqrt(np.clip(1.0 - ((bearing - 80.0) / 45.0) ** 2, 0.0, None))
    delay = delay - np.polyval(np.polyfit(nominal, delay, 1), nominal)
    table["distance_m"] += delay
    return table | {"azimuth_deg": bearing}, nominal, nominal + delay


def test_beside_a_law_without_a_name_no_scale_is_foretold():
    table, _, _ = glazed(5, np.arange(12))
    diagnosis, model, decision = diagnose(columns_of(pa.table(table)))
    assert [f.effect for f in diagnosis.findings] == ["unknown"]
    assert not model.lines
    assert not decision.search.scaled
