"""Rows to predict without surroundings: the table that was reconciled lends them, where it is the same record."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile
from arl_fixtures.reconcile.context import CONTEXT_FILE, beside, read_context, write_context
from arl_fixtures.reconcile.effects_illumination import illumination
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.view import View

TAU_S = 900.0


def lagging(columns, rng):
    """The board's delay follows the housing slowly: marched second by second, per cycle."""
    for dut in np.unique(columns["dut"]):
        mine = columns["dut"] == dut
        time, first = np.unique(columns["time_s"][mine], return_index=True)
        housing = columns["housing_temperature_c"][mine][first]
        fine = np.arange(time[0], time[-1] + 1.0)
        outside = np.interp(fine, time, housing)
        board = np.empty_like(outside)
        board[0] = outside[0]
        for k in range(1, fine.size):
            board[k] = board[k - 1] + (outside[k] - board[k - 1]) / TAU_S
        delay_m = 4e-5 * (board - outside)
        columns["distance_m"][mine] += np.interp(columns["time_s"][mine], fine, delay_m)


def late_frames(columns, rng):
    """A share of each frame's exposure lies before the stage stopped: the angle before, pixel by pixel."""
    pixels = columns["pixel_u"] * 1000.0 + columns["pixel_v"]
    order = np.lexsort((columns["stage_angle_deg"], pixels, columns["step"], columns["dut"]))
    light = columns["intensity_counts"][order].copy()
    first = np.r_[True, np.diff(columns["stage_angle_deg"][order]) < 0.0]
    before = np.where(first, light, np.roll(light, 1))
    columns["intensity_counts"][order] = 0.85 * light + 0.15 * before


def split(table, held):
    simulated = {n: v[held] for n, v in table.items() if n not in {"intensity_counts", "distance_m"}}
    return {n: v[~held] for n, v in table.items()}, simulated


def explained(table, plain, held, corrected, channel):
    """Share of the true change that a prediction makes."""
    truth, sim = table[channel][held] - plain[channel][held], table[f"sim_{channel}"][held]
    return 1.0 - np.sum((corrected - sim - truth) ** 2) / np.sum(truth**2)


@pytest.mark.parametrize(
    ("change", "column", "value", "channel", "unasked", "steps"),
    [
        (lagging, "step", 5.0, "distance_m", "intensity_counts", 14),
        (late_frames, "stage_angle_deg", 8.1, "intensity_counts", "distance_m", 4),
    ],
)
def test_rows_of_one_step_or_angle_are_predicted_from_what_was_around_them(
    tmp_path, make_table, save, knows_only, change, column, value, channel, unasked, steps
):
    knows_only("timing.thermal_lag", "timing.temperature_offset", "acquisition.frame_lag", "optics.defocus")
    table, plain = (
        {name: x for name, x in make_table(21, own, steps=steps).items() if unasked not in name}
        for own in (change, None)
    )
    held = np.isclose(table[column], value)
    train, unseen = split(table, held)
    reconcile(save(tmp_path / "t.parquet", train), tmp_path / "out")
    told = []
    for folder in ("with", "without"):
        if folder == "without":
            (tmp_path / "out" / CONTEXT_FILE).unlink()
        predict(tmp_path / "out", save(tmp_path / "u.parquet", unseen), tmp_path / "p.parquet")
        corrected = pq.read_table(tmp_path / "p.parquet")[f"corrected_{channel}"].to_numpy()
        told.append(explained(table, plain, held, corrected, channel))
    assert told[0] > 0.7
    assert told[1] < 0.1


def test_no_context_of_an_earlier_answer_is_left_beside_a_new_one(tmp_path, make_table, save):
    out = tmp_path / "out"
    out.mkdir()
    (out / CONTEXT_FILE).write_bytes(b"of another table")
    assert reconcile(save(tmp_path / "t.parquet", make_table(1, duts=1, steps=6)), out).verdict == "consistent"
    assert not (out / CONTEXT_FILE).exists()


def kept(folder, table):
    write_context(folder / CONTEXT_FILE, columns_of(pa.table(table)))
    return read_context(folder)


def test_a_context_holds_no_measured_value(tmp_path, make_table):
    context = kept(tmp_path, make_table(3))
    assert not np.isfinite(context.numbers["intensity_counts"]).any()
    assert "intensity_counts" not in pq.read_schema(tmp_path / CONTEXT_FILE).names


def test_rows_that_are_kept_and_asked_for_stand_once(tmp_path, make_table):
    table = make_table(3)
    context = kept(tmp_path, table)
    half = columns_of(pa.table({n: v[::2] for n, v in table.items()}), for_prediction=True)
    together = beside(half, context)
    assert together.n == len(table["dut"])
    assert np.all(together.record == 0)
    for name in ("sim_distance_m", "housing_temperature_c"):
        assert np.array_equal(together.numbers[name][: half.n], half.numbers[name])
        assert np.array_equal(np.sort(together.numbers[name]), np.sort(table[name]))


def hotter(table):
    table["set_temperature_c"] += 60.0
    table["housing_temperature_c"] += 60.0
    table["stage_angle_deg"] += 1.0


def shifted_steps(table):
    table["step"] += 40.0
    table["stage_angle_deg"] += 1.0


def other_ranges(table):
    table["sim_distance_m"] *= 1.1


@pytest.mark.parametrize("changed", [hotter, shifted_steps, other_ranges])
def test_another_run_under_the_same_labels_is_another_record(tmp_path, make_table, changed):
    """The devices' scene and rays are shared, neighbours in image, sweep and time are not."""
    context = kept(tmp_path, make_table(3))
    table = make_table(4)
    table["housing_temperature_c"] = make_table(3)["housing_temperature_c"]
    changed(table)
    columns = columns_of(pa.table(table), for_prediction=True)
    together = beside(columns, context)
    own = np.arange(together.n) < columns.n
    assert np.array_equal(together.record, (~own).astype(int))
    for names in (("dut", "cycle"), together.image_columns):
        code = together.group(*names)
        assert not set(code[own]) & set(code[~own])
    lines = together.group("dut", "pixel_v")
    assert set(lines[own]) == set(lines[~own])


@pytest.mark.parametrize("another", [False, True])
def test_without_steps_the_course_of_the_temperature_tells_runs_apart(tmp_path, make_table, another):
    """Every other row of one run belongs to it; another run warms up at other times."""
    table = {
        n: v for n, v in make_table(3, duts=1).items() if n not in {"step", "cycle", "ramp", "set_temperature_c"}
    }
    held = np.arange(len(table["time_s"])) % 2 == 1
    train, unseen = split(table, held)
    if another:
        unseen["time_s"] = unseen["time_s"] + 2000.0
    together = beside(columns_of(pa.table(unseen), for_prediction=True), kept(tmp_path, train))
    own = np.arange(together.n) < np.sum(held)
    assert np.all(together.record == (~own if another else 0))


def test_steps_left_out_of_a_record_belong_to_it(tmp_path, make_table):
    table = make_table(3)
    held = np.isin(table["step"], (4.0, 9.0))
    train, unseen = split(table, held)
    together = beside(columns_of(pa.table(unseen), for_prediction=True), kept(tmp_path, train))
    assert np.all(together.record == 0)
    assert together.n == len(held)


@pytest.mark.parametrize("again", [False, True])
def test_the_beam_that_a_model_was_found_with_is_the_one_it_is_used_with(tmp_path, make_table, again):
    """Rows before boards that get darker downwards would bend the profile which the wall shows."""
    table = make_table(3)
    down = (table["pixel_v"] - table["pixel_v"].min()) / np.ptp(table["pixel_v"])
    boards = []
    for turn, grey in ((90.0, 0.5), (120.0, 0.8), (150.0, 1.1)):
        board = {n: v.copy() for n, v in table.items()} | {"stage_angle_deg": table["stage_angle_deg"] + turn}
        board["sim_intensity_counts"] *= np.exp(-grey * down**2)
        boards.append(board)
    other = {n: np.concatenate([*(b[n] for b in boards), *([v[::3]] if again else [])]) for n, v in table.items()}
    context = kept(tmp_path, table)
    found = illumination(View(context), "intensity_counts")
    used = illumination(View(beside(columns_of(pa.table(other), for_prediction=True), context)), "intensity_counts")
    assert used.terms == found.terms
    assert used.coefficients == pytest.approx(found.coefficients, abs=1e-9)
