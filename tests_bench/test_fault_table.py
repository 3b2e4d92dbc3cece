"""For each device and fault: what the session does. `docs/reliability.md` says the same, and is checked here.

Each fault begins between the first sweep and its end and lasts; what the journal and the plant say is judged.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from arl_fixtures.emulators.fault_kinds import FAULT_KINDS, FaultKind
from arl_fixtures.emulators.faults import Fault
from arl_fixtures.guard.core import SafeStep
from arl_fixtures.plugin.setup import SessionFiles
from tests_bench.small_cycle import Ended, fast, files_for, run_cycle, write_files

OUTAGE_S = 10.0
PAGE = Path(__file__).parents[1] / "docs" / "reliability.md"

WIRE = (
    FaultKind.SILENCE,
    FaultKind.LATE_REPLY,
    FaultKind.GARBAGE,
    FaultKind.WRONG_CHECKSUM,
    FaultKind.TRUNCATED_REPLY,
    FaultKind.MERGED_REPLIES,
    FaultKind.DISCONNECT,
)
REACTIONS: dict[tuple[str, FaultKind], str] = {
    **{
        (device, kind): reaction
        for kind in WIRE
        for device, reaction in (("chiller", "stopped"), ("thermometer", "safe state"), ("stage", "ends"))
        if device in FAULT_KINDS[kind].devices
    },
    # nobody switches anything in a sweep: it shows when the bench is made safe
    **{("relays", kind): "said at the end" for kind in WIRE},
    ("chiller", FaultKind.RESET): "repeats",
    ("thermometer", FaultKind.RESET): "retries",
    ("stage", FaultKind.RESET): "repeats",
    ("relays", FaultKind.RESET): "safe state",
    ("dut", FaultKind.RESET): "retries",
    **{(device, FaultKind.BROWN_OUT): "ends" for device in ("relays", "stage")},
    **{(device, FaultKind.BROWN_OUT): "stopped" for device in ("chiller", "bench")},
    ("thermometer", FaultKind.BROWN_OUT): "safe state",
    ("dut", FaultKind.BROWN_OUT): "that DUT INVALID",
    ("chiller", FaultKind.STUCK_VALUE): "not seen",
    ("thermometer", FaultKind.STUCK_VALUE): "INVALID step",
    ("chiller", FaultKind.DRIFT): "not seen",
    ("thermometer", FaultKind.DRIFT): "not seen",
    ("thermometer", FaultKind.OPEN_THERMOCOUPLE): "safe state",
    ("thermometer", FaultKind.WRONG_CHANNEL_ORDER): "not seen",
    ("chiller", FaultKind.SETPOINT_IGNORED): "INVALID step",
    ("chiller", FaultKind.CHILLER_ALARM): "safe state",
    ("chiller", FaultKind.LOW_LEVEL): "safe state",
    ("chiller", FaultKind.PUMP_STOP): "safe state",
    ("stage", FaultKind.STAGE_STALL): "safe state",
    ("stage", FaultKind.MISSED_STEPS): "ends",
    ("stage", FaultKind.LIMIT_SWITCH): "ends",
    ("relays", FaultKind.RELAY_WELDED): "said at the end",
    ("dut", FaultKind.DUT_SILENT): "that DUT INVALID",
    ("dut", FaultKind.FROZEN_FRAME): "that DUT INVALID",
    ("dut", FaultKind.LOST_ROWS): "rows masked",
    ("dut", FaultKind.DUPLICATED_ROWS): "retries",
    ("dut", FaultKind.REORDERED_ROWS): "retries",
    ("dut", FaultKind.CORRUPTED_ROWS): "rows masked",
    ("bench", FaultKind.CLOCK_JUMP): "retries",
    ("dut", FaultKind.CLOCK_JUMP): "retries",
}


def nothing_happened(ended: Ended) -> None:
    """Every step passes at its first attempt."""
    assert set(ended.verdicts.values()) == {"PASS"}
    assert len(ended.verdicts) == 2
    assert ended.entries("fault") == []
    assert ended.entries("safe_stop") == []
    assert all(entry.attempt == 1 for entry in ended.entries("step_begin"))


def repeats(ended: Ended) -> None:
    """A new attempt passes."""
    assert set(ended.verdicts.values()) == {"PASS"}
    assert max(entry.attempt for entry in ended.entries("step_begin")) > 1
    assert ended.entries("fault") or ended.entries("alarm")
    assert ended.unsafe == []


def ends(ended: Ended) -> None:
    """The session ends by itself, names the device, and runs no further step."""
    assert "does not come back" in ended.over
    assert ended.entries("fault")[-1].action.startswith("session ended")
    assert ended.record.end is not None
    assert ended.record.end.verdict in {"NOT_RUN", "INVALID"}


def safe_state(ended: Ended) -> None:
    """The guard stops the bench, and that is journalled."""
    (stop,) = ended.entries("safe_stop")
    assert [action.name for action in stop.actions][-3:] == [str(step) for step in SafeStep]
    assert all(action.verified for action in stop.actions[-3:])
    assert "bench is stopped" in ended.over
    assert ended.unsafe == []
    assert not any(ended.world.plant.laser_on(dut) for dut in range(ended.world.plant.dut_count))


def stopped(ended: Ended) -> None:
    """The guard stops the bench as far as its lines allow, and what it could not verify is said and journalled."""
    (stop,) = ended.entries("safe_stop")
    assert "could NOT be verified (" in stop.cause
    assert "no value of coolant for 2" in stop.cause or "no value of T2 for 2" in stop.cause
    assert not all(action.verified for action in stop.actions)
    assert "bench is stopped" in ended.over
    assert any("set-point to 23 °C failed" in said for said in ended.unsafe)


def one_dut_invalid(ended: Ended) -> None:
    """Its values are INVALID with the reason, the other's are judged and pass."""
    ill, well = ended.record.identity.duts
    attempts = [step.attempts[-1] for step in ended.record.steps.values()]
    assert all(attempt.finished for attempt in attempts)
    judged = {
        (judgement.dut, judgement.verdict)
        for attempt in attempts
        for judgement in attempt.judgements
        if judgement.limit is not None
    }
    assert judged == {(ill.serial, "INVALID"), (well.serial, "PASS")}
    assert ended.unsafe == []


def invalid_step(ended: Ended) -> None:
    """A step that cannot settle is INVALID and names the sensor; the session goes on to its end."""
    assert "not settled within" in list(ended.verdicts.values())[-1]
    assert ended.over == ""
    assert ended.unsafe == []


def said_at_the_end(ended: Ended) -> None:
    """Measured as usual; that the power could not be verified to be off is said."""
    assert set(ended.verdicts.values()) == {"PASS"}
    assert any("power off failed" in said for said in ended.unsafe)


def passes_unseen(ended: Ended) -> None:
    """Nothing happens."""
    nothing_happened(ended)
    assert ended.unsafe == []


def rows_masked(ended: Ended) -> None:
    """Frames are taken with those rows masked, at most after some more frames."""
    nothing_happened(ended)
    assert ended.unsafe == []
    assert ended.world.network is not None


CHECKS = {
    "retries": passes_unseen,
    "rows masked": rows_masked,
    "not seen": passes_unseen,
    "repeats": repeats,
    "ends": ends,
    "safe state": safe_state,
    "stopped": stopped,
    "that DUT INVALID": one_dut_invalid,
    "INVALID step": invalid_step,
    "said at the end": said_at_the_end,
}
OUTAGES = [
    ("chiller", FaultKind.SILENCE),
    ("thermometer", FaultKind.DISCONNECT),
    ("thermometer", FaultKind.GARBAGE),
    ("stage", FaultKind.BROWN_OUT),
    ("chiller", FaultKind.BROWN_OUT),
]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """One cycle under one fault."""
    folder = tmp_path_factory.mktemp("table")
    options = write_files(folder)
    known: dict[str, SessionFiles] = {}
    numbers = iter(range(1_000_000))

    def cycle(device: str, kind: FaultKind, **more: float) -> Ended:
        fault = Fault(device="dut_1" if device == "dut" else device, kind=kind, start_s=start_s, **more)
        return run_cycle(files_for(options, folder / f"out-{next(numbers)}", known), [fault])

    with fast():
        start_s = within_first_sweep_s(run_cycle(files_for(options, folder / "healthy", known)))
        yield cycle


def within_first_sweep_s(healthy: Ended) -> float:
    """Bench time in the middle of the first sweep, which is the reference's."""
    lines = healthy.record.lines
    began_s = next(line.time_s for line in lines if line.entry.type == "step_begin")
    settled_s = began_s + healthy.entries("settle")[0].duration_s
    return 0.5 * (settled_s + next(line.time_s for line in lines if line.entry.type == "step_end"))


@pytest.mark.parametrize(("device", "kind"), list(REACTIONS), ids=[f"{d}-{k.value}" for d, k in REACTIONS])
def test_a_lasting_fault_is_answered_as_stated(run: Any, device: str, kind: FaultKind) -> None:
    """The reaction of the table."""
    CHECKS[REACTIONS[device, kind]](run(device, kind))


@pytest.mark.parametrize(("device", "kind"), OUTAGES, ids=[f"{d}-{k.value}" for d, k in OUTAGES])
def test_an_outage_of_seconds_costs_an_attempt_and_not_the_session(run: Any, device: str, kind: FaultKind) -> None:
    """The bench is waited for and started anew."""
    repeats(run(device, kind, duration_s=OUTAGE_S))


def test_every_fault_of_every_device_has_a_stated_reaction() -> None:
    """None is left out, none invented."""
    possible = {(device, kind) for kind, info in FAULT_KINDS.items() for device in info.devices}
    assert set(REACTIONS) == possible


def test_the_page_states_the_same_reactions() -> None:
    """A row `| kind | device | reaction |` each, in which the reaction begins with the table's word."""
    rows = re.findall(r"^\| `(\w+)` \| (\w+) \| ([^|]+?) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    stated = {(device, FaultKind(kind)): reaction.partition(":")[0] for kind, device, reaction in rows}
    assert stated == REACTIONS
