"""Journals for the tests of the reports: cycles with any verdict, values, serial numbers and reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.journal import entries as said
from arl_fixtures.journal.journal import Journal
from arl_fixtures.report.blocks import Report
from arl_fixtures.report.cycles import load_cycles
from arl_fixtures.report.document import make_report
from arl_fixtures.report.lifetime import LifetimeModel
from arl_fixtures.report.maps import MapMaker

HOSTILE = "<script>alert(1)</script>\"'&#[*_`$\\{{7*7}}\u202e\x1b[31m\n=SUM(A1)"
NO_MAPS = MapMaker(None, "the bench file is not at hand")


def step_id(cycle: int, index: int, temperature_c: float) -> str:
    return f"c{cycle:04d}-{index:02d}-up{temperature_c:+g}C"


def limit(lower: float | None = -1.0, upper: float | None = 1.0, **changes: object) -> said.AppliedLimit:
    return said.AppliedLimit(
        unit="%",
        lower=lower,
        upper=upper,
        severity="major",
        reason="specification",
        rule="guard_band",
        coverage=0.95,
        guard_factor=1.0,
    ).model_copy(update=changes)


def value(
    step: str,
    dut: str,
    number: float | None,
    verdict: str = "PASS",
    *,
    attempt: int = 1,
    metric: str = "power_change",
    scope: str = "",
    u: float = 0.01,
    reason: str = "",
    held: said.AppliedLimit | None = None,
    reference: str = "",
) -> list[said.JournalModel]:
    """A measurement and its judgement."""
    repeat = (said.Contribution(name="repeatability", u=u, kind="A", dof=100.0),)
    measurement = said.Measurement(
        step_id=step,
        attempt=attempt,
        dut=dut,
        metric=metric,
        scope=scope,
        value=number,
        unit="" if number is None else "%",
        reference=reference,
        u=None if number is None else u,
        dof=None if number is None else 100.0,
        contributions=() if number is None else repeat,
        reason=reason,
    )
    judgement = said.Judgement(
        step_id=step,
        attempt=attempt,
        dut=dut,
        metric=metric,
        scope=scope,
        limit=held or limit(),
        verdict=verdict,
        risk=0.01 if number is not None else float("nan"),
        reason=reason or verdict.lower(),
    )
    return [measurement, judgement]


def step_of(
    cycle: int,
    index: int,
    temperature_c: float,
    values: Sequence[said.JournalModel],
    verdict: str = "PASS",
    *,
    attempt: int = 1,
    finished: bool = True,
    reason: str = "",
    bag: said.Bag | None = None,
) -> list[said.JournalModel]:
    """One attempt from begin to end."""
    name = step_id(cycle, index, temperature_c)
    begin = said.StepBegin(
        step_id=name, attempt=attempt, cycle=cycle, step_index=index, set_temperature_c=temperature_c, ramp=1
    )
    settle = said.Settle(step_id=name, attempt=attempt, settled=True, duration_s=600.0, overshoot_k=0.3)
    end = said.StepEnd(
        step_id=name,
        attempt=attempt,
        finished=finished,
        verdict=verdict,
        reason=reason,
        temperatures_c={"T2": temperature_c + 0.1, "plate": temperature_c - 1.0} if finished else {},
    )
    return [begin, settle, *([bag] if bag is not None else []), *values, end]


def journal(
    folder: Path,
    lines: Sequence[said.JournalModel],
    plan: Sequence[str],
    *,
    duts: Sequence[str] = ("SN-1",),
    cycles: Sequence[int] = (0,),
    campaign: str = "trial",
    environment: Mapping[str, str] | None = None,
    name: str = "session-0001.jsonl",
    ended: bool = True,
    rejudged_from: str = "",
    bench_sha256: str = "b" * 64,
) -> Path:
    """Write a journal, ten minutes of bench time between entries."""
    identity = said.Identity(
        duts=tuple(said.Dut(serial=serial, model="hfl110") for serial in duts),
        bench_name="bench",
        bench_sha256=bench_sha256,
        profile_name="short",
        profile_sha256="c" * 64,
        limits_name="default",
        limits_sha256="d" * 64,
        software_version="0.1.0",
    )
    begin = said.SessionBegin(
        campaign=campaign,
        cycles=tuple(cycles),
        plan=tuple(plan),
        identity=identity,
        environment=dict(environment or {}),
        rejudged_from=rejudged_from,
    )
    clock = VirtualClock()
    with Journal.create(folder / name, begin, clock) as file:
        for line in lines:
            clock.sleep(600.0)
            file.append(line)
        if ended:
            file.append(said.SessionEnd(reason="finished", verdict="PASS"))
    return folder / name


def one_step(
    folder: Path, number: float | None, verdict: str, *, dut: str = "SN-1", reason: str = "", campaign: str = "trial"
) -> Path:
    """A cycle of one step with one value."""
    name = step_id(0, 0, 25.0)
    lines = step_of(0, 0, 25.0, value(name, dut, number, verdict, reason=reason), verdict, reason=reason)
    return journal(folder, lines, [name], duts=[dut], campaign=campaign)


def drifting(folder: Path, values: Sequence[float], *, dut: str = "SN-1") -> Path:
    """One cycle of two temperatures for each value."""
    lines: list[said.JournalModel] = []
    plan = []
    for cycle, number in enumerate(values):
        for index, temperature_c in enumerate((-10.0, 25.0)):
            name = step_id(cycle, index, temperature_c)
            plan.append(name)
            lines += step_of(cycle, index, temperature_c, value(name, dut, number))
    return journal(folder, lines, plan, duts=[dut], cycles=range(len(values)))


def report_of(path: Path, lifetime: LifetimeModel | None = None) -> Report:
    return make_report(load_cycles([path]), NO_MAPS, lifetime)
