"""Schedules of faults over whole small cycles: whatever breaks, nothing is lost and nothing stays energised."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from arl_fixtures.emulators.fault_kinds import FAULT_KINDS, FaultKind
from arl_fixtures.emulators.faults import Fault, parse_fault
from arl_fixtures.plugin.attempts import ATTEMPTS, RECOVERY_PAUSE_S, RECOVERY_S
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.recording.bag_folder import verify
from tests_bench.small_cycle import SETTLE_LIMIT_S, Ended, fast, files_for, run_cycle, write_files

LATEST_S = 420.0
CEILING_C = 95.0 + 2.0
SWEEP_S = 120.0
"""More than any sweep of a small cycle takes, with every question answered at the last moment."""
LONGEST_S = 3 * ATTEMPTS * (SETTLE_LIMIT_S + SWEEP_S + RECOVERY_S + 200.0 + RECOVERY_PAUSE_S) + 1800.0
"""Steps with the reference, times attempts, each with all its limits used up, and one pause of the guard."""

VALUES: dict[FaultKind, st.SearchStrategy[float]] = {
    FaultKind.SILENCE: st.sampled_from([0.0, 1.0]),
    FaultKind.LATE_REPLY: st.floats(0.0, 10.0),
    FaultKind.GARBAGE: st.integers(0, 40).map(float),
    FaultKind.TRUNCATED_REPLY: st.integers(0, 12).map(float),
    FaultKind.DRIFT: st.floats(-3000.0, 3000.0),
    FaultKind.WRONG_CHANNEL_ORDER: st.integers(1, 3).map(float),
    FaultKind.SETPOINT_IGNORED: st.sampled_from([0.0, 1.0]),
    FaultKind.CHILLER_ALARM: st.integers(-300, -1).map(float),
    FaultKind.LOW_LEVEL: st.floats(0.0, 100.0),
    FaultKind.MISSED_STEPS: st.floats(0.0, 5.0),
    FaultKind.LIMIT_SWITCH: st.sampled_from([1.0, -1.0]),
    FaultKind.LOST_ROWS: st.floats(0.0, 1.0),
    FaultKind.DUPLICATED_ROWS: st.floats(0.0, 1.0),
    FaultKind.REORDERED_ROWS: st.floats(0.0, 1.0),
    FaultKind.CORRUPTED_ROWS: st.floats(0.0, 1.0),
    FaultKind.CLOCK_JUMP: st.floats(-1e6, 1e6),
}
CHANNELS: dict[FaultKind, st.SearchStrategy[int]] = {
    FaultKind.STUCK_VALUE: st.integers(0, 3),
    FaultKind.DRIFT: st.integers(0, 3),
    FaultKind.OPEN_THERMOCOUPLE: st.integers(0, 3),
    FaultKind.RELAY_WELDED: st.integers(1, 8),
}
DEVICES = ("chiller", "thermometer", "stage", "relays", "dut", "dut_1", "dut_2", "bench")


@st.composite
def faults(draw: st.DrawFn) -> Fault:
    """One fault that its device can have."""
    device = draw(st.sampled_from(DEVICES))
    role = device.partition("_")[0]
    kind = draw(st.sampled_from([kind for kind, info in FAULT_KINDS.items() if role in info.devices]))
    return Fault(
        device=device,
        kind=kind,
        start_s=draw(st.floats(0.0, LATEST_S)),
        duration_s=draw(st.floats(0.0, 60.0) | st.floats(0.0, 600.0) | st.just(math.inf)),
        value=draw(st.none() | VALUES[kind]) if kind in VALUES else None,
        channel=draw(st.none() | CHANNELS[kind]) if kind in CHANNELS else None,
    )


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Files of the small cycle, read once, and a way to a new output folder."""
    folder = tmp_path_factory.mktemp("schedules")
    options = write_files(folder)
    known: dict[str, SessionFiles] = {}
    numbers = iter(range(1_000_000))
    with fast():
        yield lambda: files_for(options, folder / f"out-{next(numbers)}", known)


def written(*texts: str) -> list[Fault]:
    """Faults as on the command line."""
    return [parse_fault(text) for text in texts]


EXAMPLES = (
    written(),
    written("thermometer:drift=-1000"),
    written("thermometer:stuck_value", "chiller:setpoint_ignored@90"),
    written("bench:brown_out@120/5"),
    written("relays:relay_welded@30", "stage:silence@200"),
    written("dut_1:dut_silent@100", "dut_2:frozen_frame@250/60"),
)


def check(schedule: list[Fault], files: SessionFiles) -> None:
    """Every promise, after a cycle under this schedule."""
    ended = run_cycle(files, schedule)
    assert ended.watch.hottest_c <= CEILING_C
    assert ended.watch.moved == []
    assert ended.bench_s <= LONGEST_S
    nothing_stays_energised(ended)
    nothing_is_lost(ended, files)


def nothing_stays_energised(ended: Ended) -> None:
    """Off, safe and at rest by the plant's own word; or the session has said what it could not bring about."""
    plant, said = ended.world.plant, " ".join(ended.unsafe)
    config, now_s = ended.world, ended.bench_s
    lasers = any(plant.laser_on(dut) for dut in range(plant.dut_count))
    welded = any(fault.kind is FaultKind.RELAY_WELDED for fault in plant.faults.faults)
    # a welded supply whose DUT is silent, too, shows by nothing that the bench has
    mute = any(fault.kind in MUTE for fault in plant.faults.faults)
    assert not lasers or "power off" in said or (welded and mute), f"a laser is on; said: {said}"
    assert ended.watch.lit == [] or welded
    assert plant.stage_at_rest(now_s, now_s + 60.0) or "stage stop" in said
    assert "set-point" in said or setpoint_is_safe(ended, config.clock.now_s)


MUTE = {
    FaultKind.DUT_SILENT,
    FaultKind.BROWN_OUT,
    FaultKind.LOST_ROWS,
    FaultKind.CORRUPTED_ROWS,
    FaultKind.FROZEN_FRAME,
    FaultKind.RESET,
}


def setpoint_is_safe(ended: Ended, now_s: float) -> bool:
    """What the thermostat itself holds: the safe temperature, or its panel's after it restarted or stopped."""
    chiller: Any = ended.world._lines["chiller"].device
    held_c = chiller._setpoint_c
    ignored = any(fault.kind is FaultKind.SETPOINT_IGNORED for fault in ended.world.plant.faults.faults)
    return held_c in {23.0, 20.0} or not chiller._controlling or ignored


def nothing_is_lost(ended: Ended, files: SessionFiles) -> None:
    """Every step that was told a verdict stands in the journal, once, with its bag and its values."""
    record = ended.record
    assert record.torn == b""
    assert record.end is not None
    finished = {}
    for step in record.steps.values():
        whole = [attempt for attempt in step.attempts if attempt.finished]
        assert len(whole) <= 1, f"{step.step_id} was recorded twice"
        assert len(step.attempts) <= ATTEMPTS
        if whole:
            finished[step.step_id] = whole[0]
    for step_id, verdict in ended.verdicts.items():
        if verdict in {"PASS", "CONDITIONAL", "FAIL"}:
            assert finished[step_id].verdict == verdict
    bags = {path.name for path in (files.options.out / "bags").glob("*") if not path.name.endswith(".part")}
    named = set()
    for step_id, attempt in finished.items():
        if attempt.bag is None:
            assert attempt.verdict == "INVALID"
            assert attempt.judgements == []
            continue
        path = record.bag_path(attempt.bag)
        verify(path, attempt.bag.sha256)
        named.add(path.name)
        values = {(each.dut, each.metric, each.scope) for each in attempt.measurements}
        for judgement in attempt.judgements:
            assert (judgement.dut, judgement.metric, judgement.scope) in values, step_id
    assert bags == named, "every whole bag belongs to a finished step"


@settings(max_examples=36, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(st.lists(faults(), max_size=4))
@example(EXAMPLES[0])
@example(EXAMPLES[1])
@example(EXAMPLES[2])
@example(EXAMPLES[3])
@example(EXAMPLES[4])
@example(EXAMPLES[5])
def test_promises_hold_under_any_schedule_of_faults(prepared: Any, schedule: list[Fault]) -> None:
    """A fixed choice of schedules, the same at each run."""
    check(schedule, prepared())


@pytest.mark.slow
@settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(faults(), max_size=6))
def test_promises_hold_under_many_schedules(prepared: Any, schedule: list[Fault]) -> None:
    """New schedules at each run."""
    check(schedule, prepared())


def test_the_healthy_cycle_passes(prepared: Any) -> None:
    """Without it, schedules would prove nothing."""
    files = prepared()
    ended = run_cycle(files)
    assert set(ended.verdicts.values()) == {"PASS"}
    assert len(ended.verdicts) == 2
    assert ended.over == ""
    assert ended.unsafe == []
    assert Path(files.options.out / "references").is_dir()
