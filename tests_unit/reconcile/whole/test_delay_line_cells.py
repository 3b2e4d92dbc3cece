"""A delay line whose cells are of random length is a converter's error all the same, though no single wave."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.rivals import plain_beyond, plain_change
from arl_fixtures.reconcile.search import Search
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

PERIOD_M = 0.42


def rail(seed, spread):
    """A target at 120 distances and three temperatures; sixteen cells in a period, told by counting their edges."""
    rng = np.random.default_rng(seed)
    metres, step = (a.ravel() for a in np.meshgrid(np.linspace(0.4, 3.4, 120), np.arange(3), indexing="ij"))
    cells = np.maximum(1.0 + spread * rng.normal(size=16), 0.1)
    edges = np.concatenate([[0.0], np.cumsum(cells)]) * PERIOD_M / cells.sum()
    read = np.floor(metres / PERIOD_M) * PERIOD_M + np.interp(
        metres % PERIOD_M, edges, np.linspace(0.0, PERIOD_M, 17)
    )
    return {
        "step": step.astype(float), "set_temperature_c": 25.0 + 20.0 * step, "true_range_m": metres,
        "sim_distance_m": metres, "sim_distance_m_std": np.full(metres.size, 0.003),
        "n_frames": np.full(metres.size, 20.0), "sim_distance_m_repeat_std": np.full(metres.size, 2e-4),
        "distance_m": read + 0.003 / np.sqrt(20.0) * rng.normal(size=metres.size) + 2e-4 * rng.normal(size=3)[step],
    }  # fmt: skip


def test_cells_of_random_length_are_named_with_their_harmonics():
    table = columns_of(pa.table(rail(5, 0.12)))
    found = diagnose(table, effects=[library()["timing.tdc_nonlinearity"]])[0].findings
    assert [f.effect for f in found] == ["timing.tdc_nonlinearity"]
    period = next(p for p in found[0].parameters if p.name == "period")
    assert period.value == pytest.approx(PERIOD_M, rel=0.02)
    assert found[0].held_out.explained > 0.8


def test_no_cell_has_less_than_no_length():
    """However large a fit may try the waves, what is farther is never read as nearer."""
    effect, view = library()["timing.tdc_nonlinearity"], View(columns_of(pa.table(rail(2, 0.12))))
    variant = next(v for v in effect.variants(view) if "harmonics" in v.options)
    values = {p.name: 0.2 for p in variant.parameters} | {"period": PERIOD_M}
    state = view.fresh_state()
    effect.apply(variant, values, state, view)
    order = np.argsort(view.sim["distance_m"], kind="stable")
    assert np.all(np.diff(state["distance_m"][order]) > -1e-12)
    assert np.ptp(state["distance_m"] - view.sim["distance_m"]) > 0.02


def test_a_relay_that_adds_its_delay_beyond_a_distance_is_no_delay_line():
    """A jump at 4.5 m, which waves of half the range and a scale draw as well: they never come again."""
    table = rail(3, 0.0)
    metres = table["true_range_m"] * 7.4 / 3.4
    table["distance_m"] = table["distance_m"] - table["true_range_m"] + metres + 0.004 * (metres > 4.5)
    table["true_range_m"] = table["sim_distance_m"] = metres
    known = [library()[name] for name in ("timing.tdc_nonlinearity", "timing.clock_scale")]
    found = diagnose(columns_of(pa.table(table)), effects=known)[0].findings
    assert [(f.effect, f.drivers) for f in found] == [("unknown", ["true_range_m"])]


@pytest.mark.parametrize(("targets", "waves"), [(10, []), (16, [1]), (40, [1, 3])])
def test_few_targets_tell_no_waves_of_many_numbers(targets, waves):
    columns = rail(1, 0.0)
    metres = columns["true_range_m"]
    kept = np.isin(metres, np.unique(metres)[np.linspace(0, 119, targets).astype(int)])
    view = View(columns_of(pa.table({name: x[kept] for name, x in columns.items()})))
    offered = library()["timing.tdc_nonlinearity"].variants(view)
    assert [v.options.get("harmonics", 1) for v in offered] == waves


def test_boards_and_a_wall_behind_them_show_a_shape_once():
    """The supply sags with the pixels that fire at once: those that see a board at one range, hardly any between."""
    rng = np.random.default_rng(6)
    boards, between, wall = (rng.random(count) for count in (520, 24, 480))
    far = np.concatenate([1.104 + 0.05 * boards**2, 1.16 + 0.15 * between, 1.90 + 0.05 * wall])
    counts, edges = np.histogram(far, bins=np.arange(1.05, 2.05, 0.15))  # a bin of its timer
    metres, step = np.tile(far, 3), np.repeat(np.arange(3), far.size)
    load = counts[np.searchsorted(edges, metres) - 1] / counts.max()
    noise = 0.003 / np.sqrt(20.0) * rng.normal(size=metres.size)
    table = columns_of(pa.table({
        "step": step.astype(float), "set_temperature_c": 25.0 + 20.0 * step, "true_range_m": metres,
        "sim_distance_m": metres, "sim_distance_m_std": np.full(metres.size, 0.003),
        "n_frames": np.full(metres.size, 20.0), "sim_distance_m_repeat_std": np.full(metres.size, 2e-4),
        "distance_m": metres + 5e-3 * (load - load.mean()) + noise,
    }))  # fmt: skip
    found = diagnose(table, effects=[library()["timing.tdc_nonlinearity"]])[0].findings
    assert [f.effect for f in found] == ["unknown"]


def test_a_slow_clock_is_told_where_its_period_is_swept_several_times():
    """15 MHz: ten metres of range to a period, of which targets on a rail of 45 m pass four; cells by counting."""
    table = rail(4, 0.0)
    metres = table["true_range_m"] * 45.0 / 3.4
    edges = np.concatenate([[0.0], np.cumsum(1.0 + 0.02 * np.sin(2.0 * np.pi * (np.arange(64) + 0.5) / 64))])
    cells = np.interp(metres % 10.0, edges * 10.0 / edges[-1], np.linspace(0.0, 10.0, 65))
    table["distance_m"] = table["distance_m"] - table["true_range_m"] + np.floor(metres / 10.0) * 10.0 + cells
    table["true_range_m"] = table["sim_distance_m"] = metres
    known = [library()[name] for name in ("timing.tdc_nonlinearity", "timing.clock_scale")]
    (found,) = diagnose(columns_of(pa.table(table)), effects=known)[0].findings
    assert found.effect == "timing.tdc_nonlinearity"
    assert {p.name: p.value for p in found.parameters}["period"] == pytest.approx(10.0, rel=0.02)


def test_what_a_law_says_of_ranges_makes_no_name_of_the_light_ambiguous():
    """Waves mend a jump in the ranges by more than any law of the light gains: they are no rival of it."""
    table = rail(3, 0.0)
    metres, light = table["true_range_m"] * 7.4 / 3.4, np.full(table["step"].size, 900.0)
    noise = np.random.default_rng(9).normal(size=light.size)
    table["distance_m"] = table["distance_m"] - table["true_range_m"] + metres + 0.004 * (metres > 4.5)
    table["true_range_m"] = table["sim_distance_m"] = metres
    table |= {
        "sim_intensity_counts": light, "sim_intensity_counts_std": 0.02 * light,
        "sim_intensity_counts_repeat_std": 1e-4 * light,
        "intensity_counts": light * (1.0 - 4e-4 * table["set_temperature_c"]) + 0.02 / np.sqrt(20.0) * light * noise,
    }  # fmt: skip
    known = [library()[name] for name in ("timing.tdc_nonlinearity", "detector.gain_temperature")]
    found = {f.effect: f for f in diagnose(columns_of(pa.table(table)), effects=known)[0].findings}
    assert set(found) == {"unknown", "detector.gain_temperature"}
    assert found["detector.gain_temperature"].equivalent_to == []


def test_a_change_is_weighed_beside_the_constants_that_are_free():
    table = columns_of(pa.table(rail(2, 0.12)))
    (d,) = Search(table, []).full.data
    slope = 1e-3 * table.numbers["true_range_m"]
    assert plain_change(d, slope) > 0.0
    assert plain_change(d, slope + 0.5) == pytest.approx(plain_change(d, slope), rel=1e-6)
    # what a law says as well cannot have been hidden from it
    assert plain_beyond(d, slope, 0.9 * slope) == pytest.approx(0.19 * plain_change(d, slope), rel=1e-6)
    assert plain_beyond(d, slope, 1.1 * slope) == 0.0


def test_a_fast_clock_is_told_on_a_long_rail_by_marks_where_the_carriage_stops_anywhere_near():
    """860 MHz on nine metres: 13 marks a metre apart, each set to within 20 mm; cells by counting their edges."""
    table, rng = rail(6, 0.0), np.random.default_rng(7)
    mark = rng.integers(0, 13, table["step"].size)
    metres = 2.4 + np.array([0.0, 0.2, 1.1, 3.2, 3.9, 4.1, 4.5, 4.6, 6.0, 6.2, 8.3, 8.6, 9.2])[mark]
    metres = metres + 0.02 * rng.normal(size=mark.size)
    edges = np.concatenate([[0.0], np.cumsum(1.0 + 0.06 * np.sin(2.0 * np.pi * (np.arange(64) + 0.5) / 64))])
    cells = np.interp(metres % 0.174, edges * 0.174 / edges[-1], np.linspace(0.0, 0.174, 65))
    table["distance_m"] = table["distance_m"] - table["true_range_m"] + np.floor(metres / 0.174) * 0.174 + cells
    table |= {"true_range_m": metres, "sim_distance_m": metres, "rail_mark": mark.astype(float)}
    known = [library()[name] for name in ("timing.tdc_nonlinearity", "timing.clock_scale", "stage.periodic_error")]
    (found,) = diagnose(columns_of(pa.table(table)), effects=known)[0].findings
    assert found.effect == "timing.tdc_nonlinearity"
    assert {p.name: p.value for p in found.parameters}["period"] == pytest.approx(0.174, rel=0.01)
