from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import journal_samples as sample
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arl_fixtures.errors import StorageError, UnitError
from arl_fixtures.journal import entries as said
from arl_fixtures.journal.bridge import measurement_entry, measurement_of, result_entries
from arl_fixtures.journal.index import history, rebuild
from arl_fixtures.journal.journal import Journal
from arl_fixtures.journal.rejudge import rejudge
from arl_fixtures.journal.resume import newest_journal
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.judge import judge
from arl_fixtures.metrics.limits import LimitSet
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.quantity import Contribution, Kind, Quantity

MakeJournal = Callable[..., Path]
STEP = sample.PLAN[0]


def limits(upper: float, unit: str = "mm", name: str = "tight") -> LimitSet:
    return LimitSet.model_validate(
        {
            "name": name,
            "version": 2,
            "decision": {"rule": "simple"},
            "limits": [
                {
                    "metric": "distance_error",
                    "unit": unit,
                    "lower": -upper,
                    "upper": upper,
                    "reason": "test",
                    "where": {"dut_type": ["hfl110"]},
                }
            ],
        }
    )


positive = st.floats(1e-9, 1e9)


@given(
    value=st.floats(allow_nan=False),
    unit=st.sampled_from(["m", "counts", "px", "", "°C"]),
    parts=st.lists(
        st.tuples(st.text(max_size=8), positive, st.sampled_from(Kind), st.one_of(positive, st.just(math.inf))),
        max_size=3,
    ),
    scope=st.text(max_size=8),
)
def test_a_measurement_loses_nothing_on_its_way(
    value: float, unit: str, parts: list[tuple[str, float, Kind, float]], scope: str
) -> None:
    quantity = Quantity.of(value, unit, *(Contribution(*part) for part in parts))
    for one in (
        Measurement(metric="m", dut="SN-1", scope=scope, quantity=quantity, reason="remark", reference="c0"),
        Measurement(metric="m", dut="SN-1", scope=scope, reason="open sensor", attempted=False),
    ):
        entry = measurement_entry(STEP, 1, one)
        read = said.ENTRY.validate_json(entry.model_dump_json())
        assert isinstance(read, said.Measurement)
        assert measurement_of(read) == one


def test_results_hold_each_measurement_once_and_each_judgement() -> None:
    conditions = Conditions(set_temperature_c=-10.0)
    value = Measurement(metric="distance_error", dut="SN-1", quantity=Quantity(0.012, "m", 0.001))
    other = Measurement(metric="noise", dut="SN-1", quantity=Quantity(0.2, "counts"))
    twice = limits(20).model_copy(update={"limits": (*limits(20).limits, *limits(5).limits)})
    judgements = judge([value, other], twice, conditions, {"SN-1": "hfl110"})
    entries = result_entries(STEP, 1, judgements, twice)
    assert [entry.metric for entry in entries if isinstance(entry, said.Measurement)] == ["distance_error", "noise"]
    verdicts = [entry.verdict for entry in entries if isinstance(entry, said.Judgement) and entry.limit]
    assert verdicts == ["PASS", "FAIL"]


@pytest.mark.parametrize(("upper_mm", "verdict"), [(20.0, "PASS"), (5.0, "FAIL")])
def test_old_measurements_are_judged_by_new_limits(
    upper_mm: float, verdict: str, make_journal: MakeJournal, tmp_path: Path
) -> None:
    old_verdict = "PASS" if verdict == "FAIL" else "FAIL"
    part = sample.attempt(0, 1, old_verdict)
    entries = [entry for entry in part if getattr(entry, "dut", "") != "SN-2"]
    before = Journal.read(make_journal(*entries, said.SessionEnd(reason="finished", verdict=old_verdict)))
    text = before.path.read_bytes()
    after = rejudge(before, limits(upper_mm), "9" * 64)

    assert before.path.read_bytes() == text
    assert after.begin.rejudged_from == "session-0001.jsonl"
    assert (after.identity.limits_name, after.identity.limits_sha256) == ("tight", "9" * 64)
    assert after.identity.duts == before.identity.duts
    (attempt,) = after.attempts
    assert attempt.verdict == verdict
    assert [(j.verdict, j.limit and j.limit.upper) for j in attempt.judgements] == [(verdict, upper_mm)]
    assert attempt.measurements == next(before.attempts).measurements
    assert attempt.begin_utc_ns == next(before.attempts).begin_utc_ns
    assert after.end is not None
    assert after.end.verdict == ("FAIL" if verdict == "FAIL" else "NOT_RUN"), "the plan has two more steps"


def test_the_whole_session_is_judged_by_its_plan(make_journal: MakeJournal) -> None:
    reference = sample.step_begin(0, 1).model_copy(update={"step_id": "reference", "step_index": -1})
    entries = [
        reference,
        sample.step_end(0, 1, "NOT_RUN").model_copy(update={"step_id": "reference"}),
        *(
            entry
            for step in range(3)
            for entry in sample.attempt(step, 1, "FAIL")
            if getattr(entry, "dut", "") != "SN-2"
        ),
    ]
    record = Journal.read(make_journal(*entries))
    after = rejudge(record, limits(20), "9" * 64)
    assert [step.verdict for step in after.steps.values()] == ["NOT_RUN", "PASS", "PASS", "PASS"]
    assert after.end is not None
    assert after.end.verdict == "PASS"
    old, new = ([line for line in each.lines if line.entry.type == "measurement"] for each in (record, after))
    assert [(line.utc_ns, line.time_s, line.entry) for line in new] == [
        (line.utc_ns, line.time_s, line.entry) for line in old
    ]


def test_an_unsettled_step_stays_invalid_under_any_limits(make_journal: MakeJournal, tmp_path: Path) -> None:
    entries = [
        sample.step_begin(0, 1),
        said.Settle(step_id=STEP, attempt=1, settled=False, duration_s=3600.0, reason="T3 1.2 K off"),
        sample.measurement(0, 1),
        sample.step_end(0, 1, "INVALID"),
    ]
    after = rejudge(Journal.read(make_journal(*entries)), limits(20), "9" * 64)
    (attempt,) = after.attempts
    assert [(j.verdict, j.reason) for j in attempt.judgements] == [("INVALID", "T3 1.2 K off")]


def test_an_attempt_that_broke_off_stays_as_it_was(make_journal: MakeJournal, tmp_path: Path) -> None:
    entries = [sample.step_begin(0, 1), sample.step_end(0, 1, "INVALID", finished=False), sample.step_begin(0, 2)]
    after = rejudge(Journal.read(make_journal(*entries)), limits(20), "9" * 64)
    assert [(a.verdict, a.finished) for a in after.attempts] == [("INVALID", False), ("INVALID", False)]


def test_a_limit_of_another_dimension_writes_nothing(make_journal: MakeJournal, tmp_path: Path) -> None:
    record = Journal.read(make_journal(*sample.attempt(0, 1, "PASS")))
    with pytest.raises(UnitError, match="another dimension"):
        rejudge(record, limits(20, unit="counts"), "9" * 64)
    assert [path.name for path in tmp_path.iterdir()] == ["session-0001.jsonl"]


def test_rejudgements_stand_apart_in_the_history(make_journal: MakeJournal, tmp_path: Path) -> None:
    record = Journal.read(make_journal(*sample.attempt(0, 1, "FAIL")))
    after = rejudge(record, limits(20), "9" * 64)
    assert after.path == tmp_path / "session-0001-rejudged-tight-v2-999999.jsonl"
    assert newest_journal(tmp_path).name == "session-0001.jsonl"
    index = rebuild(tmp_path)
    assert [row.verdict for row in history(index, dut="SN-1")] == ["FAIL"]
    assert [row.verdict for row in history(index, dut="SN-1", rejudged=True)] == ["PASS"]
    with pytest.raises(StorageError, match="exists already"):
        rejudge(record, limits(20), "9" * 64)
