"""From a Parquet file to a diagnosis on disk and back to predictions."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from threadpoolctl import threadpool_info, threadpool_limits

from arl_fixtures.reconcile import parcels, table
from arl_fixtures.reconcile.command import predict, reconcile, reconcile_command
from arl_fixtures.reconcile.shared_work import processes

RIVALS = ("timing.range_walk", "timing.temperature_offset", "timing.clock_scale", "stage.zero_offset")
"""Effects that shift a distance on average, the one that the tables hold among them."""
SCHEMA = Path(__file__).parents[3] / "shared" / "spec" / "diagnosis.schema.json"


@pytest.fixture(scope="module")
def walked(tmp_path_factory, make_table, save, walk):
    """A table with a range walk, the folder of its diagnosis (to be read only), and the diagnosis."""
    folder = tmp_path_factory.mktemp("walked")
    table = save(folder / "t.parquet", make_table(2, walk, steps=4, duts=1))
    return table, folder / "out", reconcile(table, folder / "out")


def column(path: Path, name: str) -> np.ndarray:
    return pq.read_table(path)[name].to_numpy(zero_copy_only=False).astype(float)


def test_a_table_without_mismatch_is_consistent(tmp_path, make_table, save):
    diagnosis = reconcile(save(tmp_path / "t.parquet", make_table(1)), tmp_path / "out")
    assert (diagnosis.verdict, diagnosis.findings) == ("consistent", [])
    assert diagnosis.false_alarm_probability > 0.01
    assert np.all(column(tmp_path / "out/localisation.parquet", "mismatch_distance_m") == 0.0)


def test_a_threshold_crossing_is_named_range_walk_and_predicted_on_a_new_sensor(
    walked, tmp_path, make_table, save, walk
):
    _, out, diagnosis = walked
    assert [f.effect for f in diagnosis.findings] == ["timing.range_walk"]
    finding = diagnosis.findings[0]
    assert finding.channels == ["distance_m"]
    assert finding.held_out.explained > 0.9
    fresh = make_table(77, walk)
    blind = {n: v for n, v in fresh.items() if n not in {"intensity_counts", "distance_m"}}
    predict(out, save(tmp_path / "new.parquet", blind), tmp_path / "p.parquet")
    corrected = column(tmp_path / "p.parquet", "corrected_distance_m")
    before = np.std(fresh["distance_m"] - fresh["sim_distance_m"])
    after = np.std(fresh["distance_m"] - corrected)
    noise = np.std(fresh["sim_distance_m_std"]) + np.mean(fresh["sim_distance_m_std"] / np.sqrt(10.0))
    assert after < before
    assert after < 1.5 * noise


def test_what_a_faint_effect_shifts_on_average_is_predicted_for_each_unit(
    tmp_path, make_table, save, walk, knows_only
):
    knows_only(*RIVALS)

    def faint(columns, rng):
        before = columns["distance_m"].copy()
        walk(columns, rng)
        columns["distance_m"] = before + 0.2 * (columns["distance_m"] - before)

    reconcile(save(tmp_path / "t.parquet", make_table(2, faint, steps=9)), tmp_path / "out")
    fresh = make_table(79, faint)
    truth = fresh["distance_m"] - make_table(79)["distance_m"]
    predict(tmp_path / "out", save(tmp_path / "new.parquet", fresh), tmp_path / "p.parquet")
    made = column(tmp_path / "p.parquet", "corrected_distance_m") - fresh["sim_distance_m"]
    for unit in ("S0", "S1"):
        rows = fresh["dut"] == unit
        assert abs(np.mean((made - truth)[rows])) < 0.5 * np.mean(truth[rows])


def test_a_constant_over_few_steps_is_that_of_their_means(tmp_path, make_table, save, walk, knows_only):
    knows_only(*RIVALS)

    def uneven(columns, rng):  # pixels differ, and nothing declares what steps share
        walk(columns, rng)
        offset_m = np.random.default_rng(4).normal(0.0, 1e-3, (32, 128))
        columns["distance_m"] += offset_m[columns["pixel_v"].astype(int), columns["pixel_u"].astype(int)]

    few = {n: v for n, v in make_table(4, uneven, steps=4, duts=1).items() if not n.endswith("repeat_std")}
    reconcile(save(tmp_path / "t.parquet", few), tmp_path / "out")
    fresh = make_table(79, uneven, duts=1)
    truth = fresh["distance_m"] - make_table(79, duts=1)["distance_m"]
    predict(tmp_path / "out", save(tmp_path / "new.parquet", fresh), tmp_path / "p.parquet")
    made = column(tmp_path / "p.parquet", "corrected_distance_m") - fresh["sim_distance_m"]
    assert abs(np.mean(made - truth)) < 0.3 * np.mean(truth)


def test_what_no_effect_explains_is_unknown_with_its_drivers_and_still_predicts(tmp_path, make_table, save, parity):
    diagnosis = reconcile(save(tmp_path / "t.parquet", make_table(3, parity, duts=1, steps=9)), tmp_path / "out")
    first = diagnosis.findings[0]
    assert first.effect == "unknown"
    assert first.channels == ["distance_m"]
    assert set(first.drivers[:2]) & {"pixel_v", "elevation_deg"}
    assert any(name.endswith("temperature_c") for name in first.drivers)
    fresh = make_table(78, parity, duts=1)
    predict(tmp_path / "out", save(tmp_path / "new.parquet", fresh), tmp_path / "p.parquet")
    clean = make_table(78, duts=1)["distance_m"]
    truth = fresh["distance_m"] - clean
    made = column(tmp_path / "p.parquet", "corrected_distance_m") - fresh["sim_distance_m"]
    assert np.mean((made - truth) ** 2) < 0.35 * np.mean(truth**2)


def test_the_diagnosis_follows_the_schema(walked):
    if not SCHEMA.exists():
        pytest.skip("the contract's schema lies beside the repository and is absent here")
    import jsonschema

    _, out, _ = walked
    jsonschema.validate(json.loads((out / "diagnosis.json").read_text()), json.loads(SCHEMA.read_text()))


@pytest.mark.parametrize("count", [1, 2])
def test_the_same_table_gives_the_same_bytes(walked, tmp_path, count):
    path, out, diagnosis = walked
    with processes(count):
        assert reconcile(path, tmp_path / "again") is not diagnosis
    for name in ("diagnosis.json", "diagnosis.html"):
        assert (tmp_path / "again" / name).read_bytes() == (out / name).read_bytes()


@pytest.mark.parametrize(
    ("columns", "word"),
    [
        ({"housing_temperature_c": [1.0, 2.0]}, "no channel"),
        ({"sim_distance_m": [1.0, 2.0]}, "sim_distance_m"),
        ({"distance_m": ["a", "b"], "sim_distance_m": [1.0, 2.0]}, "text"),
        ({"distance_m": [np.nan, np.nan], "sim_distance_m": [1.0, 2.0]}, "nowhere observed"),
        ({"distance_m": [1.0], "sim_distance_m": [1.0]}, "1 row"),
        ({"distance_m": [], "sim_distance_m": []}, "no rows"),
    ],
)
def test_an_unusable_table_ends_with_one_line_and_no_folder(tmp_path, columns, word):
    pq.write_table(pa.table(columns), tmp_path / "t.parquet")
    result = CliRunner().invoke(reconcile_command, [str(tmp_path / "t.parquet"), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert word in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["t.parquet"]


def test_predicting_without_a_driver_names_the_missing_column(walked, tmp_path, make_table, save):
    from arl_fixtures.errors import DataError

    _, out, _ = walked
    fresh = {n: v for n, v in make_table(9).items() if "intensity" not in n}
    with pytest.raises(DataError, match=r"new\.parquet: .*intensity_counts"):
        predict(out, save(tmp_path / "new.parquet", fresh), tmp_path / "p.parquet")
    assert not (tmp_path / "p.parquet").exists()


def test_a_table_too_large_for_memory_is_predicted_in_batches_alike(
    tmp_path, make_table, save, parity, knows_only, monkeypatch
):
    """Worked through in batches of whole cycles, each row gets what it gets with the whole table in memory."""
    knows_only()  # it is an unknown law all the same
    parts = [make_table(seed, parity, duts=1, steps=4) for seed in (3, 4, 5)]
    for number, part in enumerate(parts):
        part["cycle"] = np.full(len(part["cycle"]), float(number + 1))
    order = np.random.default_rng(1).permutation(sum(len(p["cycle"]) for p in parts))
    path = save(tmp_path / "t.parquet", {n: np.concatenate([p[n] for p in parts])[order] for n in parts[0]})
    assert reconcile(path, tmp_path / "whole").findings
    predict(tmp_path / "whole", path, tmp_path / "whole.parquet")
    monkeypatch.setattr(table, "MAX_ROWS_IN_MEMORY", 900)
    monkeypatch.setattr(parcels.batches_of_parcels, "__defaults__", (750,))
    assert len(list(table.table_in_batches(path))) > 2
    predict(tmp_path / "whole", path, tmp_path / "batches.parquet")
    assert np.allclose(column(tmp_path / "whole.parquet", "corrected_distance_m"),
                       column(tmp_path / "batches.parquet", "corrected_distance_m"), rtol=0, atol=1e-12)  # fmt: skip
    reconcile(path, tmp_path / "batches")
    found = pq.read_table(tmp_path / "batches" / "localisation.parquet")
    assert found.num_rows == len(order)
    assert found.schema == pq.read_schema(tmp_path / "whole" / "localisation.parquet")


def test_a_table_without_pixels_angles_or_temperatures_is_compared_too(tmp_path, save):
    rng = np.random.default_rng(8)
    current = np.linspace(0.0, 2.0, 400)
    table = {
        "drive_current_a": current,
        "output_w": np.maximum(current - 0.5, 0.0) * 0.8 + rng.normal(0, 0.002, 400),
        "sim_output_w": np.maximum(current - 0.5, 0.0) * 0.8,
        "sim_output_w_std": np.full(400, 0.002),
    }
    assert reconcile(save(tmp_path / "t.parquet", table), tmp_path / "out").verdict == "consistent"
    table["output_w"] = table["output_w"] - 0.05 * np.maximum(current - 1.2, 0.0)
    diagnosis = reconcile(save(tmp_path / "u.parquet", table), tmp_path / "out2")
    assert diagnosis.verdict == "mismatch"
    assert diagnosis.fit["output_w"].after < 0.3 * diagnosis.fit["output_w"].before


def test_sums_are_made_in_one_thread_whatever_the_machine_allows(tmp_path, make_table, save, knows_only):
    """Several threads round otherwise, and a fit may end elsewhere."""
    knows_only("timing.clock_scale")
    seen = []

    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    with threadpool_limits(2, user_api="blas"):
        reconcile(
            save(tmp_path / "t.parquet", make_table(1, steps=3, duts=1)), tmp_path / "out",
            lambda text, _share: seen.append((text, threads())),
        )  # fmt: skip
        assert threads() == {2}
    assert all(found == {1} for text, found in seen if text.startswith("search"))
    assert any(text.startswith("search") for text, _ in seen)
