"""A step that does not finish is tried three times, in one session or over several; then it is INVALID, and on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from arl_fixtures.bench.bench import Bench
from arl_fixtures.bench.build import Emulated
from arl_fixtures.emulators.faults import Fault, parse_fault
from arl_fixtures.plugin.attempts import ATTEMPTS
from arl_fixtures.plugin.setup import SessionFiles
from tests_bench.killed_cycles import die, in_child, past_of
from tests_bench.small_cycle import Ended, fast, files_for, run_cycle, write_files

STEP = "c0000-00-up+81C"
NEXT = "c0000-01-up+82.5C"


@pytest.fixture
def stand(tmp_path: Path) -> Iterator[tuple[SessionFiles, Ended]]:
    """Files of a cycle, and how it is when all is well."""
    options = write_files(tmp_path)
    known: dict[str, SessionFiles] = {}
    with fast():
        yield files_for(options, tmp_path / "out", known), run_cycle(files_for(options, tmp_path / "well", known))


def sweep_of(ended: Ended, attempt: int) -> float:
    """Bench time shortly before the end of an attempt at the step, when it sweeps."""
    ends = [line for line in ended.record.lines if line.entry.type == "step_end" and line.entry.step_id == STEP]
    return ends[attempt - 1].time_s - 1.0


def check_given_up(ended: Ended, said: str) -> None:
    """Three attempts in the journal, none finished; the step is INVALID and says why; the next one passes."""
    assert ended.verdicts[STEP].startswith("INVALID: attempt 1: ")
    assert ended.verdicts[STEP].count(said) == ATTEMPTS
    assert ended.verdicts[NEXT] == "PASS"
    assert ended.over == ""
    assert ended.unsafe == []
    attempts = ended.record.steps[STEP].attempts
    assert [attempt.finished for attempt in attempts] == [False] * ATTEMPTS
    assert ended.record.end is not None
    assert ended.record.end.verdict == "INVALID"


def test_a_step_that_fails_three_times_is_invalid_and_the_cycle_goes_on(stand: tuple[SessionFiles, Ended]) -> None:
    """Each attempt is broken off by a chiller that restarts within its sweep."""
    files, ended = stand
    schedule: list[Fault] = []
    for attempt in range(1, ATTEMPTS + 1):
        schedule.append(parse_fault(f"chiller:reset@{sweep_of(ended, attempt)}"))
        ended = run_cycle(files_for(files.options, files.options.out / f"{attempt}", {}), schedule)
    check_given_up(ended, "chiller at emulated chiller: no answer")


def test_three_sessions_that_died_within_a_step_use_it_up(stand: tuple[SessionFiles, Ended]) -> None:
    """Killed in its sweep each time; the fourth session passes it over."""
    files, well = stand
    out = files.options.out
    into_s = sweep_of(well, 1) - next(
        line.time_s for line in well.record.lines if line.entry.type == "step_begin" and line.entry.step_id == STEP
    )

    def until_killed() -> None:
        past = past_of(out)
        at_s = sweep_of(well, 1) if past.record is None else past.start_s + 12.0 + into_s

        def look(world: Emulated, _bench: Bench) -> None:
            world.clock.at(at_s, die)

        run_cycle(files, past=past, look=look)

    for _ in range(ATTEMPTS):
        assert in_child(until_killed) == -9
    check_given_up(run_cycle(files, past=past_of(out)), "the session ended within")
