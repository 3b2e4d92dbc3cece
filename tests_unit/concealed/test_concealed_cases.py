import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from benchmarks.concealed import point_sensor
from benchmarks.concealed.assemble import build
from benchmarks.concealed.case import Concealment, band_of, visibility
from benchmarks.concealed.designs import sparse
from benchmarks.concealed.generate import write_batch
from benchmarks.concealed.likelihood import mean_information, mean_information_unknown_repeat, whiten
from benchmarks.concealed.lookalikes import lookalikes
from benchmarks.concealed.plan import BANDS, LIBRARY, SENSORS, UNKNOWN, Order, make, stated
from benchmarks.concealed.proof import Clock
from benchmarks.concealed.run_tool import Answer, ask, channels_of
from benchmarks.concealed.score import overlap, score
from benchmarks.concealed.sensor import flash

ONE_PER_SENSOR = {recipe.sensor: recipe for recipe in LIBRARY}


def test_whitening_makes_shared_errors_independent():
    rng = np.random.default_rng(0)
    group = np.repeat(np.arange(400), 50)
    sigma, shared = rng.uniform(0.5, 2.0, group.size), rng.uniform(0.0, 3.0, group.size)
    residual = sigma * rng.normal(size=group.size) + shared * rng.normal(size=400)[group]
    white = whiten(residual, sigma, shared, group)
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.03)
    # the sum over a group is what shared errors inflate
    sums = np.bincount(group, weights=white * shared / sigma)
    expected = np.bincount(group, weights=(shared / sigma) ** 2)
    assert np.mean(sums**2 / expected) == pytest.approx(1.0, abs=0.2)


def test_what_calibration_takes_up_is_not_visible():
    sigma, group = np.ones(200), np.zeros(200, dtype=int)
    shape = np.linspace(0, 1, 200)
    assert mean_information(3.0 * np.ones(200), sigma, None, group, np.ones((200, 1))) == pytest.approx(0.0, abs=1e-9)
    assert mean_information(shape, sigma, None, group, np.ones((200, 1))) == pytest.approx(
        np.sum((shape - shape.mean()) ** 2)
    )


@pytest.mark.parametrize("name", sorted(SENSORS))
def test_a_null_table_scatters_as_its_simulation_says(name):
    rng = np.random.default_rng(11)
    sensor = SENSORS[name](rng, ONE_PER_SENSOR[name].design(rng))
    case = build(rng, sensor, [], [], Concealment(repeat="declared"))
    for channel in sensor.channels:
        table = case.table
        seen = np.isfinite(table[channel])
        sigma = table[f"sim_{channel}_std"] / np.sqrt(table["n_frames"])
        z = ((table[channel] - table[f"sim_{channel}"]) / sigma)[seen]
        repeat = table.get(f"sim_{channel}_repeat_std")
        labels = np.unique(
            np.stack([np.unique(table[k], return_inverse=True)[1] for k in ("dut", "cycle", "step") if k in table]),
            axis=1,
            return_inverse=True,
        )[1].ravel()
        if repeat is not None:
            z = whiten(z * sigma[seen], sigma[seen], repeat[seen], labels[seen])
        assert np.mean(z**2) == pytest.approx(1.0, abs=6.0 * np.sqrt(2.0 / z.size))


def test_returns_that_are_too_weak_are_lost_in_the_simulation_too():
    lost = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        sensor = SENSORS["point"](rng, point_sensor.rail(rng))
        table = build(rng, sensor, [], [], Concealment()).table
        if "valid_fraction" in table:
            np.testing.assert_array_equal(table["sim_valid_fraction"], table["valid_fraction"])
            lost += int(np.sum(table["valid_fraction"] < 0.5))
    assert lost > 0


def test_oracle_visibility_reaches_the_band_that_was_ordered():
    reached = []
    for k, band in enumerate(BANDS):
        recipe = next(r for r in LIBRARY if r.effect == "timing.row_skew")
        case = make(np.random.default_rng(20 + k), Order("single", (recipe,), (band,)), ())
        reached.append(band_of(case.truth["effects"][0]["lambda"]) == band)
    assert all(reached)


def test_visibility_is_the_likelihood_ratio_of_the_data():
    rng = np.random.default_rng(5)
    design = sparse(rng, duts=1, steps=6, pixels=10, angles=7)
    sensor = flash(rng, design)
    effect = next(r for r in LIBRARY if r.effect == "timing.row_skew").make(rng, sensor.rows, design)
    seen = np.ones(sensor.n_frames.size, dtype=bool)
    amount = 2e-3
    expected = visibility(sensor, effect, amount, Concealment(repeat="none"), seen) ** 2
    sim, real = sensor.answer([]), sensor.answer([(effect, amount)])
    sigma = sim.std["distance_m"] / np.sqrt(sensor.n_frames)
    gains = []
    for _ in range(200):
        noisy = (real.mean["distance_m"] - sim.mean["distance_m"]) / sigma + rng.normal(size=sigma.size)
        noisy -= noisy @ (1 / sigma) / np.sum(1 / sigma**2) / sigma  # the offset is refitted
        model = (real.mean["distance_m"] - sim.mean["distance_m"]) / sigma
        model -= model @ (1 / sigma) / np.sum(1 / sigma**2) / sigma
        gains.append(np.sum(noisy**2) - np.sum((noisy - model) ** 2))
    assert np.mean(gains) == pytest.approx(expected, rel=0.05)


def test_held_out_conditions_are_unseen():
    for seed in range(6):
        recipe = next(r for r in LIBRARY if r.effect == "timing.range_walk" and r.sensor == "flash")
        case = make(np.random.default_rng(seed), Order("single", (recipe,), ("moderate",)), ())
        column = {"steps": "step", "angles": "stage_angle_deg", "dut": "dut", "cycle": "cycle"}[case.truth["heldout"]]
        assert not set(case.heldout[column]) & set(case.table[column])


def test_tables_keep_the_contract_and_names_betray_nothing(tmp_path):
    orders = [Order("single", (LIBRARY[0],), ("strong",)), Order("unknown", (UNKNOWN[0],), ("moderate",))]
    first = write_batch(tmp_path / "a", 3, [*orders, Order("null", (), ())], quiet=True, rivals=())
    again = write_batch(tmp_path / "b", 3, [*orders, Order("null", (), ())], quiet=True, rivals=())
    assert first == again
    truths = json.loads((tmp_path / "a" / "truth.json").read_text())["cases"]
    assert [t["name"] for t in truths] == ["c000", "c001", "c002"]
    case = make(np.random.default_rng(1), orders[0], ())
    for channel in channels_of(list(case.table)):
        assert f"sim_{channel}_std" in case.table
    assert not any("true_" in n and n != "true_range_m" for n in case.table)
    assert set(case.oracle) <= set(case.heldout)


def test_the_stated_sample_holds_every_id_and_all_strengths():
    batch = stated(np.random.default_rng(0))
    singles = [o for o in batch if o.kind == "single"]
    assert len({o.recipes[0].effect for o in singles}) == 42
    assert {o.bands[0] for o in singles} == set(BANDS)
    assert len(batch) >= 60


def _diagnosis(effect, **more):
    finding = {
        "effect": effect,
        "channels": ["distance_m"],
        "where": {},
        "drivers": ["pixel_v"],
        "equivalent_to": [],
        "law": {"parameters": []},
    }
    return {"verdict": "mismatch", "findings": [finding | more]}


def test_scores_tell_right_class_and_wrong_apart(tmp_path):
    recipe = next(r for r in LIBRARY if r.effect == "timing.row_skew")
    write_batch(tmp_path, 8, [Order("single", (recipe,), ("strong",))], quiet=True, rivals=())
    truth = json.loads((tmp_path / "truth.json").read_text())["cases"][0]
    import pyarrow.parquet as pq

    heldout = pq.read_table(tmp_path / "c000" / "heldout.parquet")
    perfect = {"corrected_distance_m": pq.read_table(tmp_path / "oracle" / "c000.parquet")["distance_m"].to_numpy()}
    useless = {"corrected_distance_m": heldout["sim_distance_m"].to_numpy()}

    right = score(truth, tmp_path, Answer(_diagnosis("timing.row_skew"), perfect, 1.0, 1.0, ""))
    assert (right.named, right.exact, right.wrong, right.explained) == (True, True, False, pytest.approx(1.0))
    classed = score(
        truth, tmp_path, Answer(_diagnosis("mount.tilt", equivalent_to=["timing.row_skew"]), useless, 1.0, 1.0, "")
    )
    assert (classed.named, classed.classed, classed.wrong) == (False, True, False)
    assert classed.explained == pytest.approx(0.0)
    wrong = score(truth, tmp_path, Answer(_diagnosis("mount.tilt"), useless, 1.0, 1.0, ""))
    assert (wrong.named, wrong.wrong, wrong.exact) == (False, True, False)
    honest = score(truth, tmp_path, Answer(_diagnosis("unknown"), useless, 1.0, 1.0, ""))
    assert (honest.named, honest.wrong) == (False, False)


def test_regions_are_compared_in_rows():
    columns = {"pixel_u": np.arange(10), "surface": np.array(["a"] * 5 + ["b"] * 5, dtype=object)}
    assert overlap({"pixel_u": [0, 4]}, {"surface": ["a"]}, columns) == 1.0
    assert overlap({"pixel_u": [0, 9]}, {"surface": ["a"]}, columns) == 0.5
    assert overlap({"surface": ["b"]}, {"surface": ["a"]}, columns) == 0.0


def test_the_oracle_finds_the_look_alike_of_a_coupled_temperature_and_no_other():
    rng = np.random.default_rng(3)
    design = sparse(rng, duts=1, steps=12, pixels=10, angles=5, laser_program_k=0.0)
    sensor = flash(rng, design)
    gain = next(r for r in LIBRARY if r.effect == "detector.gain_temperature" and r.sensor == "flash")
    rivals = tuple(
        r
        for r in LIBRARY
        if r.sensor == "flash"
        and r.effect in ("laser.thermal_rolloff", "timing.row_skew", "target.reflectance_error")
    )
    seen = np.ones(sensor.n_frames.size, dtype=bool)
    # laser and detector temperature are one straight line of the other in this design
    alike = lookalikes(rng, sensor, gain.make(rng, sensor.rows, design), 3e-4, Concealment(), seen, rivals)
    assert alike == ["laser.thermal_rolloff"]


def test_a_shift_of_whole_steps_is_hard_to_see_where_their_repeatability_is_unknown():
    group = np.repeat(np.arange(20), 100)
    sigma, ones = np.ones(group.size), np.ones(group.size)
    drift = 0.5 * np.linspace(-1, 1, 20)[group]
    known = mean_information(drift, sigma, None, group, None)
    unknown = mean_information_unknown_repeat(drift, sigma, ones, 0.0, group, None)
    # twenty groups are twenty witnesses: log of the variance ratio, not 2 000 rows
    between = np.mean((0.5 * np.linspace(-1, 1, 20)) ** 2) * 100
    assert unknown == pytest.approx(20 * np.log1p(between), rel=0.05)
    assert unknown < known / 3
    within = np.tile(np.linspace(-0.2, 0.2, 100), 20)
    assert mean_information_unknown_repeat(within, sigma, ones, 0.0, group, None) == pytest.approx(
        mean_information(within, sigma, None, group, None), rel=0.01
    )


def test_the_tool_asked_is_the_one_beside_the_benchmark(tmp_path, monkeypatch):
    # the caller stands in a folder that has a package of the same name
    (tmp_path / "arl_fixtures").mkdir()
    (tmp_path / "arl_fixtures" / "__init__.py").write_text("raise SystemExit('not this one')")
    (tmp_path / "case").mkdir()
    pq.write_table(pa.table({"time_s": [0.0, 1.0]}), tmp_path / "case" / "table.parquet")
    monkeypatch.chdir(tmp_path)
    told = ask(Path("case"), Path("out"))
    assert "not this one" not in told.error
    assert "channel" in told.error


def test_proof_begins_no_case_that_is_likely_to_end_after_its_time():
    now = [0.0]
    clock = Clock(0.0, 900.0, lambda: now[0])
    assert clock.allows_one_more()
    clock.took(90.0)
    clock.took(30.0)
    now[0] = 779.0
    assert clock.allows_one_more(), "twice the mean would end a second before"
    now[0] = 781.0
    assert not clock.allows_one_more()
    assert Clock(0.0, None, lambda: 1e9).allows_one_more(), "no limit was set"
