"""The whole report, put together from cycles; how it looks is left to HTML and PDF."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.report import figures, over_cycles, sections
from arl_fixtures.report.blocks import (
    Block,
    Cell,
    Facts,
    Picture,
    Report,
    Section,
    Signatures,
    Table,
    Text,
    verdict_cell,
)
from arl_fixtures.report.cycles import Cycle
from arl_fixtures.report.events import events
from arl_fixtures.report.foretelling import foretelling
from arl_fixtures.report.lifetime import LifetimeModel
from arl_fixtures.report.maps import MapMaker
from arl_fixtures.report.results import result_rows
from arl_fixtures.report.text import metric_text, shown, utc_text

OVER_TEMPERATURE: Final = (
    ("power_change", ""),
    ("power_worst_3x3", ""),
    ("distance_error", "stripe_50"),
    ("distance_scatter_change", "stripe_50"),
    ("focal_length_change", "fx"),
    ("principal_point_change", "cx"),
)
OF_ONE_DRAWING: Final = 3
MAPS: Final = "Maps: P_o, its change, σ, ΔD"
TITLE: Final = "Qualification report"
MOST_CYCLES: Final = 20
ROLES: Final = ("Tested by", "Reviewed by", "Released by")


def make_report(
    cycles: Sequence[Cycle], maps: MapMaker, lifetime: LifetimeModel | None = None, map_steps: Sequence[str] = ()
) -> Report:
    """The report of some cycles; details are those of the newest.

    Args:
        cycles: at least one, in order.
        maps: where maps come from.
        lifetime: what cycles are worth in use; None where that is not wanted.
        map_steps: of which steps of the newest cycle there are maps, see `Cycle.selected`.

    Raises:
        DataError: a step of `map_steps` is not there.
    """
    newest = cycles[-1]
    pictures: dict[str, bytes] = {}
    body = [
        sections.identity(newest),
        sections.decision(newest),
        *([_all_cycles(cycles)] if len(cycles) > 1 else []),
        sections.verdicts(newest),
        *_shortfalls(cycles),
        _temperatures(newest, pictures),
        _maps(newest, maps, pictures, map_steps),
        _over_temperature(newest, pictures),
        *([over_cycles.trends(cycles, pictures)] if len(cycles) > 1 else []),
        over_cycles.lifetime(cycles, lifetime),
        foretelling(cycles, pictures),
        *(events(record) for record in {cycle.record.path: cycle.record for cycle in cycles}.values()),
    ]
    verdict = worst(cycle.verdict for cycle in cycles)
    deciding = next(cycle for cycle in cycles if cycle.verdict is verdict)
    serials = ", ".join(shown(dut.serial) for dut in newest.record.identity.duts)
    numbers = f"cycle {newest.number}" if len(cycles) == 1 else f"cycles {cycles[0].number} to {newest.number}"
    said = deciding.decided_by
    subtitle = f"{serials} – {shown(newest.record.begin.campaign)}, {numbers}"
    body.append(_signatures(cycles, subtitle, verdict_cell(verdict.value)))
    return Report(
        title=TITLE,
        subtitle=subtitle,
        verdict=verdict_cell(verdict.value),
        decided_by=f"cycle {deciding.number}, {said}" if said and len(cycles) > 1 else said,
        banner=_banner(cycles),
        sections=tuple(body),
        footer=f"{shown(newest.record.begin.campaign)}, {numbers}, until {utc_text(newest.end_utc_ns)}",
        pictures=pictures,
    )


def _signatures(cycles: Sequence[Cycle], subtitle: str, verdict: Cell) -> Section:
    """Who signs, and what: the page may part from the others."""
    journals = dict.fromkeys(cycle.record.path for cycle in cycles)
    hashes = ((shown(path.name), hashlib.sha256(path.read_bytes()).hexdigest()) for path in journals)
    rows = (
        ("Signed for", Cell(subtitle)),
        ("Verdict", verdict),
        *(("Journal", Cell(f"{name}, SHA-256 {digest}")) for name, digest in hashes),
    )
    return Section(title="Signatures", blocks=(Facts(rows=rows), Signatures(roles=ROLES)))


def _shortfalls(cycles: Sequence[Cycle]) -> list[Section]:
    """What is not PASS: of every cycle that has such a thing, and of the newest in any case."""
    if len(cycles) == 1:
        return [sections.shortfalls(cycles[0])]
    told = [
        cycle
        for cycle in cycles
        if cycle is cycles[-1]
        or cycle.verdict is not Verdict.PASS
        or not all(attempt.finished for attempt in cycle.attempts)
    ]
    found = [
        replace(sections.shortfalls(cycle), title=f"Cycle {cycle.number}: what is not PASS, and why")
        for cycle in told[-MOST_CYCLES:]
    ]
    if len(told) > MOST_CYCLES:
        left_out = (
            f"{len(told) - MOST_CYCLES} earlier cycles with such findings are left out: report them by themselves."
        )
        found[0] = replace(found[0], blocks=(Text(text=left_out, tone="conditional"), *found[0].blocks))
    return found


def _banner(cycles: Sequence[Cycle]) -> str:
    """What must not be overlooked: re-judgement, expired instruments, an open safe stop."""
    said: dict[str, None] = {}
    for cycle in cycles:
        record = cycle.record
        if record.begin.rejudged_from:
            who = record.identity
            said[
                f"RE-JUDGEMENT: the measurements of {shown(record.begin.rejudged_from)} were judged anew against "
                f"limits '{shown(who.limits_name)}' (SHA-256 {who.limits_sha256[:12]}…). "
                "Verdicts are not those of the test."
            ] = None
        expired = sections.expired_instruments(cycle)
        if expired:
            said[f"CALIBRATION EXPIRED before a cycle's end: {', '.join(expired)}."] = None
        if record.unacknowledged():
            said[f"SAFE STOP not acknowledged in {shown(record.path.name)}."] = None
    return " ".join(said)


def _all_cycles(cycles: Sequence[Cycle]) -> Section:
    rows = tuple(
        (
            Cell(str(cycle.number)),
            Cell(shown(cycle.record.path.name)),
            Cell(utc_text(cycle.end_utc_ns)),
            Cell(f"{sum(step.finished for step in cycle.steps.values())} of {len(cycle.planned)}"),
            verdict_cell(cycle.verdict.value),
            Cell(cycle.decided_by or "–"),
        )
        for cycle in cycles
    )
    table = Table(
        header=("Cycle", "Journal", "Ended", "Steps finished", "Verdict", "Decided by"),
        rows=rows,
        weights=(0.8, 2.0, 2.2, 1.3, 1.5, 3.2),
        note=f"Tables, maps and drawings of a single cycle in this report are those of cycle {cycles[-1].number}.",
    )
    return Section(title="Cycles", blocks=(table,))


def _temperatures(cycle: Cycle, pictures: dict[str, bytes]) -> Section:
    if not any(attempt.end is not None and attempt.end.temperatures_c for attempt in cycle.attempts):
        missing = Text(text="The journal holds no temperatures.", tone="not_run")
        return Section(title="Temperatures", blocks=(missing,))
    pictures["temperatures.svg"] = figures.temperatures(cycle)
    picture = Picture(
        name="temperatures.svg",
        caption="Mean of each sensor over each step's sweep, at its end; bars: set temperature from the step's begin "
        "to its end. Below: sensors that follow the set temperature, less that.",
        alt="Temperatures of the bench's sensors over the cycle, with the set temperatures",
        share=0.6,
    )
    return Section(title="Temperatures against set-points", blocks=(picture,))


def _maps(cycle: Cycle, maps: MapMaker, pictures: dict[str, bytes], wanted: Sequence[str]) -> Section:
    attempts = cycle.selected(wanted)
    if not attempts:
        missing = Text(text="No step was finished: there are no maps.", tone="not_run")
        return Section(title=MAPS, blocks=(missing,))
    steps = "; ".join(f"{shown(each.begin.step_id)} (set {each.begin.set_temperature_c:g} °C)" for each in attempts)
    blocks: list[Block] = [
        Text(
            text=f"Measured anew from the bags of {steps}. Rows v and columns u as in the image; white pixels have "
            "no value. Colours mean the same in all maps of one quantity of one DUT, and span the 1st to the 99th "
            "percentile."
        )
    ]
    found = [maps.of_attempt(cycle.record, attempt) for attempt in attempts]
    reasons: dict[str, dict[str, None]] = {}
    for number, dut in enumerate(cycle.record.identity.duts, start=1):
        own = [each[dut.serial] for each in found]
        scales = figures.common_scales(own)
        for place, (attempt, sheet) in enumerate(zip(attempts, own, strict=True), start=1):
            begin = attempt.begin
            at = f"{begin.set_temperature_c:g} °C, {'heating' if begin.ramp > 0 else 'cooling'}"
            for each in sheet:
                if each.reason:
                    reasons.setdefault(each.reason, {})[begin.step_id] = None
            if all(each.values is None for each in sheet):
                continue
            name = f"maps-{number}-{place}.png"
            pictures[name] = figures.map_sheet(sheet, scales)
            alt = f"Maps of {shown(dut.serial)} at {at}: " + "; ".join(each.title for each in sheet)
            blocks.append(Picture(name=name, caption=f"DUT {shown(dut.serial)} at {at}", alt=alt, share=0.49))
    blocks += [
        Text(text=f"Missing of {', '.join(shown(each) for each in where)}: {shown(reason)}", tone="conditional")
        for reason, where in reasons.items()
    ]
    return Section(title=MAPS, blocks=tuple(blocks))


def _over_temperature(cycle: Cycle, pictures: dict[str, bytes]) -> Section:
    limits = {(row.metric, row.scope): row.limit for row in result_rows(cycle.finished)}
    measured = {
        (each.metric, each.scope)
        for attempt in cycle.finished
        for each in attempt.measurements
        if each.value is not None
    }
    there = [key for key in OVER_TEMPERATURE if key in measured]
    blocks = sections.camera(cycle)
    if there:
        for place, start in enumerate(range(0, len(there), OF_ONE_DRAWING), start=1):
            together = there[start : start + OF_ONE_DRAWING]
            name = f"over-temperature-{place}.svg"
            pictures[name] = figures.over_temperature(cycle, together, limits)
            blocks.append(
                Picture(
                    name=name,
                    caption="Over the set temperature, with 95 % intervals; dashed: limits near enough to be drawn.",
                    alt=f"{', '.join(metric_text(*key) for key in together)} over the set temperature",
                    share=0.49,
                )
            )
    return Section(title="K, and metrics over temperature", blocks=tuple(blocks))
