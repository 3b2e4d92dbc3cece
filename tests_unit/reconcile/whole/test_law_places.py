"""Laws say where they hold: in a block of pixels, in one direction of the ramp, and where a drift has its zero."""

import numpy as np
import pytest

from arl_fixtures.reconcile.law import Axis, Law, axes_of
from arl_fixtures.reconcile.law_search import is_law, search_law
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import load_table


@pytest.fixture
def law_of(tmp_path, make_table, save):
    def make(change, without=(), **shape: int) -> Law:
        columns = make_table(71, change, **shape)
        kept = ~np.isin(columns["step"], without)
        table = save(tmp_path / "table.parquet", {n: v[kept] for n, v in columns.items()})
        looker = Looker(Problem(load_table(table)))
        data = next(d for d in looker.problem.data if d.channel.name == "distance_m")
        state = looker.problem.view.fresh_state()
        seen = looker.calibrate(data, state)
        law, chosen = search_law(looker, data, state, seen.leading())
        assert is_law(chosen)
        return law

    return make


def said(law: Law, **features: np.ndarray) -> np.ndarray:
    """Metres that a law adds at conditions that the table need not hold."""
    assert set(law.drivers) <= set(features), law.expression
    return law.correction(features, np.ones(len(next(iter(features.values())))))


def test_a_block_of_pixels_that_drifts_is_told_from_its_neighbours(law_of):
    def block(columns, rng):  # a second converter reads 40 columns by 12 rows, its clock follows the die
        del columns["azimuth_deg"], columns["elevation_deg"]
        columns["pixel_u"] = rng.integers(0, 128, len(columns["dut"])).astype(float)  # other pixels in each image
        columns["pixel_v"] = rng.integers(0, 32, len(columns["dut"])).astype(float)
        inside = (abs(columns["pixel_u"] - 49.5) < 20.0) & (abs(columns["pixel_v"] - 19.5) < 6.0)
        columns["distance_m"] = columns["distance_m"] + 9e-5 * inside * (columns["tof_temperature_c"] - 46.0)

    law = law_of(block, steps=20)
    u, v = (a.ravel() for a in np.meshgrid(np.arange(128.0), np.arange(32.0)))
    hot, cold = (
        said(law, pixel_u=u, pixel_v=v, tof_temperature_c=np.full(len(u), t), housing_temperature_c=u * 0.0 + t - 9.0)
        for t in (86.0, 6.0)
    )
    inside = (abs(u - 49.5) < 20.0) & (abs(v - 19.5) < 6.0)
    assert (hot - cold)[inside].mean() == pytest.approx(7.2e-3, rel=0.2)
    assert np.mean((hot - cold)[~inside] ** 2) < 0.02 * np.mean((hot - cold)[inside] ** 2)


def test_a_pattern_that_wanders_with_the_steps_is_foretold_at_others(law_of):
    def beat(columns, _rng):  # read-out rows beat against a lamp that burns while the chamber heats
        phase = columns["pixel_v"] / 9.3 + 0.382 * columns["step"]
        light = np.where(columns["ramp"] > 0, 2.5e-3, 0.0)
        columns["distance_m"] = columns["distance_m"] + light * np.sin(2.0 * np.pi * phase)

    unseen = np.array([2.0, 6.0, 9.0, 12.0])
    law = law_of(beat, unseen, steps=32)
    v, step = (a.ravel() for a in np.meshgrid(np.arange(0.0, 32.0, 3.0), unseen))
    orders = {"step": step, "time_s": 900.0 * step + 18.0, "set_temperature_c": -10.0 + 95.0 * step / 15.0}
    places = {"pixel_v": v, "elevation_deg": (v - 15.5) * 0.86}
    made = said(law, **places, **orders, ramp=np.ones(len(v)))
    truth = 2.5e-3 * np.sin(2.0 * np.pi * (v / 9.3 + 0.382 * np.where("time_s" in law.drivers, step + 0.02, step)))
    assert np.mean((made - truth) ** 2) < 0.2 * np.mean(truth**2)
    cooling = said(law, **places, **orders, ramp=-np.ones(len(v)))
    assert np.mean(cooling**2) < 0.05 * np.mean(truth**2)


def test_a_drift_has_its_zero_where_the_sensor_has_it_and_not_in_the_middle_of_the_steps(law_of):
    def skew(columns, _rng):
        odd = 2.0 * (columns["pixel_v"] % 2) - 1.0
        columns["distance_m"] = columns["distance_m"] + 6e-5 * odd * (columns["tof_temperature_c"] - 10.0)

    law = law_of(skew, steps=20)
    v = np.array([3.0, 4.0, 17.0, 18.0])
    at_zero, warm = (
        said(law, tof_temperature_c=t, housing_temperature_c=t - 9.0, **{"pixel_v": v, "~parity(pixel_v)": v % 2})
        for t in (np.full(4, 10.0), np.full(4, 80.0))
    )
    assert np.abs(warm) == pytest.approx(np.full(4, 4.2e-3), rel=0.25)
    assert np.abs(at_zero).max() < 0.15 * np.abs(warm).mean()


def test_a_mode_between_two_temperatures_ends_between_steps_and_does_not_recur(law_of):
    """Thermometers scatter within a step: an edge amid its readings would tell rows apart that are alike."""

    def hop(columns, rng):
        for name in ("tof_temperature_c", "housing_temperature_c", "set_temperature_c"):
            del columns[name]
        level = (5.0 * columns["step"]) % 13.0  # up and down, so that no run of steps is warm
        columns["laser_temperature_c"] = 14.0 + 4.0 * level + 0.2 * rng.normal(size=len(level))
        columns["distance_m"] = columns["distance_m"] + 4e-3 * np.isin(level, [5.0, 6.0, 7.0])

    law = law_of(hop, steps=13)
    degrees = np.array([18.0, 26.0, 38.0, 42.0, 50.0, 58.0, 66.0, 74.0])
    made = said(law, laser_temperature_c=degrees)
    assert made == pytest.approx(4e-3 * (np.abs(degrees - 38.0) < 5.0), abs=8e-4)


def test_a_band_says_its_edges():
    axis = Axis(column="pixel_u", kind="band", edges=(18.5, 28.5))
    assert axis({"pixel_u": np.array([18.0, 19.0, 28.0, 29.0, np.nan])}).tolist() == [0.0, 1.0, 1.0, 0.0, 0.0]
    assert axis.text == "[18.5 < pixel_u < 28.5]"


def test_every_sixth_row_has_no_parity():
    rows = np.arange(0.0, 32.0, 6.0)
    assert "parity" not in {axis.kind for axis in axes_of("pixel_v", rows, ())}
    assert "parity" in {axis.kind for axis in axes_of("pixel_v", rows / 2.0, ())}
