"""What a cycle writes into its journal, and what a resumed one reads from it."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from pathlib import Path

import arl_fixtures
from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.journal import entries
from arl_fixtures.journal.entries import JournalModel
from arl_fixtures.metrics.judge import Judgement
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
            ("calibration_due", entry.calibration_due),
        )
        if value
    }
    return entries.SessionBegin(
        campaign=files.bench.campaign,
        cycles=tuple(sorted({step.cycle for step in plan})),
        plan=tuple(step.id for step in plan),
        identity=identity(files),
        environment={"python": platform.python_version(), "clock": files.bench.clock, **instruments},
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
    at: dict[str, object] = {"step_id": step_id, "attempt": attempt}
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
    seen: set[int] = set()
    for judgement in result.judgements:
        # a value held against two limits is one measurement with two judgements
        if id(judgement.measurement) not in seen:
            seen.add(id(judgement.measurement))
            lines.append(_measurement(judgement, at))
        lines.append(_judgement(judgement, limits, at))
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


def _measurement(judgement: Judgement, at: dict[str, object]) -> entries.Measurement:
    measurement = judgement.measurement
    quantity = measurement.quantity
    common = {
        **at,
        "dut": measurement.dut,
        "metric": measurement.metric,
        "scope": measurement.scope,
        "reason": measurement.reason,
        "attempted": measurement.attempted,
        "reference": measurement.reference,
    }
    if quantity is None:
        return entries.Measurement.model_validate({**common, "value": None})
    contributions = tuple(
        entries.Contribution(name=part.name, u=part.u, kind=part.kind.value, dof=part.dof)
        for part in quantity.contributions
    )
    return entries.Measurement.model_validate(
        {
            **common,
            "value": quantity.value,
            "unit": quantity.unit,
            "u": quantity.u,
            "dof": quantity.dof,
            "contributions": contributions,
        }
    )


def _judgement(judgement: Judgement, limits: LimitSet, at: dict[str, object]) -> entries.Judgement:
    limit, measurement = judgement.limit, judgement.measurement
    applied = None
    if limit is not None:
        decision = limits.decision_of(limit)
        applied = entries.AppliedLimit(
            unit=limit.unit,
            lower=limit.lower,
            upper=limit.upper,
            severity=limit.severity.value,
            reason=limit.reason,
            rule=decision.rule.value,
            coverage=decision.coverage,
            guard_factor=decision.guard_factor,
        )
    return entries.Judgement.model_validate(
        {
            **at,
            "dut": measurement.dut,
            "metric": measurement.metric,
            "scope": measurement.scope,
            "limit": applied,
            "verdict": judgement.verdict.value,
            "risk": judgement.risk,
            "reason": judgement.reason,
        }
    )


def fault(error: Exception, action: str) -> entries.Fault:
    """A device did not do what it should."""
    message = str(error)
    return entries.Fault(device=message.partition(":")[0], message=message, action=action)


def session_end(reason: str, verdict: Verdict) -> entries.SessionEnd:
    """The session ended by itself."""
    return entries.SessionEnd(reason=reason, verdict=verdict.value)
