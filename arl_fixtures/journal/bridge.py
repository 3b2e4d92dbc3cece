"""Between what metrics and judging make and what a journal says. Going there and back loses nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from arl_fixtures.journal.entries import AppliedLimit, Contribution, JournalModel, Judgement, Measurement
from arl_fixtures.journal.record import AttemptRecord
from arl_fixtures.metrics import judge as judging
from arl_fixtures.metrics import measurement as measuring
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.instruments import expired_instruments
from arl_fixtures.metrics.limits import LimitSet
from arl_fixtures.quantity import Contribution as Part
from arl_fixtures.quantity import Kind, Quantity


def measurement_entry(step_id: str, attempt: int, measurement: measuring.Measurement) -> Measurement:
    """A measurement as a line."""
    quantity = measurement.quantity
    return Measurement(
        step_id=step_id,
        attempt=attempt,
        dut=measurement.dut,
        metric=measurement.metric,
        scope=measurement.scope,
        value=None if quantity is None else float(quantity.value),
        unit="" if quantity is None else quantity.unit,
        u=None if quantity is None else float(quantity.u),
        dof=None if quantity is None else float(quantity.dof),
        contributions=() if quantity is None else tuple(_contribution(part) for part in quantity.contributions),
        reason=measurement.reason,
        attempted=measurement.attempted,
        reference=measurement.reference,
    )


def _contribution(part: Part) -> Contribution:
    return Contribution(name=part.name, u=float(part.u), kind=part.kind.value, dof=float(part.dof))


def measurement_of(entry: Measurement) -> measuring.Measurement:
    """A line as the measurement it was made from."""
    quantity = None
    if entry.value is not None:
        quantity = Quantity(
            value=entry.value,
            unit=entry.unit,
            u=0.0 if entry.u is None else entry.u,
            dof=math.inf if entry.dof is None else entry.dof,
            contributions=tuple(Part(part.name, part.u, Kind(part.kind), part.dof) for part in entry.contributions),
        )
    return measuring.Measurement(
        metric=entry.metric,
        dut=entry.dut,
        scope=entry.scope,
        quantity=quantity,
        reason=entry.reason,
        attempted=entry.attempted,
        reference=entry.reference,
    )


def judgement_entry(step_id: str, attempt: int, judgement: judging.Judgement, limits: LimitSet) -> Judgement:
    """A judgement as a line, with the limit and the rule that were applied."""
    limit = judgement.limit
    applied = None
    if limit is not None:
        decision = limits.decision_of(limit)
        applied = AppliedLimit(
            unit=limit.unit,
            lower=limit.lower,
            upper=limit.upper,
            severity=limit.severity.value,
            reason=limit.reason,
            rule=decision.rule.value,
            coverage=decision.coverage,
            guard_factor=decision.guard_factor,
        )
    return Judgement(
        step_id=step_id,
        attempt=attempt,
        dut=judgement.measurement.dut,
        metric=judgement.measurement.metric,
        scope=judgement.measurement.scope,
        limit=applied,
        verdict=judgement.verdict.value,
        risk=float(judgement.risk),
        reason=judgement.reason,
    )


def result_entries(
    step_id: str, attempt: int, judgements: Sequence[judging.Judgement], limits: LimitSet
) -> list[JournalModel]:
    """All lines of an attempt's results: each measurement once, however many limits it was held against."""
    entries: list[JournalModel] = []
    journalled: set[int] = set()
    for judgement in judgements:
        if id(judgement.measurement) not in journalled:
            journalled.add(id(judgement.measurement))
            entries.append(measurement_entry(step_id, attempt, judgement.measurement))
        entries.append(judgement_entry(step_id, attempt, judgement, limits))
    return entries


def conditions_of(attempt: AttemptRecord, environment: Mapping[str, str]) -> Conditions:
    """Under what conditions an attempt was measured.

    Args:
        attempt: of a journal.
        environment: that the journal begins with; it says when the instruments' calibrations run out.
    """
    begin, settle = attempt.begin, attempt.settle
    return Conditions(
        cycle=begin.cycle,
        step_index=begin.step_index,
        set_temperature_c=begin.set_temperature_c,
        ramp=begin.ramp,
        settled=settle.settled if settle is not None else True,
        unsettled_reason=settle.reason if settle is not None else "",
        expired=expired_instruments(environment, attempt.begin_utc_ns),
        temperatures_c=attempt.end.temperatures_c if attempt.end is not None else {},
    )
