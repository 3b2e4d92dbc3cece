"""`arl report`, `arl judge`, `arl history` as their user meets them."""

from __future__ import annotations

import csv
import io
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from report_samples import drifting, journal, one_step, step_id, step_of, value

from arl_fixtures.cli import arl
from arl_fixtures.errors import ConfigError, DataError, StorageError

LIMITS = """
name: strict
version: 2
limits:
  - {metric: power_change, unit: "%", lower: -0.05, upper: 0.05, reason: tighter than before}
"""


def run(*arguments: object) -> str:
    result = CliRunner().invoke(arl, [str(each) for each in arguments], catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


@pytest.fixture
def strict(tmp_path):
    path = tmp_path / "strict.yaml"
    path.write_text(LIMITS)
    return path


def test_report_writes_page_paper_and_test_results_and_names_them(tmp_path):
    path = one_step(tmp_path, 9.0, "FAIL")
    told = run("report", path, "--junit", tmp_path / "x" / "j.xml", "--allure", tmp_path / "allure").splitlines()
    assert [Path(line).name for line in told[:4]] == [
        "report-session-0001.html",
        "report-session-0001.pdf",
        "j.xml",
        "allure",
    ]
    assert all(Path(line).exists() for line in told[:4])
    assert told[4].startswith("FAIL: c0000-00-up+25C: SN-1 power_change")


def test_reports_of_the_same_journal_are_the_same_bytes(tmp_path):
    path = one_step(tmp_path, 9.0, "FAIL")
    for name in ("one", "two"):
        run("report", path, "--out", tmp_path / name)
    for file in (tmp_path / "one").iterdir():
        assert file.read_bytes() == (tmp_path / "two" / file.name).read_bytes()


def test_a_journal_cut_by_a_crash_still_makes_a_report(tmp_path):
    path = drifting(tmp_path, [0.0, 0.1])
    path.write_bytes(path.read_bytes()[:-10])
    assert run("report", path).splitlines()[-1] == "PASS"
    page = (tmp_path / "report-session-0001.html").read_text("utf-8")
    assert "The session has not ended" in page
    assert "of a torn last line are left out" in page


def test_several_cycles_from_several_folders_make_one_report(tmp_path):
    for cycle in range(2):
        name = step_id(cycle, 0, 25.0)
        lines = step_of(cycle, 0, 25.0, value(name, "SN-1", 0.1 * cycle))
        journal(tmp_path / str(cycle), lines, [name], cycles=[cycle])
    told = run("report", tmp_path / "0", tmp_path / "1", "--out", tmp_path)
    assert "report-cycles-0000-0001.pdf" in told
    assert "Trends over cycles" in (tmp_path / "report-cycles-0000-0001.html").read_text("utf-8")


def test_judging_anew_makes_a_new_journal_and_leaves_the_old_one(tmp_path, strict):
    path = one_step(tmp_path, 0.5, "PASS")
    before = path.read_bytes()
    told = run("judge", path, "--limits", strict)
    assert path.read_bytes() == before
    new = Path(told.splitlines()[0])
    assert "RE-JUDGEMENT" in told
    assert "FAIL (was PASS)" in told
    assert run("report", new).splitlines()[-1].startswith("FAIL")
    assert "RE-JUDGEMENT" in new.with_name(f"report-{new.stem}.html").read_text("utf-8")


def test_judging_twice_does_not_overwrite(tmp_path, strict):
    path = one_step(tmp_path, 0.5, "PASS")
    run("judge", path, "--limits", strict)
    with pytest.raises(StorageError, match="exists already"):
        run("judge", path, "--limits", strict)


def test_limits_of_a_metric_that_does_not_exist_are_refused(tmp_path, strict):
    strict.write_text(LIMITS.replace("power_change", "power_chnge"))
    with pytest.raises(ConfigError, match="no metric 'power_chnge'"):
        run("judge", one_step(tmp_path, 0.5, "PASS"), "--limits", strict)


def test_history_lists_values_of_all_journals_below(tmp_path):
    drifting(tmp_path / "a", [0.25, 0.5])
    told = run("history", tmp_path, "--metric", "power_change", "--step", step_id(1, 1, 25.0))
    assert told.count("SN-1") == 1
    assert "0.500" in told


def test_history_as_csv_holds_every_value(tmp_path):
    drifting(tmp_path, [0.25, 0.5, 0.75])
    rows = list(csv.DictReader(io.StringIO(run("history", tmp_path, "--csv", "--dut", "SN-1"))))
    assert [float(row["value"]) for row in rows] == [0.25, 0.25, 0.5, 0.5, 0.75, 0.75]
    assert {row["verdict"] for row in rows} == {"PASS"}


def test_history_gives_a_spreadsheet_no_formula(tmp_path):
    one_step(tmp_path, 0.5, "PASS", dut="=SUM(A1)")
    (row,) = csv.DictReader(io.StringIO(run("history", tmp_path, "--csv")))
    assert row["dut"] == "'=SUM(A1)"


def test_a_folder_without_journals_is_refused_by_all(tmp_path):
    for command in ("report", "history"):
        with pytest.raises(DataError, match="journal"):
            run(command, tmp_path)


def test_a_report_can_be_made_where_the_bags_are_gone(tmp_path):
    path = one_step(tmp_path / "there", 0.1, "PASS")
    shutil.copy(path, tmp_path)
    assert run("report", tmp_path / path.name).splitlines()[-1] == "PASS"
