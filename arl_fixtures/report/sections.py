"""The sections about one cycle: identity, decision rule, verdicts, what is wrong, K, temperatures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import date
from typing import Final

from arl_fixtures.journal.entries import AppliedLimit, Measurement
from arl_fixtures.journal.record import AttemptRecord, SessionRecord
from arl_fixtures.metrics.instruments import ACCEPT_EXPIRED, CALIBRATION_DUE
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.quantity import convert
from arl_fixtures.report.blocks import Block, Cell, Facts, Section, Table, Text, verdict_cell
from arl_fixtures.report.cycles import Cycle, why_unfinished
from arl_fixtures.report.results import Judged, ResultRow, judged, result_rows
from arl_fixtures.report.text import (
    NOTHING,
    duration_text,
    half_width,
    limit_text,
    metric_text,
    range_text,
    shown,
    utc_date,
    utc_text,
    value_text,
)

INSTRUMENTS: Final = ("chiller", "thermometer", "stage", "relays", "duts")
CAMERA: Final = (
    ("focal_length", "fx"),
    ("focal_length", "fy"),
    ("principal_point", "cx"),
    ("principal_point", "cy"),
)
MOST_ROWS: Final = 150
"""Rows of a list of single findings; a table nobody reads to its end hides what it holds."""


def identity(cycle: Cycle) -> Section:
    """DUTs, bench, instruments with calibration state, software, hashes."""
    record, who = cycle.record, cycle.record.identity
    facts = Facts(
        rows=(
            ("Campaign", Cell(shown(record.begin.campaign))),
            ("Cycle", Cell(str(cycle.number))),
            ("Journal", Cell(shown(record.path.name))),
            ("First step began", Cell(utc_text(cycle.begin_utc_ns))),
            ("Last step ended", Cell(utc_text(cycle.end_utc_ns))),
            ("Duration", Cell(duration_text((cycle.end_utc_ns - cycle.begin_utc_ns) / 1e9))),
            ("Clock", Cell(shown(record.begin.environment.get("clock", "not stated")))),
            ("Bench", Cell(f"{shown(who.bench_name)}, SHA-256 {who.bench_sha256}")),
            ("Profile", Cell(f"{shown(who.profile_name)}, SHA-256 {who.profile_sha256}")),
            ("Limits", Cell(f"{shown(who.limits_name)}, SHA-256 {who.limits_sha256}")),
            ("Software", Cell(_software(record))),
        )
    )
    duts = Table(
        title="Devices under test",
        header=("Position", "Serial number", "Type", "Changes are against"),
        rows=tuple(
            (
                Cell(str(place)),
                Cell(shown(dut.serial)),
                Cell(shown(dut.model) or NOTHING),
                Cell(_references(cycle, dut.serial) or NOTHING),
            )
            for place, dut in enumerate(who.duts, start=1)
        ),
        weights=(1.0, 2.4, 1.4, 4.0),
    )
    return Section(title="Identity", blocks=(facts, duts, instruments(record, utc_date(cycle.end_utc_ns))))


def _references(cycle: Cycle, serial: str) -> str:
    """What the relative values of a DUT were held against; more than one where it changed under way."""
    measured = (each for attempt in cycle.attempts for each in attempt.measurements if each.dut == serial)
    named = dict.fromkeys(each.reference for each in measured if each.reference)
    return "; ".join(shown(each).replace(" degC", "\u00a0°C") for each in named)


def _software(record: SessionRecord) -> str:
    resumed = [each.identity.software_version for each in record.resumes]
    versions = dict.fromkeys([record.identity.software_version, *resumed])
    python = record.begin.environment.get("python")
    return f"arl-fixtures {', then '.join(shown(each) for each in versions)}" + (
        f", Python {shown(python)}" if python else ""
    )


def instruments(record: SessionRecord, used_until: date) -> Table:
    """Instruments with serial number, certificate and due date; what expired before the cycle's end is flagged."""
    said = record.begin.environment
    rows = []
    for kind in INSTRUMENTS:
        if f"{kind}.driver" not in said:
            continue
        accepted = said.get(f"{kind}.{ACCEPT_EXPIRED}", "")
        state = calibration_state(
            said.get(f"{kind}.{CALIBRATION_DUE}", ""), said.get(f"{kind}.url", ""), used_until, accepted
        )
        rows.append(
            (
                Cell(kind),
                Cell(shown(f"{said[f'{kind}.driver']} at {said.get(f'{kind}.url', '?')}")),
                Cell(shown(said.get(f"{kind}.serial", "")) or NOTHING),
                Cell(shown(said.get(f"{kind}.certificate", "")) or NOTHING),
                state,
            )
        )
    return Table(
        title="Instruments",
        header=("Role", "Driver and address", "Serial number", "Certificate", "Calibration"),
        rows=tuple(rows),
        weights=(1.3, 2.4, 1.6, 1.8, 2.2),
        note="" if rows else "The journal names no instruments.",
    )


def expired_instruments(cycle: Cycle) -> list[str]:
    """Roles of the instruments whose calibration ran out before the cycle's end."""
    said, used_until = cycle.record.begin.environment, utc_date(cycle.end_utc_ns)
    return [
        kind
        for kind in INSTRUMENTS
        if calibration_state(said.get(f"{kind}.{CALIBRATION_DUE}", ""), "", used_until).tone == "fail"
    ]


def calibration_state(due: str, url: str, used_until: date, accepted: str = "") -> Cell:
    """Whether a calibration held to the end of the cycle.

    Args:
        due: last day that counts, ISO; empty where it is not stated.
        url: address of the instrument.
        used_until: when the cycle ended.
        accepted: why the instrument could be used after that day; empty where it could not.
    """
    if not due:
        return Cell("emulated: needs none") if url == "emulated" else Cell("due date not stated", "conditional")
    try:
        day = date.fromisoformat(due)
    except ValueError:
        return Cell(f"due date unreadable: {shown(due)}", "conditional")
    if day < used_until:
        why = f"; accepted: {shown(accepted)}" if accepted else ""
        return Cell(f"EXPIRED, was due {day.isoformat()}{why}", "fail")
    return Cell(f"valid, due {day.isoformat()}", "pass")


def decision(cycle: Cycle) -> Section:
    """By which rules values were compared with limits."""
    limits = [each.judgement.limit for each in judged(cycle.attempts) if each.judgement.limit is not None]
    rules = dict.fromkeys(rule_text(limit) for limit in limits)
    blocks: list[Block] = [Text(text=rule) for rule in rules] or [Text(text="No limit was applied.")]
    blocks.append(
        Text(
            text="A step's verdict is the worst of its values that have a limit, a cycle's the worst of its steps, "
            "in the order PASS, CONDITIONAL, NOT RUN, INVALID, FAIL. INVALID was measured and cannot be trusted; NOT "
            "RUN was never measured; neither is said of the device. A step that failed stays FAIL though a later "
            "attempt passed. Intervals are ± U with 95 % coverage, from Student's t with the effective degrees of "
            "freedom."
        )
    )
    return Section(title="Decision rule", blocks=tuple(blocks))


def rule_text(limit: AppliedLimit) -> str:
    """One decision rule in words."""
    if limit.rule == "simple":
        return "Simple acceptance: PASS within the limit, FAIL beyond; at the limit half of all accepts are false."
    return (
        "Guard band (ISO 14253-1, JCGM 106): PASS within the limit less w, FAIL beyond the limit plus w, "
        f"CONDITIONAL between, with w = {limit.guard_factor:g} · U({100 * limit.coverage:g} %)."
    )


def verdicts(cycle: Cycle) -> Section:
    """Steps by DUT at a glance, then for each DUT every limit with the value that tells most."""
    blocks: list[Block] = [_steps(cycle)]
    rows = result_rows(cycle.finished)
    for dut in cycle.record.identity.duts:
        own = [row for row in rows if row.dut == dut.serial]
        if own:
            blocks.append(_dut_table(dut.serial, own))
        else:
            blocks.append(Text(text=f"{shown(dut.serial)}: no value was judged.", tone="not_run"))
    return Section(title="Verdicts", blocks=tuple(blocks))


def _steps(cycle: Cycle) -> Table:
    rows = []
    for step_id in cycle.planned:
        step = cycle.steps.get(step_id)
        settled = [each for each in step.attempts if each.settle is not None] if step else []
        last = settled[-1].settle if settled else None
        rows.append(
            (
                Cell(shown(step_id)),
                verdict_cell(cycle.step_verdict(step_id).value),
                Cell(str(len(step.attempts)) if step else "0"),
                Cell(f"{last.duration_s:.0f} s, {last.overshoot_k:.2f} K" if last else NOTHING),
                Cell(shown(cycle.reason(step_id)) or NOTHING),
            )
        )
    return Table(
        title="Steps",
        header=("Step", "Verdict", "Attempts", "Settled in, overshoot", "What decided"),
        rows=tuple(rows),
        weights=(2.1, 1.4, 1.0, 1.8, 4.0),
    )


def _dut_table(serial: str, rows: list[ResultRow]) -> Table:
    ordered = sorted(rows, key=lambda row: -row.verdict.badness)
    return Table(
        title=f"Values of {shown(serial)} against their limits",
        header=("Metric", "Limit", "Nearest to the limit", "At", "Over the steps", "Verdict"),
        rows=tuple(_row(row) for row in ordered),
        weights=(2.9, 2.0, 2.2, 1.2, 2.0, 1.2),
        note="One row for each limit; of the values with the worst verdict the one nearest to its limit, in "
        "expanded uncertainties, is given with its 95 % interval. The journal holds them all.",
    )


def _row(row: ResultRow) -> tuple[Cell, ...]:
    telling, counts = row.telling, row.counts
    measured = telling.measurement
    has_value = measured is not None and measured.value is not None
    begin = telling.attempt.begin
    place = f"{begin.set_temperature_c:g} °C {'up' if begin.ramp > 0 else 'down'}"
    span = row.range
    half = half_width(measured, row.limit.unit) if measured is not None else 0.0
    several = ", ".join(
        f"{counts[each]} {each.value.replace('_', ' ')}" for each in reversed(Verdict) if counts[each]
    )
    return (
        Cell(metric_text(row.metric, row.scope)),
        Cell(limit_text(row.limit) + (" (minor)" if row.limit.severity == "minor" else "")),
        Cell(value_text(measured, row.limit.unit) if has_value else shown(telling.reason) or NOTHING),
        Cell(place),
        Cell(range_text(*span, row.limit.unit, half) if span else NOTHING),
        Cell(verdict_cell(row.verdict.value).text if len(counts) == 1 else several, verdict_cell(row.verdict).tone),
    )


def shortfalls(cycle: Cycle) -> Section:
    """Everything that is not PASS: broken attempts, invalid values, failed limits; with the reasons."""
    blocks: list[Block] = []
    attempts = [_attempt_row(each) for each in cycle.attempts if not each.finished or each.verdict == "INVALID"]
    attempts += [
        (Cell(shown(each)), Cell("0"), verdict_cell("NOT_RUN"), Cell("the session never came to it"))
        for each in cycle.planned
        if each not in cycle.steps
    ]
    if attempts:
        blocks.append(
            Table(
                title="Attempts that were INVALID or broke off, and steps that were NOT RUN",
                header=("Step", "Attempt", "Verdict", "Why"),
                rows=tuple(attempts),
                weights=(2.0, 1.0, 1.4, 5.0),
            )
        )
    exceeded = [each for each in judged(cycle.finished) if _decides(each) and each.verdict in _EXCEEDED]
    exceeded.sort(key=lambda each: (-each.verdict.badness, each.margin))
    if exceeded:
        blocks.append(_exceeded(exceeded))
    unmeasured = list(_unmeasured(cycle))
    if unmeasured:
        blocks.append(
            Table(
                title="Values that are INVALID or NOT RUN",
                header=("DUT", "Metric", "Verdict", "Steps", "Why"),
                rows=tuple(unmeasured[:MOST_ROWS]),
                weights=(1.7, 2.6, 1.3, 1.0, 4.0),
                note=_left_out(len(unmeasured)),
            )
        )
    if not blocks:
        blocks.append(Text(text="Every step was measured at the first attempt, and every value is within its limit."))
    return Section(title="What is not PASS, and why", blocks=tuple(blocks))


_EXCEEDED: Final = frozenset({Verdict.FAIL, Verdict.CONDITIONAL})


def _decides(each: Judged) -> bool:
    return each.judgement.limit is not None


def _attempt_row(attempt: AttemptRecord) -> tuple[Cell, ...]:
    why = why_unfinished(attempt) if not attempt.finished else attempt.end.reason if attempt.end else ""
    settle = attempt.settle
    if settle is not None and not settle.settled and settle.reason not in why:
        why = f"{why}; not settled: {settle.reason}"
    begin = attempt.begin
    return (Cell(shown(begin.step_id)), Cell(str(begin.attempt)), verdict_cell(attempt.verdict), Cell(shown(why)))


def _exceeded(values: list[Judged]) -> Table:
    return Table(
        title="Values beyond their limit (FAIL), or nearer to it than their uncertainty allows (CONDITIONAL)",
        header=("DUT", "Metric", "Step", "Value", "Limit", "Risk", "Verdict"),
        rows=tuple(
            (
                Cell(shown(each.judgement.dut)),
                Cell(metric_text(each.judgement.metric, each.judgement.scope)),
                Cell(shown(each.attempt.begin.step_id)),
                Cell(value_text(each.measurement, each.judgement.limit.unit if each.judgement.limit else "")),
                Cell(limit_text(each.judgement.limit)),
                Cell(_risk(each.judgement.risk)),
                verdict_cell(each.verdict.value),
            )
            for each in values[:MOST_ROWS]
        ),
        weights=(1.6, 2.3, 1.8, 2.2, 1.6, 1.0, 1.5),
        note="Risk: probability that the true value lies outside the limit. " + _left_out(len(values)),
    )


def _risk(risk: float) -> str:
    if math.isnan(risk):
        return NOTHING
    return f"{100 * risk:.2g} %" if 1e-4 < risk < 0.9999 else "< 0.01 %" if risk < 0.5 else "> 99.99 %"


def _left_out(count: int) -> str:
    return f"The first {MOST_ROWS} of {count}; the journal holds them all." if count > MOST_ROWS else ""


def _unmeasured(cycle: Cycle) -> Iterator[tuple[Cell, ...]]:
    steps: dict[tuple[str, str, str, str, str], int] = {}
    for each in judged(cycle.finished):
        if each.verdict in {Verdict.INVALID, Verdict.NOT_RUN}:
            judgement = each.judgement
            key = (judgement.dut, judgement.metric, judgement.scope, judgement.verdict, each.reason)
            steps[key] = steps.get(key, 0) + 1
    for (dut, metric, scope, verdict, reason), count in steps.items():
        name = metric_text(metric, scope)
        yield Cell(shown(dut)), Cell(name), verdict_cell(verdict), Cell(str(count)), Cell(shown(reason))


def camera(cycle: Cycle) -> list[Block]:
    """K and distortion of each DUT at the temperature of comparison, with intervals, and the change."""
    attempt = cycle.at_temperature(cycle.reference_c)
    if attempt is None:
        return [Text(text="K was not measured: no step was finished.", tone="not_run")]
    then = cycle.reference.attempts[-1] if cycle.reference is not None else None
    rows = []
    for dut in cycle.record.identity.duts:
        now = _by_name(attempt, dut.serial)
        before = _by_name(then, dut.serial) if then is not None else {}
        wanted = [*CAMERA, *sorted(key for key in now if key[0] == "distortion")]
        for key in wanted:
            change = now.get((f"{key[0]}_change", key[1]))
            measured = now.get(key)
            reason = "" if measured is None or measured.value is not None else shown(measured.reason)
            rows.append(
                (
                    Cell(shown(dut.serial)),
                    Cell(key[1]),
                    Cell(reason or value_text(measured)),
                    Cell(value_text(before.get(key))),
                    Cell(_change_text(change, measured, before.get(key))),
                )
            )
    begin = attempt.begin
    return [
        Table(
            title="Camera matrix K and distortion, with 95 % intervals",
            header=(
                "DUT",
                "Parameter",
                f"At {begin.set_temperature_c:g} °C ({shown(begin.step_id)})",
                "Reference",
                "Change",
            ),
            rows=tuple(rows),
            weights=(1.8, 1.0, 2.6, 2.4, 2.4),
        )
    ]


def _by_name(attempt: AttemptRecord, serial: str) -> dict[tuple[str, str], Measurement]:
    return {(each.metric, each.scope): each for each in attempt.measurements if each.dut == serial}


def _change_text(change: Measurement | None, now: Measurement | None, then: Measurement | None) -> str:
    if change is not None and change.value is not None:
        return value_text(change)
    if now is None or then is None or now.value is None or then.value is None or now.unit != then.unit:
        return NOTHING
    return f"{convert(now.value - then.value, now.unit, now.unit):.2g}"
