"""Bad input from the shell: one line and status 2 with nothing written, or what can be used is used."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from arl_fixtures.reconcile.command import predict_command, reconcile_command

Table = dict[str, np.ndarray]


def table(rows: int = 240, steps: int = 8) -> Table:
    """Two channels that agree with their simulation."""
    rng = np.random.default_rng(4)
    step = np.arange(rows) % steps
    simulated = 500.0 + 100.0 * rng.random(rows)
    return {
        "step": step.astype(float), "pixel_u": (np.arange(rows) // steps).astype(float),
        "tof_temperature_c": 20.0 + 3.0 * step, "n_frames": np.full(rows, 9.0),
        "intensity_counts": simulated + rng.normal(size=rows), "sim_intensity_counts": simulated,
        "sim_intensity_counts_std": np.full(rows, 3.0),
        "distance_m": 1.0 + simulated / 1e3 + 1e-3 * rng.normal(size=rows), "sim_distance_m": 1.0 + simulated / 1e3,
        "sim_distance_m_std": np.full(rows, 3e-3),
    }  # fmt: skip


def run(path: Path, out: Path) -> Result:
    return CliRunner().invoke(reconcile_command, [str(path), "--out", str(out)])


def refused(result: Result, folder: Path, *there: str) -> str:
    """The one line of a refusal that has left nothing behind."""
    assert isinstance(result.exception, SystemExit), result.exception
    assert (result.exit_code, result.stdout) == (2, "")
    assert len(result.stderr.strip().splitlines()) == 1
    assert sorted(p.name for p in folder.iterdir()) == sorted(there)
    return result.stderr


def _rows(count: int) -> Callable[[Table], Table]:
    return lambda t: {name: values[:count] for name, values in t.items()}


def _without(*names: str) -> Callable[[Table], Table]:
    return lambda t: {name: values for name, values in t.items() if name not in names}


def _in_furlongs(t: Table) -> Table:
    return {name.replace("distance_m", "distance_furlong"): values for name, values in t.items()}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_without("sim_intensity_counts", "sim_distance_m"), "no channel to compare"),
        (_without("intensity_counts", "distance_m"), "has no measured column 'intensity_counts'"),
        (
            lambda t: {**t, "distance_m": t["distance_m"].astype(str), "intensity_counts": t["step"].astype(str)},
            "text",
        ),
        (
            lambda t: {**t, "distance_m": t["step"] + np.nan, "intensity_counts": t["step"] + np.nan},
            "nowhere observed",
        ),
        (_rows(1), "1 row"),
        (_rows(3), "only 3 rows"),
        (_rows(0), "has no rows"),
        (
            lambda t: _in_furlongs(_without("intensity_counts", "sim_intensity_counts")(t)),
            "column 'distance_furlong' is in 'furlong', a unit that is not known here; expected one of m, cm, mm, km",
        ),
    ],
)
def test_a_table_with_nothing_to_compare_is_refused(tmp_path, change, words):
    pq.write_table(pa.table(change(table())), tmp_path / "t.parquet")
    assert words in refused(run(tmp_path / "t.parquet", tmp_path / "out"), tmp_path, "t.parquet")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"step,distance_m\n1,2\n", "is not a Parquet file"), (b"", "is not a Parquet file"), (None, "no such file"),
        ("cut", "is not a Parquet file"), ("folder", "is a folder"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_table_is_refused(tmp_path, content, words):
    path = tmp_path / "t.parquet"
    if content == "folder":
        path.mkdir()
    elif content == "cut":
        pq.write_table(pa.table(table()), path)
        path.write_bytes(path.read_bytes()[:-2000])
    elif content is not None:
        path.write_bytes(content)
    left = [] if content is None else ["t.parquet"]
    line = refused(run(path, tmp_path / "out"), tmp_path, *left)
    assert words in line
    assert str(path) in line


@pytest.mark.parametrize(
    ("change", "channels", "told"),
    [
        (_without("distance_m"), ["intensity_counts"], ("sim_distance_m", "has no measured column 'distance_m'")),
        (lambda t: {**t, "distance_m": t["distance_m"].astype(str)}, ["intensity_counts"], ("distance_m", "text")),
        (lambda t: {**t, "distance_m": t["step"] + np.nan}, ["intensity_counts"], ("distance_m", "nowhere observed")),
        (lambda t: {**t, "tof_temperature_c": t["step"] + np.nan}, None, ("tof_temperature_c", "holds no value")),
        (lambda t: {n: np.concatenate([v, v]) for n, v in t.items()}, None, ("(repeated rows)", "240 rows repeat")),
        (
            lambda t: {**t, "distance_m": np.where(t["pixel_u"] == 3, np.inf, t["distance_m"])}, None,
            ("distance_m (rows)", "8 infinite values"),
        ),
        (
            lambda t: {**t, "sim_distance_m": np.where(t["pixel_u"] == 3, 1e300, t["sim_distance_m"])}, None,
            ("sim_distance_m (rows)", "8 infinite values"),
        ),
        (lambda t: {**t, "tof_temperature_c": t["step"].astype(str)}, None, ("tof_temperature_c", "holds text")),
        (
            lambda t: {**t, "sim_distance_m_std": t["step"] / 1e3 - 1e-3}, None,
            ("sim_distance_m_std (rows)", "30 standard deviations below nil"),
        ),
        (_in_furlongs, ["intensity_counts"], ("distance_furlong", "is in 'furlong', a unit that is not known here")),
        (
            lambda t: {**t, "board_temperature_f": t["tof_temperature_c"]}, None,
            ("board_temperature_f (unit)", "is in 'f', a unit that is not known here; expected one of c, k; used as"),
        ),
        (lambda t: {**t, "n_frames": t["step"]}, None, ("n_frames (rows)", "30 rows count fewer than one frame")),
    ],
)  # fmt: skip
def test_what_can_be_used_is_used_and_the_report_says_what_was_not(tmp_path, change, channels, told):
    pq.write_table(pa.table(change(table())), tmp_path / "t.parquet")
    result = run(tmp_path / "t.parquet", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert said["verdict"] == "consistent"
    assert said["table"]["channels"] == (channels or ["distance_m", "intensity_counts"])
    assert told[1] in said["table"]["not_used"][told[0]]
    assert told[1].replace("'", "&#39;") in (tmp_path / "out" / "diagnosis.html").read_text()
    rows = pq.ParquetFile(tmp_path / "t.parquet").metadata.num_rows
    assert pq.ParquetFile(tmp_path / "out" / "localisation.parquet").metadata.num_rows == rows


@pytest.mark.parametrize(("quantum", "copies"), [(0.0, True), (1.0, False)])
def test_copies_are_told_from_coarse_readings_where_nothing_says_which_row_is_which(tmp_path, quantum, copies):
    """A second witness is one whose readings repeat by chance, as whole counts do."""
    whole = _without("pixel_u", "distance_m", "sim_distance_m", "sim_distance_m_std")(table())
    seen = whole["intensity_counts"]
    whole |= {
        "sim_intensity_counts": np.full(240, 550.0) if quantum else whole["sim_intensity_counts"],
        "intensity_counts": 550.0 + np.round(seen - whole["sim_intensity_counts"]) if quantum else seen,
    }
    pq.write_table(pa.table({n: np.concatenate([v, v]) for n, v in whole.items()}), tmp_path / "t.parquet")
    assert run(tmp_path / "t.parquet", tmp_path / "out").exit_code == 0
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["table"]["not_used"]
    assert ("(repeated rows)" in said) == copies


def test_an_unknown_unit_and_a_single_step_are_no_obstacle(tmp_path):
    one = {n.replace("distance_m", "loss_furlong"): v for n, v in table().items()}
    one["step"] = np.full(240, 3.0)
    pq.write_table(pa.table(one), tmp_path / "t.parquet")
    result = run(tmp_path / "t.parquet", tmp_path / "out")
    assert result.exit_code == 0
    assert result.stdout == "consistent (240 rows, intensity_counts, loss_furlong)\n"
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["table"]["not_used"]
    assert "'furlong', a unit that is not known here" in said["loss_furlong (unit)"]


def test_an_older_diagnosis_is_replaced_and_other_files_stay(tmp_path):
    pq.write_table(pa.table(table()), tmp_path / "t.parquet")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    (tmp_path / "out" / "diagnosis.json").write_text("old")
    assert run(tmp_path / "t.parquet", tmp_path / "out").exit_code == 0
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text())["verdict"] == "consistent"
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_a_refused_table_leaves_an_older_diagnosis_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "diagnosis.json").write_text("old")
    refused(run(tmp_path / "t.parquet", tmp_path / "out"), tmp_path, "out")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["diagnosis.json"]


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    pq.write_table(pa.table(table()), tmp_path / "t.parquet")
    (tmp_path / "out").write_text("mine")
    line = refused(run(tmp_path / "t.parquet", tmp_path / "out"), tmp_path, "out", "t.parquet")
    assert "is a file; expected a folder" in line


MODEL = """schema: arl-model/1
effects:
- effect: timing.temperature_offset
  options: {channel: distance_m, temperature: tof_temperature_c, shape: line, reference: 25.0}
  values: {slope: 0.0001}
  channels: [distance_m]
  drivers: [tof_temperature_c]
"""
OLD_BIT = """unknown:
  - channel: distance_m
    relative: false
    expression: c1*[bit 64 of sim_distance_m]
    drivers: [sim_distance_m]
    terms: [{coefficient: 1.0, functions: [{column: sim_distance_m, kind: bit, at: 64.0, width: 5.0}]}]
"""


@pytest.mark.parametrize(
    ("model", "change", "words"),
    [
        (None, _rows(9), "model.yaml"),
        ("", _rows(9), "model.yaml"),
        ("schema: [", _rows(9), "model.yaml"),
        (
            MODEL.replace("timing.temperature_offset", "acme.nothing"),
            _rows(9),
            "'acme.nothing' is not in the library",
        ),
        (MODEL + OLD_BIT, _rows(9), "has two edges, not 0"),
        (MODEL, _without("tof_temperature_c"), "lacks column 'tof_temperature_c'"),
        (MODEL.replace("temperature: tof_temperature_c, ", ""), _rows(9), "needs 'temperature'"),
        (MODEL, _without("sim_distance_m", "sim_distance_m_std"), "lacks column 'sim_distance_m'"),
        (MODEL, lambda t: {"tof_temperature_c": t["tof_temperature_c"]}, "no channel"),
        (MODEL, _rows(0), "has no rows"),
        (MODEL, None, "no such file"),
    ],
)
def test_a_prediction_that_cannot_be_made_is_refused(tmp_path, model, change, words):
    there = ["d"]
    (tmp_path / "d").mkdir()
    if model is not None:
        (tmp_path / "d" / "model.yaml").write_text(model)
    if change is not None:
        pq.write_table(pa.table(change(table())), tmp_path / "t.parquet")
        there.append("t.parquet")
    result = CliRunner().invoke(
        predict_command, [str(tmp_path / "d"), str(tmp_path / "t.parquet"), "--out", str(tmp_path / "p.parquet")]
    )
    assert words in refused(result, tmp_path, *there)


def test_signals_that_underflow_count_as_none(tmp_path):
    """A beam's simulated wing may be 1e-310 counts: neither ratios to it nor its square may overflow."""
    columns = table()
    wing = columns["pixel_u"] >= 25
    columns["sim_intensity_counts"] = np.where(wing, 3e-311, columns["sim_intensity_counts"])
    columns["intensity_counts"] = np.where(wing, 0.0, 1.02 * columns["intensity_counts"])
    path = tmp_path / "wing.parquet"
    pq.write_table(pa.table(columns), path)
    result = run(path, tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "diagnosis.json").exists()
