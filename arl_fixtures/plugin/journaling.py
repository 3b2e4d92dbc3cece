"""What a cycle writes into its journal, and what a resumed one reads from it."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from pathlib import Path

import arl_fixtures
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.errors import HoldError, InterlockError
from arl_fixtures.journal import entries
from arl_fixtures.journal.bridge import result_entries
from arl_fixtures.journal.entries import JournalModel
from arl_fixtures.metrics.limits import LimitSet
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.plugin.setup import SessionFiles
from arl_fixtures.plugin.step_runner import StepResult


def identity(files: SessionFiles) -> entries.Identity:
    """What the session may not change under way."""
    return entries.Identity(
        duts=tuple(entries.Dut(serial=dut.serial, model=dut.model) for dut in files.bench.dut_settings),
        bench_name=files.bench.name,
        bench_sha256=files.hashes["bench"],
        profile_name=files.profile.name,
        profile_sha256=files.hashes["profile"],
        limits_name=files.limits.name,
        limits_sha256=files.hashes["limits"],
        software_version=arl_fixtures.__version__,
    )


def session_begin(files: SessionFiles, plan: Sequence[CycleStep]) -> entries.SessionBegin:
    """First line of a session's journal."""
    instruments = {
        f"{kind}.{key}": value
        for kind, entry in files.bench.devices().items()
        for key, value in (
            ("driver", entry.driver),
            ("url", entry.url),
            ("serial", entry.serial),
            ("certificate", entry.certificate),
        )
        if value
    }
    return entries.SessionBegin(
        campaign=files.bench.campaign,
        cycles=tuple(sorted({step.cycle for step in plan})),
        plan=tuple(step.id for step in plan),
        identity=identity(files),
        environment={
            "python": platform.python_version(),
            "clock": files.bench.clock,
            **instruments,
            **files.bench.calibrations,
        },
    )


def step_begin(step: CycleStep, attempt: int) -> entries.StepBegin:
    """An attempt begins."""
    return entries.StepBegin(
        step_id=step.id,
        attempt=attempt,
        cycle=step.cycle,
        step_index=step.index,
        set_temperature_c=step.set_temperature_c,
        ramp=step.ramp,
    )


def broken_off(step: CycleStep, attempt: int, reason: str) -> entries.StepEnd:
    """An attempt that a device or the recording cut short."""
    return entries.StepEnd(step_id=step.id, attempt=attempt, finished=False, verdict="INVALID", reason=reason)


def outcome(result: StepResult, folder: Path, limits: LimitSet) -> list[JournalModel]:
    """Everything a finished attempt leaves, in the order it came about."""
    step_id, attempt = result.step.id, result.attempt
    lines: list[JournalModel] = [
        entries.Settle(
            step_id=step_id,
            attempt=attempt,
            settled=result.settle.settled,
            duration_s=result.settle.duration_s,
            overshoot_k=result.settle.overshoot_k,
            reason=result.settle.reason,
        )
    ]
    if result.bag is not None:
        lines.append(
            entries.Bag(
                step_id=step_id,
                attempt=attempt,
                path=result.bag.path.relative_to(folder).as_posix(),
                sha256=result.bag.sha256,
                size_bytes=result.bag.size_bytes,
                message_count=result.bag.message_count,
            )
        )
    lines += [
        entries.Fault(device=f"DUT {serial}", message=why, action="measured without it, its values are INVALID")
        for serial, why in result.lost.items()
    ]
    lines += result_entries(step_id, attempt, result.judgements, limits)
    lines.append(
        entries.StepEnd(
            step_id=step_id,
            attempt=attempt,
            finished=True,
            verdict=result.verdict.value,
            reason=result.reason,
            temperatures_c=dict(result.temperatures_c),
        )
    )
    return lines


def fault(error: Exception, action: str) -> entries.Fault:
    """A device did not do what it should."""
    message = str(error)
    return entries.Fault(device=message.partition(":")[0], message=message, action=action)


def pause(error: HoldError) -> entries.Alarm:
    """The guard asks for a pause."""
    action = "soak_back" if error.soak_back else "hold"
    return entries.Alarm(source="guard", condition=str(error), action=action)


def note(text: str) -> entries.Note:
    """Something worth a line that nothing depends on."""
    return entries.Note(text=text)


def pause_over(paused_s: float) -> entries.Note:
    """The pause is over."""
    return entries.Note(text=f"pause over after {paused_s:.1f} s")


def safe_stop(error: InterlockError, actions: Sequence[tuple[str, str]]) -> entries.SafeStop:
    """The guard brought the bench into its safe state; its message says whether that could be verified.

    Args:
        error: the guard's word.
        actions: each safe action in order, and what went wrong with it (empty when its read-back agreed).
    """
    done = tuple(entries.SafeAction(name=name, verified=not fault, detail=fault) for name, fault in actions)
    return entries.SafeStop(cause=str(error), actions=done)


def cycle_end(cycle: int, verdict: Verdict, decided_by: str) -> entries.CycleEnd:
    """All steps of a cycle are done."""
    return entries.CycleEnd(cycle=cycle, verdict=verdict.value, decided_by=decided_by)


def session_end(reason: str, verdict: Verdict) -> entries.SessionEnd:
    """The session ended by itself."""
    return entries.SessionEnd(reason=reason, verdict=verdict.value)
