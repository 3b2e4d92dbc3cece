"""JUnit XML from a journal: FAIL is a failure, INVALID and NOT RUN are errors, and nothing is ever a skip."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from datetime import UTC, datetime

from arl_fixtures.journal.record import SessionRecord
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.report.steps import MODULE, StepStory, step_stories
from arl_fixtures.report.text import shown


def junit_xml(records: Sequence[SessionRecord]) -> bytes:
    """A test suite for each session with a case for each planned step, as pytest names them.

    The same journals give the same bytes. Texts are free of control characters, which XML cannot hold.
    """
    root = ET.Element("testsuites", name="arl")
    root.extend(_suite(record) for record in records)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _suite(record: SessionRecord) -> ET.Element:
    stories = list(step_stories(record))
    begin_ns = record.lines[0].utc_ns
    suite = ET.Element(
        "testsuite",
        name=shown(f"{record.begin.campaign} {record.path.name}"),
        errors=str(sum(not each.passed and each.verdict is not Verdict.FAIL for each in stories)),
        failures=str(sum(each.verdict is Verdict.FAIL for each in stories)),
        skipped="0",
        tests=str(len(stories)),
        time=f"{(record.lines[-1].utc_ns - begin_ns) / 1e9:.3f}",
        timestamp=datetime.fromtimestamp(begin_ns // 1_000_000_000, UTC).isoformat(),
    )
    _add_properties(suite, _session_properties(record))
    for story in stories:
        suite.append(_case(story))
    return suite


def _session_properties(record: SessionRecord) -> list[tuple[str, str]]:
    who = record.identity
    found = [
        ("journal", record.path.name),
        ("rejudged_from", record.begin.rejudged_from),
        ("duts", ", ".join(dut.serial for dut in who.duts)),
        ("bench", f"{who.bench_name} {who.bench_sha256}"),
        ("profile", f"{who.profile_name} {who.profile_sha256}"),
        ("limits", f"{who.limits_name} {who.limits_sha256}"),
        ("software", who.software_version),
    ]
    return [(name, shown(value)) for name, value in found if value]


def _add_properties(parent: ET.Element, properties: list[tuple[str, str]]) -> None:
    holder = ET.SubElement(parent, "properties")
    for name, value in properties:
        ET.SubElement(holder, "property", name=name, value=value)


def _case(story: StepStory) -> ET.Element:
    seconds = max(story.end_utc_ns - story.begin_utc_ns, 0) / 1e9
    case = ET.Element("testcase", classname=MODULE, name=story.name, time=f"{seconds:.3f}")
    _add_properties(case, list(story.properties))
    if not story.passed:
        kind = "failure" if story.verdict is Verdict.FAIL else "error"
        told = ET.SubElement(case, kind, message=story.message, type=story.verdict.value)
        told.text = f"{story.message}\n{story.table(only_bad=True)}"
    if story.attempt_lines:
        ET.SubElement(case, "system-out").text = "\n".join(story.attempt_lines)
    return case
