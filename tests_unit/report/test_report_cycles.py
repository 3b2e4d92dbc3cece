"""What a report says of cycles: verdicts, what decided, attempts, trends."""

from __future__ import annotations

import hashlib
from datetime import date

import numpy as np
import pytest
from report_samples import HOSTILE, NO_MAPS, drifting, journal, limit, one_step, report_of, step_id, step_of, value

from arl_fixtures.errors import DataError
from arl_fixtures.journal import entries as said
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.report.blocks import Facts, Section, Table, Text
from arl_fixtures.report.cycles import load_cycles
from arl_fixtures.report.document import make_report
from arl_fixtures.report.over_cycles import stress_of
from arl_fixtures.report.results import result_rows
from arl_fixtures.report.sections import calibration_state
from arl_fixtures.report.series import correlations, series_over
from arl_fixtures.report.text import rounded, shown, value_text

STEP = step_id(0, 0, 25.0)


def texts(section: Section) -> str:
    parts = []
    for block in section.blocks:
        if isinstance(block, Text):
            parts.append(block.text)
        if isinstance(block, Table):
            parts += [block.title, block.note, *(cell.text for row in block.rows for cell in row)]
    return "\n".join(parts)


def section(report, title):
    (found,) = [each for each in report.sections if each.title == title]
    return found


@pytest.mark.parametrize(
    ("number", "verdict"),
    [(0.1, "PASS"), (0.99, "CONDITIONAL"), (1.7, "FAIL"), (None, "INVALID"), (None, "NOT_RUN")],
)
def test_a_cycle_has_the_verdict_of_its_worst_step_and_says_what_decided(tmp_path, number, verdict):
    report = report_of(one_step(tmp_path, number, verdict, reason="because of this"))
    assert report.verdict.text == verdict.replace("_", " ")
    assert ("because of this" in report.decided_by) == (verdict != "PASS")
    assert (STEP in report.decided_by) == (verdict != "PASS")


def test_what_is_signed_stands_with_the_signatures(tmp_path):
    path = one_step(tmp_path, 1.7, "FAIL")
    signed = next(block for block in section(report_of(path), "Signatures").blocks if isinstance(block, Facts))
    said = {title: cell.text for title, cell in signed.rows}
    assert said["Verdict"] == "FAIL"
    assert said["Signed for"].startswith("SN-1")
    assert hashlib.sha256(path.read_bytes()).hexdigest() in said["Journal"]


def test_what_failed_in_an_earlier_cycle_is_told_in_the_report_of_a_later_one(tmp_path):
    lines, plan = [], []
    for cycle, (number, verdict) in enumerate([(0.0, "PASS"), (7.0, "FAIL"), (0.0, "PASS")]):
        plan.append(step_id(cycle, 0, 25.0))
        lines += step_of(cycle, 0, 25.0, value(plan[-1], "SN-1", number, verdict), verdict)
    report = report_of(journal(tmp_path, lines, plan, cycles=range(3)))
    assert report.verdict.text == "FAIL"
    assert report.decided_by.startswith(f"cycle 1, {plan[1]}: SN-1 power_change")
    assert "(7.000 ± 0.020) %" in texts(section(report, "Cycle 1: what is not PASS, and why"))
    assert not [each for each in report.sections if each.title.startswith("Cycle 0")]


def test_a_later_pass_does_not_hide_an_earlier_fail(tmp_path):
    lines = step_of(0, 0, 25.0, value(STEP, "SN-1", 3.0, "FAIL"), "FAIL")
    lines += step_of(0, 0, 25.0, value(STEP, "SN-1", 0.0, attempt=2), attempt=2)
    (cycle,) = load_cycles([journal(tmp_path, lines, [STEP])])
    assert cycle.verdict is Verdict.FAIL
    (row,) = result_rows(cycle.finished)
    assert row.counts == {Verdict.FAIL: 1, Verdict.PASS: 1}


def test_a_step_never_begun_is_not_run_and_decides(tmp_path):
    plan = [STEP, step_id(0, 1, 30.0)]
    path = journal(tmp_path, step_of(0, 0, 25.0, value(STEP, "SN-1", 0.0)), plan, ended=False)
    report = report_of(path)
    assert report.verdict.text == "NOT RUN"
    assert report.decided_by == f"{plan[1]}: never begun"
    assert "the session never came to it" in texts(section(report, "What is not PASS, and why"))
    assert "has not ended" in texts(section(report, "Events"))


def test_every_attempt_that_broke_off_is_listed_with_its_reason(tmp_path):
    lines = step_of(0, 0, 25.0, [], "INVALID", finished=False, reason="stage: no answer within 2 s")
    lines += step_of(0, 0, 25.0, value(STEP, "SN-1", 0.0, attempt=2), attempt=2)
    report = report_of(journal(tmp_path, lines, [STEP]))
    assert report.verdict.text == "PASS"
    assert "stage: no answer within 2 s" in texts(section(report, "What is not PASS, and why"))


def test_the_reference_sweep_decides_nothing(tmp_path):
    reference = said.StepBegin(
        step_id="c0000-reference+25C", attempt=1, cycle=0, step_index=-1, set_temperature_c=25.0, ramp=1
    )
    end = said.StepEnd(
        step_id="c0000-reference+25C", attempt=1, finished=True, verdict="NOT_RUN", reason="no reference"
    )
    lines = [reference, end, *step_of(0, 0, 25.0, value(STEP, "SN-1", 0.0))]
    assert report_of(journal(tmp_path, lines, [STEP])).verdict.text == "PASS"


def test_it_is_told_what_each_dut_s_changes_are_against(tmp_path):
    lines = step_of(
        0,
        0,
        25.0,
        [
            *value(STEP, "SN-1", 0.1, reference="cycle 0, before its first step, 25 degC"),
            *value(STEP, "SN-1", 0.1, metric="power_worst_3x3", reference="cycle 0, before its first step, 25 degC"),
            *value(STEP, "SN-2", 0.1),
        ],
    )
    report = report_of(journal(tmp_path, lines, [STEP], duts=["SN-1", "SN-2"]))
    duts = next(block for block in section(report, "Identity").blocks if isinstance(block, Table))
    column = duts.header.index("Changes are against")
    assert [row[column].text for row in duts.rows] == ["cycle 0, before its first step, 25\u00a0°C", "–"]


def test_of_a_limit_s_values_the_one_nearest_to_it_is_shown(tmp_path):
    lines, plan = [], []
    for index, number in enumerate((0.1, -0.8, 0.5)):
        plan.append(step_id(0, index, 20.0 + index))
        lines += step_of(0, index, 20.0 + index, value(plan[-1], "SN-1", number))
    (cycle,) = load_cycles([journal(tmp_path, lines, plan)])
    (row,) = result_rows(cycle.finished)
    assert row.telling.measurement.value == -0.8
    assert row.range == (-0.8, 0.5)
    assert row.telling.margin == pytest.approx(0.2 / (1.984 * 0.01), rel=1e-3)


def test_values_are_shown_in_the_limit_s_unit(tmp_path):
    held = limit(unit="1", lower=-0.01, upper=0.01)
    lines = step_of(0, 0, 25.0, value(STEP, "SN-1", 0.5, held=held))
    (cycle,) = load_cycles([journal(tmp_path, lines, [STEP])])
    (row,) = result_rows(cycle.finished)
    assert row.range == pytest.approx((0.005, 0.005))
    assert value_text(row.telling.measurement, "1") == "0.00500 ± 0.00020"


@pytest.mark.parametrize(
    ("due", "url", "tone"),
    [
        ("2026-03-01", "serial:///dev/x", "pass"),
        ("2026-01-01", "serial:///dev/x", "pass"),
        ("2025-12-31", "serial:///dev/x", "fail"),
        ("", "serial:///dev/x", "conditional"),
        ("2026-13-01", "serial:///dev/x", "conditional"),
        ("", "emulated", ""),
    ],
)
def test_an_instrument_whose_calibration_ran_out_before_the_end_is_flagged(due, url, tone):
    state = calibration_state(due, url, date(2026, 1, 1))
    assert state.tone == tone
    assert ("EXPIRED" in state.text) == (tone == "fail")


def test_a_rejudgement_says_so_at_the_top(tmp_path):
    lines = step_of(0, 0, 25.0, value(STEP, "SN-1", 0.0))
    report = report_of(journal(tmp_path, lines, [STEP], rejudged_from="session-0001.jsonl", name="session-9.jsonl"))
    assert report.banner.startswith("RE-JUDGEMENT: the measurements of session-0001.jsonl")


def test_faults_alarms_and_safe_stops_are_told_in_order(tmp_path):
    stop = said.SafeStop(cause="T3 above 90 °C", actions=(said.SafeAction(name="laser off", verified=False),))
    lines = [
        said.Fault(device="stage", message="no answer", action="retried"),
        said.Alarm(source="guard", condition="T3 above 90 °C", value=91.5, unit="degC", action="safe state"),
        stop,
    ]
    report = report_of(journal(tmp_path, [*lines, *step_of(0, 0, 25.0, value(STEP, "SN-1", 0.0))], [STEP]))
    told = texts(section(report, "Events"))
    assert "is not acknowledged: T3 above 90 °C" in told
    places = [
        told.index(text) for text in ("stage: no answer; retried", "at 91.5 °C; safe state", "laser off NOT VERIFIED")
    ]
    assert places == sorted(places)


def test_journals_of_different_duts_are_not_mixed(tmp_path):
    one_step(tmp_path / "a", 0.0, "PASS", dut="SN-1")
    one_step(tmp_path / "b", 0.0, "PASS", dut="SN-2")
    with pytest.raises(DataError, match="is of DUTs SN-2"):
        load_cycles([tmp_path / "a", tmp_path / "b"])


def test_a_folder_without_a_journal_is_refused(tmp_path):
    with pytest.raises(DataError, match="neither a journal nor a folder with one"):
        load_cycles([tmp_path])


def test_a_folder_counts_its_sessions_and_not_its_rejudgements(tmp_path):
    path = one_step(tmp_path, 0.0, "PASS")
    path.with_name("session-0001-rejudged-new-v1.jsonl").write_bytes(path.read_bytes())
    assert [cycle.record.path for cycle in load_cycles([tmp_path])] == [path]


def test_a_drift_is_found_and_its_limit_foretold(tmp_path):
    rng = np.random.default_rng(1)
    drift = [-0.02 * cycle + float(rng.normal(0, 0.004)) for cycle in range(10)]
    (series,) = series_over(load_cycles([drifting(tmp_path, drift)]), [25.0])
    assert series.trend is not None
    assert series.bound == -1.0
    assert series.crossing.earliest < 50.0 < series.crossing.latest
    told = texts(section(report_of(tmp_path / "session-0001.jsonl"), "Trends over cycles"))
    assert "power_change" in told
    assert "straight line" in told


def test_noise_is_no_trend(tmp_path):
    rng = np.random.default_rng(2)
    path = drifting(tmp_path, rng.normal(0, 0.01, 8).tolist())
    assert "No trend in any of 2 values" in texts(section(report_of(path), "Trends over cycles"))


def test_too_few_cycles_are_not_called_free_of_trends(tmp_path):
    path = drifting(tmp_path, [0.0, -0.04, -0.07])
    told = texts(section(report_of(path), "Trends over cycles"))
    assert "No trend can be told yet: values of 3 cycles." in told
    assert "No trend in any" not in told


def test_a_trend_in_the_cold_alone_is_found_and_drawn(tmp_path):
    rng = np.random.default_rng(4)
    lines, plan = [], []
    for cycle in range(10):
        for index, (temperature_c, drift) in enumerate(((-10.0, -0.02), (25.0, 0.0))):
            name = step_id(cycle, index, temperature_c)
            plan.append(name)
            number = drift * cycle + float(rng.normal(0, 0.004))
            lines += step_of(cycle, index, temperature_c, value(name, "SN-1", number))
    report = report_of(journal(tmp_path, lines, plan, cycles=range(10)))
    (row,) = next(block for block in section(report, "Trends over cycles").blocks if isinstance(block, Table)).rows
    assert row[2].text == "-10\u00a0°C"
    assert {"trends-1-1.svg", "trends-2-1.svg"} <= set(report.pictures)


def test_two_cycles_are_too_few_for_a_trend_and_said_so(tmp_path):
    told = texts(section(report_of(drifting(tmp_path, [0.0, -0.5])), "Trends over cycles"))
    assert "No trend" in told
    assert "at least 4 cycles" in told


def test_stress_is_what_the_housing_s_sensor_saw(tmp_path):
    stress = stress_of(load_cycles([drifting(tmp_path, [0.0, 0.1])]), 0)
    assert stress.swings_k == pytest.approx((35.0, 35.0))
    # the second DUT's housing has no sensor here: its set temperatures stand for it
    assert stress_of(load_cycles([tmp_path]), 1).dwell[0][1] == -10.0


def test_an_operating_signal_that_follows_a_metric_is_found(tmp_path):
    rng = np.random.default_rng(3)
    lines, plan = [], []
    for cycle in range(30):
        name = step_id(cycle, 0, 25.0)
        plan.append(name)
        hidden = float(rng.normal())
        cold = value(name, "SN-1", hidden + 3.0, metric="focal_length", scope="fx")
        change = value(name, "SN-1", hidden, metric="focal_length_change", scope="fx")
        twin = value(name, "SN-1", hidden, metric="twin_distance_bias", scope="stripe_50")
        current = value(name, "SN-1", hidden + float(rng.normal(0, 0.1)), metric="operating", scope="laser_current_a")
        idle = value(name, "SN-1", float(rng.normal()), metric="operating", scope="rail_5v0_v")
        performance = [*value(name, "SN-1", hidden), *cold, *change, *twin]
        lines += step_of(cycle, 0, 25.0, [*performance, *current, *idle])
    path = journal(tmp_path, lines, plan, cycles=range(30))
    cycles = load_cycles([path])
    pairs = correlations([attempt for cycle in cycles for attempt in cycle.finished], "SN-1")
    # a change says what the value itself says, and the twin's agreement is no performance
    assert {pair.metric for pair in pairs} == {"power_change", "focal_length[fx]"}
    assert all((pair.q < 1e-6) is (pair.signal == "laser_current_a") for pair in pairs)
    report = make_report(cycles, NO_MAPS)
    told = texts(section(report, "Operating signals and performance"))
    assert "Nothing to correlate over the steps of cycle 29" in told
    assert "over the steps of all 30 cycles (30 steps, 4 pairs)" in told
    assert "foretelling-2-1.svg" in report.pictures


def test_what_the_temperature_explains_foretells_nothing(tmp_path):
    rng = np.random.default_rng(8)
    lines, plan = [], []
    for index, temperature_c in enumerate(np.linspace(-10.0, 85.0, 39)):
        name = step_id(0, index, temperature_c)
        plan.append(name)
        level = value(name, "SN-1", 0.01 * temperature_c + float(rng.normal(0, 0.01)), metric="power_level")
        volts = 0.1 * temperature_c + float(rng.normal(0, 0.1))
        rail = value(name, "SN-1", volts, metric="operating", scope="rail_v")
        lines += step_of(0, index, temperature_c, [*level, *rail])
    (cycle,) = load_cycles([journal(tmp_path, lines, plan)])
    (pair,) = correlations(list(cycle.finished), "SN-1")
    assert abs(pair.rho) < 0.5
    assert pair.q > 0.05


def test_what_would_not_be_seen_is_spelt_out():
    assert shown("SN\u202e1\x1b\n") == "SN\\u202e1\\x1b\\x0a"
    assert not set(shown(HOSTILE)) & {"\n", "\x1b", "\u202e"}
    assert len(shown("x" * 100_000)) < 1000


@pytest.mark.parametrize(
    ("number", "half", "text"),
    [
        (-0.00123, 0.5, "0.00 ± 0.50"),
        (12345.678, 123.0, "12346 ± 123"),
        (1.23456, 0.0, "1.23456"),
        (float("nan"), 1.0, "nan"),
        (0.99996, 0.00012, "0.99996 ± 0.00012"),
    ],
)
def test_numbers_are_rounded_to_what_their_interval_tells(number, half, text):
    assert rounded(number, half) == text
