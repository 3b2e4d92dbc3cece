"""A session of two steps, the first with a failed attempt before the one that finished."""

from __future__ import annotations

from arl_fixtures.journal import entries as said

PLAN = ("c0000-00-up-10C", "c0000-01-up-5C", "c0000-02-up+0C")


def identity(**changes: object) -> said.Identity:
    return said.Identity(
        duts=(said.Dut(serial="SN-1", model="hfl110"), said.Dut(serial="SN-2", model="hfl110")),
        bench_name="bench",
        bench_sha256="b" * 64,
        profile_name="short",
        profile_sha256="c" * 64,
        limits_name="default",
        limits_sha256="d" * 64,
        software_version="0.1.0",
    ).model_copy(update=changes)


def begin() -> said.SessionBegin:
    return said.SessionBegin(campaign="Feldversuch 7", cycles=(0,), plan=PLAN, identity=identity())


def step_begin(step: int, attempt: int) -> said.StepBegin:
    return said.StepBegin(
        step_id=PLAN[step], attempt=attempt, cycle=0, step_index=step, set_temperature_c=-10.0 + 5 * step, ramp=1
    )


def measurement(step: int, attempt: int, *, dut: str = "SN-1", value: float | None = 0.012) -> said.Measurement:
    return said.Measurement(
        step_id=PLAN[step],
        attempt=attempt,
        dut=dut,
        metric="distance_error",
        scope="stripe_50",
        value=value,
        unit="m" if value is not None else "",
        u=None if value is None else 0.001,
        dof=None if value is None else float("inf"),
        contributions=() if value is None else (said.Contribution(name="stage angle", u=0.001, kind="B", dof=9.5),),
        reason="" if value is not None else "too few frames",
    )


def judgement(step: int, attempt: int, verdict: str, *, dut: str = "SN-1") -> said.Judgement:
    return said.Judgement(
        step_id=PLAN[step],
        attempt=attempt,
        dut=dut,
        metric="distance_error",
        scope="stripe_50",
        limit=said.AppliedLimit(
            unit="mm",
            lower=-20.0,
            upper=20.0,
            severity="major",
            reason="specification",
            rule="guard_band",
            coverage=0.95,
            guard_factor=1.0,
        ),
        verdict=verdict,
        risk=0.01,
    )


def step_end(step: int, attempt: int, verdict: str, *, finished: bool = True) -> said.StepEnd:
    return said.StepEnd(
        step_id=PLAN[step],
        attempt=attempt,
        finished=finished,
        verdict=verdict,
        reason="device lost" if not finished else "",
        temperatures_c={"T2": -9.9, "T3": float("nan")},
    )


def attempt(step: int, number: int, verdict: str) -> list[said.JournalModel]:
    return [
        step_begin(step, number),
        said.Settle(step_id=PLAN[step], attempt=number, settled=True, duration_s=612.0, overshoot_k=0.4),
        said.Bag(
            step_id=PLAN[step],
            attempt=number,
            path=f"bags/{PLAN[step]}",
            sha256="e" * 64,
            size_bytes=40_000_000,
            message_count=23_505,
        ),
        measurement(step, number),
        measurement(step, number, dut="SN-2", value=None),
        judgement(step, number, verdict),
        judgement(step, number, "INVALID", dut="SN-2"),
        step_end(step, number, verdict),
    ]
