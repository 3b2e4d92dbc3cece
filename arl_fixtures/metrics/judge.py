"""Measurements against limits: one verdict each, with the risk of accepting what is not within the limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from scipy.special import stdtr

from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.instruments import EVERY_VALUE
from arl_fixtures.metrics.limits import Decision, Limit, LimitSet, Rule, Severity
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.registry import metric_instruments
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.quantity import Quantity, convert


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """A measurement, the limit it was held against and what follows.

    Attributes:
        measurement: what was measured; its quantity keeps the unit it was measured in.
        limit: None for a value that no limit applies to: it is reported and decides nothing.
        verdict: by the decision rule.
        risk: probability that the true value lies outside the limits, given the measured one and its uncertainty:
            the risk of false acceptance if it is accepted. NaN where nothing was measured or no limit applies.
        reason: one line for the reader of the report.
    """

    measurement: Measurement
    limit: Limit | None
    verdict: Verdict
    risk: float
    reason: str

    @property
    def decides(self) -> bool:
        """Whether it counts for the verdict of its step."""
        return self.limit is not None


def judge(
    measurements: Iterable[Measurement],
    limits: LimitSet,
    conditions: Conditions,
    dut_types: dict[str, str] | None = None,
) -> list[Judgement]:
    """Judge every measurement by every limit that applies to it.

    A limit that applies to a DUT of the step whose metric brought no measurement for it is judged NOT_RUN, so that
    nothing a file asks for is left out silently. A step that did not settle is INVALID throughout: its values are
    kept, but they were not taken at the temperature they would be judged for. So is a value that rests on an
    instrument whose calibration had expired.

    Args:
        measurements: of one step, any number of DUTs.
        limits: the limits file.
        conditions: of the step.
        dut_types: type of each DUT by serial number, for limits that name types.

    Raises:
        UnitError: a limit's unit is of another dimension than its metric's.
    """
    types = dut_types or {}
    judgements: list[Judgement] = []
    met: set[tuple[int, str, str]] = set()
    duts: dict[str, None] = {}
    for measurement in measurements:
        duts.setdefault(measurement.dut)
        # a metric that could not be measured at all could not be measured in any scope
        scope = None if measurement.quantity is None and not measurement.scope else measurement.scope
        applying = [
            limit
            for limit in limits.by_metric.get(measurement.metric, ())
            if _applies(limit, conditions, measurement.dut, types.get(measurement.dut, ""), scope)
        ]
        for limit in applying:
            scopes = (limit.where.scope or ("",)) if scope is None else (scope if limit.where.scope else "",)
            met.update((id(limit), measurement.dut, each) for each in scopes)
        judgements += [_judge_one(measurement, limit, limits.decision_of(limit), conditions) for limit in applying]
        if not applying:
            judgements.append(_unlimited(measurement))
    for dut in duts:
        for limit in limits.limits:
            if _applies(limit, conditions, dut, types.get(dut, ""), None):
                scopes = limit.where.scope or ("",)
                judgements += [_missing(limit, dut, scope) for scope in scopes if (id(limit), dut, scope) not in met]
    return judgements


def overall(judgements: Sequence[Judgement]) -> tuple[Verdict, Judgement | None]:
    """The worst verdict and the first judgement that has it; values without a limit decide nothing."""
    deciding = [judgement for judgement in judgements if judgement.decides]
    verdict = worst(judgement.verdict for judgement in deciding)
    return verdict, next((judgement for judgement in deciding if judgement.verdict is verdict), None)


def risk_outside(quantity: Quantity, lower: float | None, upper: float | None) -> float:
    """Probability that the true value lies outside the limits (JCGM 106:2012, 9.3, without prior knowledge).

    Args:
        quantity: the measured value; Student's t with its degrees of freedom describes what is known of the truth.
        lower: lower limit in the quantity's unit, None for none.
        upper: upper limit in the quantity's unit, None for none.
    """
    low = -math.inf if lower is None else lower
    high = math.inf if upper is None else upper
    if quantity.u == 0.0:
        return 0.0 if low <= quantity.value <= high else 1.0
    dof = min(quantity.dof, 1e9)
    below = float(stdtr(dof, (low - quantity.value) / quantity.u))
    above = float(stdtr(dof, (quantity.value - high) / quantity.u))
    return min(1.0, below + above)


def decide(quantity: Quantity, lower: float | None, upper: float | None, decision: Decision) -> Verdict:
    """Apply the decision rule; limits in the quantity's unit."""
    low = -math.inf if lower is None else lower
    high = math.inf if upper is None else upper
    guard = 0.0
    if decision.rule is Rule.GUARD_BAND and quantity.u > 0.0:
        guard = decision.guard_factor * quantity.expanded(decision.coverage)
    if low + guard <= quantity.value <= high - guard:
        return Verdict.PASS
    if quantity.value > high + guard or quantity.value < low - guard:
        return Verdict.FAIL
    return Verdict.CONDITIONAL


def _judge_one(measurement: Measurement, limit: Limit, decision: Decision, conditions: Conditions) -> Judgement:
    quantity = measurement.quantity
    if quantity is None:
        verdict = Verdict.INVALID if measurement.attempted else Verdict.NOT_RUN
        return _judgement(measurement, limit, verdict, math.nan, measurement.reason)
    # converting refuses a foreign dimension even where the step turns out to be invalid
    lower, upper = (
        None if bound is None else convert(bound, limit.unit, quantity.unit) for bound in (limit.lower, limit.upper)
    )
    if not math.isfinite(quantity.value) or not math.isfinite(quantity.u):
        return _judgement(measurement, limit, Verdict.INVALID, math.nan, "the value is not finite")
    risk = risk_outside(quantity, lower, upper)
    if not conditions.settled:
        reason = conditions.unsettled_reason or "temperature not settled"
        return _judgement(measurement, limit, Verdict.INVALID, risk, reason)
    if conditions.expired:
        needed = metric_instruments().get(measurement.metric, EVERY_VALUE)
        reasons = [conditions.expired[role] for role in needed if role in conditions.expired]
        if reasons:
            return _judgement(measurement, limit, Verdict.INVALID, risk, "; ".join(reasons))
    verdict = decide(quantity, lower, upper, decision)
    reason = _said(verdict, quantity, limit, decision)
    if verdict is Verdict.FAIL and limit.severity is Severity.MINOR:
        verdict, reason = Verdict.CONDITIONAL, f"{reason} (minor)"
    return _judgement(measurement, limit, verdict, risk, reason)


def _said(verdict: Verdict, quantity: Quantity, limit: Limit, decision: Decision) -> str:
    if verdict is Verdict.PASS:
        return f"within {limit}"
    if verdict is Verdict.FAIL:
        return f"outside {limit}"
    expanded = quantity.to(limit.unit).expanded(decision.coverage)
    return f"closer to {limit} than its uncertainty allows to tell (U = {expanded:.2g} {limit.unit})"


def _unlimited(measurement: Measurement) -> Judgement:
    if measurement.quantity is not None:
        return _judgement(measurement, None, Verdict.PASS, math.nan, measurement.reason or "no limit: reported only")
    verdict = Verdict.INVALID if measurement.attempted else Verdict.NOT_RUN
    return _judgement(measurement, None, verdict, math.nan, measurement.reason)


def _missing(limit: Limit, dut: str, scope: str) -> Judgement:
    nothing = Measurement(
        metric=limit.metric, dut=dut, scope=scope, reason="a limit applies, but nothing measured it", attempted=False
    )
    return _judgement(nothing, limit, Verdict.NOT_RUN, math.nan, nothing.reason)


def _judgement(
    measurement: Measurement, limit: Limit | None, verdict: Verdict, risk: float, reason: str
) -> Judgement:
    return Judgement(measurement=measurement, limit=limit, verdict=verdict, risk=risk, reason=reason)


def _applies(limit: Limit, conditions: Conditions, dut: str, dut_type: str, scope: str | None) -> bool:
    where = limit.where
    temperature_c = where.set_temperature_c
    return (
        (temperature_c is None or temperature_c[0] <= conditions.set_temperature_c <= temperature_c[1])
        and (where.ramp is None or conditions.ramp in where.ramp)
        and (where.dut is None or dut in where.dut)
        and (where.dut_type is None or dut_type in where.dut_type)
        and (where.scope is None or scope is None or scope in where.scope)
    )
