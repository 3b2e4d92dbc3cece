"""`arl guard --status`, `arl ack`, `arl lab`: one line each, and nothing is acknowledged by accident."""

import pytest
from click.testing import CliRunner

from arl_fixtures.cli import arl
from arl_fixtures.errors import ConfigError, InterlockError
from arl_fixtures.guard.runtime import Places, StopReport, read_stop, write_stop


@pytest.fixture
def places(tmp_path):
    return Places.of("emulated", tmp_path)


@pytest.fixture
def stopped(places):
    action = {"time_s": 1.6, "step": "safe set-point", "fault": "no answer"}
    report = StopReport(
        bench="emulated", cause="T2 reads 96.0 °C", utc="2026-01-01T00:00:00Z", bench_time_s=1.5,
        actions=[action], unverified={"safe set-point": "no answer"},
    )  # fmt: skip
    write_stop(places, report)
    return report


def run(tmp_path, *arguments, text=None):
    done = CliRunner().invoke(arl, [*arguments, "--runtime", str(tmp_path)], input=text, catch_exceptions=True)
    if isinstance(done.exception, Exception) and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def test_status_without_guard_and_stop(tmp_path, places):
    assert run(tmp_path, "guard", "--status").output == "no guard is running\n"
    places.driven.write_text("{}")
    assert "nobody has ended it" in run(tmp_path, "guard", "--status").output


def test_a_stop_is_shown_and_acknowledged_only_when_somebody_says_so(tmp_path, places, stopped):
    assert "must be acknowledged: arl ack" in run(tmp_path, "guard", "--status").output
    for answer in ("n\n", ""):
        with pytest.raises(InterlockError, match="not acknowledged"):
            run(tmp_path, "ack", text=answer)
        assert read_stop(places) == stopped
    status = run(tmp_path, "guard", "--status").output
    assert "T2 reads 96.0 °C; could NOT be verified: safe set-point: no answer" in status
    agreed = run(tmp_path, "ack", "--note", "fan replaced", "--by", "M", text="y\n")
    assert agreed.exit_code == 0
    report = read_stop(places)
    assert report is not None
    assert not report.blocks
    assert (report.acknowledged["by"], report.acknowledged["note"]) == ("M", "fan replaced")
    assert "acknowledged by M: fan replaced" in run(tmp_path, "guard", "--status").output
    with pytest.raises(InterlockError, match="nothing to acknowledge"):
        run(tmp_path, "ack", "--yes")


def test_an_emulated_bench_needs_a_lab_for_a_guard_of_its_own(tmp_path):
    with pytest.raises(ConfigError, match="needs --lab"):
        run(tmp_path, "guard")
