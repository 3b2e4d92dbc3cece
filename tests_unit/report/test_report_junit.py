"""JUnit and Allure from a journal: FAIL fails, INVALID and NOT RUN are errors, nothing is skipped."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from report_samples import HOSTILE, journal, one_step, step_id, step_of, value

from arl_fixtures.journal.record import read_journal
from arl_fixtures.report.allure import write_allure
from arl_fixtures.report.junit import junit_xml

VERDICTS = ("PASS", "CONDITIONAL", "FAIL", "INVALID", "NOT_RUN")


@pytest.fixture
def session(tmp_path):
    lines, plan = [], []
    for index, verdict in enumerate(VERDICTS):
        plan.append(step_id(0, index, 20.0 + index))
        number = None if verdict in {"INVALID", "NOT_RUN"} else 5.0
        values = value(plan[-1], "SN-1", number, verdict, reason=f"why {verdict}")
        lines += step_of(0, index, 20.0 + index, values, verdict, reason=f"why {verdict}")
    plan.append(step_id(0, 9, 60.0))
    return read_journal(journal(tmp_path, lines, plan))


def cases(*records):
    root = ET.fromstring(junit_xml(records))
    return root, root.findall("testsuite/testcase")


def test_each_verdict_has_its_outcome(session):
    _, found = cases(session)
    kinds = [[child.tag for child in case if child.tag in {"failure", "error", "skipped"}] for case in found]
    assert kinds == [[], [], ["failure"], ["error"], ["error"], ["error"]]


def test_counts_of_the_suite_are_those_of_its_cases(session):
    root, found = cases(session)
    (suite,) = root
    counted = {tag: sum(case.find(tag[:-1]) is not None for case in found) for tag in ("failures", "errors")}
    assert {tag: int(suite.get(tag)) for tag in counted} == counted == {"failures": 1, "errors": 3}
    assert int(suite.get("tests")) == len(found) == 6
    assert suite.get("skipped") == "0"


def test_elements_are_those_of_the_junit_format_in_their_order(session):
    root, found = cases(session)
    assert root.tag == "testsuites"
    assert [child.tag for child in root[0]][:1] == ["properties"]
    order = ["properties", "error", "failure", "system-out"]
    for case in found:
        places = [order.index(child.tag) for child in case]
        assert places == sorted(places)
        assert case.get("classname")
        assert case.get("name")
        assert float(case.get("time")) >= 0.0
    assert len({case.get("name") for case in found}) == len(found)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", root[0].get("timestamp"))


def test_a_failure_brings_its_values_and_limits(session):
    _, found = cases(session)
    told = found[2].find("failure")
    assert told.get("message") == "FAIL: SN-1 power_change: why FAIL"
    assert re.search(r"power_change +\(5\.000 ± 0\.020\) % +-1 … 1 % +FAIL", told.text)


def test_every_attempt_is_told(tmp_path):
    name = step_id(0, 0, 25.0)
    lines = step_of(0, 0, 25.0, [], "INVALID", finished=False, reason="stage lost")
    lines += step_of(0, 0, 25.0, value(name, "SN-1", 0.0, attempt=2), attempt=2)
    _, (case,) = cases(read_journal(journal(tmp_path, lines, [name])))
    assert case.find("error") is None
    assert case.find("system-out").text.splitlines() == ["attempt 1: INVALID (stage lost)", "attempt 2: PASS"]


def test_hostile_texts_make_no_elements_and_no_control_characters(tmp_path):
    record = read_journal(one_step(tmp_path, 9.0, "FAIL", dut=HOSTILE, reason=HOSTILE, campaign=HOSTILE))
    text = junit_xml([record]).decode()
    assert "<script" not in text
    assert not re.search(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", text)
    assert {each.tag for each in ET.fromstring(text).iter()} <= {
        "testsuites", "testsuite", "properties", "property", "testcase", "failure", "system-out",
    }  # fmt: skip


def test_a_rejudgement_is_named_in_every_message(tmp_path):
    name = step_id(0, 0, 25.0)
    lines = step_of(0, 0, 25.0, value(name, "SN-1", 5.0, "FAIL"), "FAIL")
    record = read_journal(journal(tmp_path, lines, [name], rejudged_from="session-0001.jsonl", name="r.jsonl"))
    _, (case,) = cases(record)
    assert case.find("failure").get("message").startswith("re-judgement of session-0001.jsonl: FAIL")


def test_several_sessions_are_several_suites(session):
    root, found = cases(session, session)
    assert len(root) == 2
    assert len(found) == 12


def results(folder: Path):
    found = [json.loads(path.read_text("utf-8")) for path in folder.glob("*-result.json")]
    return sorted(found, key=lambda each: each["name"])


def test_allure_results_have_the_status_of_the_verdict_and_whole_attachments(session, tmp_path):
    write_allure(session, tmp_path / "allure")
    found = results(tmp_path / "allure")
    assert [each["status"] for each in found] == ["passed", "passed", "failed", "broken", "broken", "broken"]
    for each in found:
        assert each["start"] <= each["stop"]
        for attachment in each["attachments"]:
            assert (tmp_path / "allure" / attachment["source"]).is_file()
        assert ("statusDetails" in each) == (each["status"] != "passed")


def test_allure_results_made_twice_are_the_same_files(session, tmp_path):
    for name in ("one", "two"):
        write_allure(session, tmp_path / name)
    files = [{path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("one", "two")]
    assert files[0] == files[1]


def test_allure_environment_stays_one_line_a_value(tmp_path):
    record = read_journal(one_step(tmp_path, 9.0, "FAIL", dut=HOSTILE))
    write_allure(record, tmp_path / "allure")
    lines = (tmp_path / "allure" / "environment.properties").read_text("utf-8").splitlines()
    assert [line.partition("=")[0] for line in lines] == [
        "arl-fixtures", "journal", "bench", "profile", "limits", "DUTs",
    ]  # fmt: skip
