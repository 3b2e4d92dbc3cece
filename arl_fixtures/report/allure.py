"""Allure results from a journal: one per planned step, with the same history id whenever they are made anew.

FAIL is failed, INVALID and NOT RUN are broken, nothing is ever skipped.
"""

from __future__ import annotations

import hashlib
import json
import uuid
from pathlib import Path
from typing import Any, Final

from arl_fixtures.files import write_whole
from arl_fixtures.journal.record import SessionRecord
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.report.steps import FUNCTION, MODULE, StepStory, step_stories
from arl_fixtures.report.text import shown

CATEGORIES: Final = (
    {"name": "Limit exceeded", "matchedStatuses": ["failed"]},
    {"name": "INVALID or NOT RUN: not measured or not to be trusted", "matchedStatuses": ["broken"]},
)
_SPACE: Final = uuid.UUID("7d0cbb8e-6f0e-5d0a-9c1e-9a8d3f6f2b11")


def write_allure(record: SessionRecord, folder: Path) -> None:
    """Write results, attachments, environment and categories; the same journal gives the same files.

    Raises:
        StorageError: they cannot be written.
    """
    for story in step_stories(record):
        identity = str(uuid.uuid5(_SPACE, f"{record.begin.campaign}/{record.path.name}/{story.step_id}"))
        table = f"{identity}-attachment.txt"
        write_whole(folder / table, (story.table(only_bad=False) + "\n").encode())
        write_whole(folder / f"{identity}-result.json", _json(_result(story, record, identity, table)))
    write_whole(folder / "environment.properties", _environment(record).encode())
    write_whole(folder / "categories.json", _json(CATEGORIES))


def _result(story: StepStory, record: SessionRecord, identity: str, table: str) -> dict[str, Any]:
    status = "passed" if story.passed else "failed" if story.verdict is Verdict.FAIL else "broken"
    start, stop = story.begin_utc_ns // 1_000_000, max(story.end_utc_ns, story.begin_utc_ns) // 1_000_000
    package, _, module = MODULE.rpartition(".")
    labels = {
        "parentSuite": package,
        "suite": module,
        "package": MODULE,
        "framework": "pytest",
        "language": "python",
        "tag": "re-judgement" if record.begin.rejudged_from else "cycle",
    }
    result: dict[str, Any] = {
        "uuid": identity,
        "historyId": hashlib.md5(f"{MODULE}#{story.name}".encode(), usedforsecurity=False).hexdigest(),
        "fullName": f"{MODULE}#{FUNCTION}",
        "name": story.name,
        "status": status,
        "stage": "finished",
        "start": start,
        "stop": stop,
        "labels": [{"name": name, "value": value} for name, value in labels.items()],
        "parameters": [{"name": name, "value": value} for name, value in story.properties],
        "steps": [
            _attempt(line, each.begin_utc_ns, each.end_utc_ns, each.verdict)
            for line, each in zip(story.attempt_lines, story.attempts, strict=True)
        ],
        "attachments": [{"name": "values and limits", "source": table, "type": "text/plain"}],
    }
    if not story.passed:
        result["statusDetails"] = {"message": story.message, "trace": story.table(only_bad=True)}
    return result


def _attempt(line: str, begin_ns: int, end_ns: int, verdict: str) -> dict[str, Any]:
    status = {"PASS": "passed", "CONDITIONAL": "passed", "FAIL": "failed"}.get(verdict, "broken")
    times = {"start": begin_ns // 1_000_000, "stop": max(end_ns, begin_ns) // 1_000_000}
    return {"name": line, "status": status, "stage": "finished", **times}


def _environment(record: SessionRecord) -> str:
    who = record.identity
    values = {
        "arl-fixtures": who.software_version,
        "journal": record.path.name,
        "rejudged_from": record.begin.rejudged_from,
        "bench": f"{who.bench_name} {who.bench_sha256}",
        "profile": f"{who.profile_name} {who.profile_sha256}",
        "limits": f"{who.limits_name} {who.limits_sha256}",
        "DUTs": ", ".join(dut.serial for dut in who.duts),
    }
    # a backslash begins an escape in a properties file
    lines = (f"{name}={shown(value)}".replace("\\", "\\\\") for name, value in values.items() if value)
    return "\n".join(lines) + "\n"


def _json(content: object) -> bytes:
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()
