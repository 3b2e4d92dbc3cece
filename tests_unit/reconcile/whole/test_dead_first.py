"""Pixels that die on the way are found as such, and nothing else is made of what they no longer see."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile import patterns_beside
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.dead import dead_first
from arl_fixtures.reconcile.patterns import find_patterns
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import load_table

RIVALS = (
    "detector.dead_pixels", "detector.dark_offset", "detector.gain_temperature", "detector.pixel_response",
    "optics.window_contamination", "optics.window_frost",
)  # fmt: skip
"""Effects that single pixels, for some time, may owe their answers to."""


def few_rows(table, *unasked):
    """Three of seven stage angles, without channels that nothing is asked of: a death shows in every row."""
    kept = np.isin(table["stage_angle_deg"], np.unique(table["stage_angle_deg"])[::3])
    return {name: x[kept] for name, x in table.items() if not any(channel in name for channel in unasked)}


def test_pixels_that_die_in_the_test_are_the_only_finding(tmp_path, make_table, save):
    def dying(columns, _rng):
        pixels = np.unique(columns["pixel_u"] * 100.0 + columns["pixel_v"])
        gone = np.isin(columns["pixel_u"] * 100.0 + columns["pixel_v"], pixels[[3]])
        dead = gone & (columns["cycle"] >= 3)
        columns["intensity_counts"] = np.where(dead, 0.0, columns["intensity_counts"])

    table = few_rows(make_table(81, None, steps=12), "distance_m")
    cycle = 1.0 + np.floor(table["step"] / 4.0)
    table["cycle"], table["step"] = cycle, np.mod(table["step"], 4.0)
    dying(table, None)
    diagnosis, _, _ = diagnose(load_table(save(tmp_path / "table.parquet", table)))
    (found,) = diagnosis.findings
    assert found.effect == "detector.dead_pixels"
    assert found.statement.startswith("2 of 26 pixels")  # one of each device


def answers(table, silent, rng):
    """Ten frames a row, of which nearly all bring an answer; none where a pixel is silent."""
    given = rng.binomial(10, 0.995, len(silent)) / 10.0
    table["valid_fraction"], table["sim_valid_fraction"] = np.where(silent, 0.0, given), np.ones(len(silent))
    table["intensity_counts"] = np.where(silent, np.nan, table["intensity_counts"])


def pixels_of(table):
    number = table["pixel_u"] * 100.0 + table["pixel_v"]
    return np.searchsorted(np.unique(number), number)


def test_pixels_that_die_between_steps_are_dead_from_there_on(tmp_path, make_table, save, knows_only):
    knows_only(*RIVALS)
    table = few_rows(make_table(83, None, steps=12), "distance_m")
    pixel, first, step = pixels_of(table), table["dut"] == "S0", table["step"]
    answers(table, ((pixel == 3) & first & (step >= 5)) | ((pixel == 7) & (step >= 8)), np.random.default_rng(1))
    unseen = (step == 4) | (step == 11)
    train, later = ({n: v[rows] for n, v in table.items()} for rows in (~unseen, unseen))
    diagnosis = reconcile(save(tmp_path / "table.parquet", train), tmp_path / "out")
    (found,) = diagnosis.findings
    assert found.effect == "detector.dead_pixels"
    assert found.statement.startswith("3 of 26 pixels")
    truth = later.pop("valid_fraction")
    later.pop("intensity_counts")
    predict(tmp_path / "out", save(tmp_path / "later.parquet", later), tmp_path / "told.parquet")
    told = pq.read_table(tmp_path / "told.parquet")["corrected_valid_fraction"].to_numpy()
    assert np.array_equal(told < 0.5, truth < 0.5)


def test_pixels_that_come_back_are_not_called_dead(tmp_path, make_table, save):
    table = few_rows(make_table(84, None, steps=9, duts=1), "distance_m")
    pixel = pixels_of(table)
    answers(table, np.isin(pixel, (3, 7)) & np.isin(table["step"], (4, 5)), np.random.default_rng(2))
    columns = load_table(save(tmp_path / "table.parquet", table))
    diagnosis, _, _ = diagnose(columns, effects=[library()[name] for name in RIVALS])
    assert "detector.dead_pixels" not in [f.effect for f in diagnosis.findings]


def test_answers_that_are_lost_by_chance_are_no_mismatch(make_table, save, tmp_path):
    """Of ten frames each brings its answer with 97 %, as the simulation says, which states no scatter of it."""
    for seed in (5, 6):
        table = make_table(seed, None, steps=8, duts=1)
        rng = np.random.default_rng(seed)
        table["valid_fraction"] = rng.binomial(10, 0.97, len(table["step"])) / 10.0
        table["sim_valid_fraction"] = np.full(len(table["step"]), 0.97)
        diagnosis, _, _ = diagnose(load_table(save(tmp_path / "table.parquet", table)))
        assert [f.effect for f in diagnosis.findings] == []


@pytest.mark.parametrize(("uneven", "sparse"), [(0.0, True), (0.05, False)])
def test_dead_pixels_are_gains_of_minus_one_only_where_the_living_ones_differ_too(
    tmp_path, make_table, save, uneven, sparse
):
    """A free gain also follows a dead pixel's noise, and so may gain a little more than its death."""

    def broken(columns, rng):
        pixel = pixels_of(columns)
        gone = np.isin(pixel, [3, 9]) & (columns["dut"] == "S1")
        light = columns["intensity_counts"] * (1.0 + uneven * rng.normal(size=pixel.max() + 1))[pixel]
        columns["intensity_counts"] = np.where(gone, 0.0, light)

    effects = [library()[name] for name in ("detector.dead_pixels", "detector.pixel_response")]
    problem = Problem(load_table(save(tmp_path / "t.parquet", make_table(91, broken, steps=6))))
    found = sorted(find_patterns(problem, effects, ()), key=lambda p: p.term.effect.sparse)
    assert [p.term.effect.sparse for p in found] == [False, True]
    assert dead_first(problem, effects, (), found)[0].term.effect.sparse is sparse


def test_what_dead_pixels_scatter_has_no_cause_of_its_own(tmp_path, make_table, save, knows_only):
    knows_only(*RIVALS)
    table, rng = few_rows(make_table(84, None, steps=12), "distance_m"), np.random.default_rng(2)
    dead = np.isin(pixels_of(table), [2, 9])
    name = "intensity_counts"
    spread = table[f"sim_{name}_std"] * np.sqrt(rng.chisquare(9, dead.size) / 9.0)
    table[name], table[f"{name}_std"] = np.where(dead, 0.0, table[name]), np.where(dead, 0.0, spread)
    (found,) = diagnose(load_table(save(tmp_path / "table.parquet", table)))[0].findings
    assert found.effect == "detector.dead_pixels"


def test_pixels_whose_answers_fail_are_dead_though_their_light_has_a_law(tmp_path, make_table, save, knows_only):
    """Neighbours in one device break one by one and report nothing: a law of place and cycle nearly says so."""
    knows_only(*RIVALS)
    table, rng = few_rows(make_table(85, None, steps=24), "distance_m"), np.random.default_rng(3)
    table["cycle"], table["step"] = np.floor(table["step"] / 4.0), np.mod(table["step"], 4.0)
    breaks = zip(np.unique(table["pixel_u"]), (3, 3, 4, 4, 5), strict=False)
    gone = [(table["pixel_u"] == u) & (table["cycle"] >= first) for u, first in breaks]
    silent = (table["dut"] == "S1") & np.any(gone, axis=0)
    table["valid_fraction"] = np.where(silent, 0.0, rng.binomial(10, 0.995, silent.size) / 10.0)
    table["sim_valid_fraction"] = np.full(silent.size, 0.995)
    table["sim_valid_fraction_std"] = np.full(silent.size, 0.07)
    table["intensity_counts"] = np.where(silent, 0.0, table["intensity_counts"])
    (found,) = diagnose(load_table(save(tmp_path / "table.parquet", table)))[0].findings
    assert found.effect == "detector.dead_pixels"


def test_a_pixel_that_never_answers_is_no_spot_on_the_window(tmp_path, save, knows_only, monkeypatch):
    """Of strewn pixels the neighbours are not in the table: a small enough spot covers this one and no other."""
    knows_only(*RIVALS)
    asked = []
    monkeypatch.setattr(patterns_beside, "spots_instead", lambda *given: asked.append(given))
    rng = np.random.default_rng(4)
    place = rng.choice(100 * 32, 300, replace=False)
    pixel, angle, step = (a.ravel() for a in np.meshgrid(range(300), range(3), range(6), indexing="ij"))
    kept = rng.random(pixel.size) < 0.4
    pixel, angle, step = pixel[kept], angle[kept], step[kept]
    u, v = place[pixel] % 100.0, place[pixel] // 100.0
    light = 900.0 + 500.0 * np.sin(1.7 * angle + u / 9.0)
    sigma = np.sqrt(light)
    read = light + sigma * rng.normal(size=light.size) / np.sqrt(10.0)
    table = {
        "step": 1.0 * step, "housing_temperature_c": 10.0 * step, "stage_angle_deg": 8.0 * angle, "pixel_u": u,
        "pixel_v": v, "azimuth_deg": 0.9 * (u - 49.5), "elevation_deg": 0.9 * (15.5 - v),
        "n_frames": np.full(light.size, 10.0), "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "intensity_counts": np.where(pixel == 7, 0.0, read),
    }  # fmt: skip
    (found,) = diagnose(load_table(save(tmp_path / "table.parquet", table)))[0].findings
    assert found.effect == "detector.dead_pixels"
    assert not asked


@pytest.mark.parametrize("wild", [-11.0, 0.02], ids=["below nothing", "once dark"])
def test_one_wild_reading_of_a_pixel_that_a_cycle_holds_once_is_no_death(tmp_path, make_table, save, wild):
    """Of an even draw of rows some pixels have one in a cycle."""
    table = make_table(85, None, steps=12)
    cycle = 1.0 + np.floor(table["step"] / 4.0)
    table["cycle"], table["step"] = cycle, np.mod(table["step"], 4.0)
    kept = np.random.default_rng(3).uniform(size=cycle.size) < 0.12
    table = {name: x[kept] for name, x in table.items()}
    level = np.unique(
        np.stack([pixels_of(table), table["cycle"], np.unique(table["dut"], return_inverse=True)[1]]), axis=1,
        return_inverse=True,
    )[1].ravel()  # fmt: skip
    single = np.bincount(level)[level] == 1
    row = np.flatnonzero(single)[np.argmax(table["sim_intensity_counts"][single])]
    table["intensity_counts"][row] = wild * table["sim_intensity_counts"][row]
    problem = Problem(load_table(save(tmp_path / "table.parquet", table)))
    assert not [p for p in find_patterns(problem, [library()["detector.dead_pixels"]], ()) if p.size]
