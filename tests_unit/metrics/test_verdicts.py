"""Verdicts: their algebra, decision rules, risks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arl_fixtures.errors import UnitError
from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.judge import decide, judge, overall, risk_outside
from arl_fixtures.metrics.limits import Decision, Limit, LimitSet, Rule, Severity, Where
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.verdict import Verdict, worst
from arl_fixtures.quantity import Quantity

VERDICTS = st.sampled_from(Verdict)
CONDITIONS = Conditions(set_temperature_c=25.0)
SIMPLE, GUARDED = Decision(rule=Rule.SIMPLE), Decision()


def limit_set(*limits: Limit) -> LimitSet:
    return LimitSet(name="test", version=1, limits=limits)


def a_limit(**more: object) -> Limit:
    return Limit.model_validate({"metric": "length", "unit": "m", "upper": 1.0, "reason": "r", **more})


def measured(value: float = 0.5, u: float = 0.0, unit: str = "m", **more: object) -> Measurement:
    return Measurement(**{"metric": "length", "dut": "A", "quantity": Quantity(value, unit, u), **more})  # type: ignore[arg-type]  # built from parts


@settings(deadline=None)
@given(VERDICTS, VERDICTS, VERDICTS)
def test_worst_of_is_a_semilattice_with_pass_as_its_least(a, b, c):
    assert (a | b) is (b | a)
    assert ((a | b) | c) is (a | (b | c))
    assert (a | a) is a
    assert (a | Verdict.PASS) is a
    assert (a | Verdict.FAIL) is Verdict.FAIL


@settings(deadline=None)
@given(st.lists(VERDICTS, min_size=1), st.randoms())
def test_worst_does_not_depend_on_order_or_grouping(verdicts, random):
    shuffled = random.sample(verdicts, len(verdicts))
    cut = random.randint(0, len(verdicts))
    assert worst(shuffled) is worst(verdicts)
    parts = [worst(part) for part in (verdicts[:cut], verdicts[cut:]) if part]
    assert worst(parts) is worst(verdicts)


def test_nothing_shown_is_not_a_pass():
    assert worst([]) is Verdict.NOT_RUN


@settings(deadline=None)
@given(st.floats(-5, 5), st.just(0.0) | st.floats(1e-9, 2), st.floats(2, 100))
def test_guarding_never_turns_a_doubt_into_a_certainty(value, u, dof):
    quantity = Quantity(value, "m", u, dof)
    simple, guarded = (decide(quantity, -1.0, 1.0, rule) for rule in (SIMPLE, GUARDED))
    assert guarded in {simple, Verdict.CONDITIONAL}
    risk = risk_outside(quantity, -1.0, 1.0)
    if guarded is Verdict.PASS and u > 0:
        assert risk <= 0.05 + 1e-12
    if guarded is Verdict.FAIL and u > 0:
        assert risk >= 0.95 - 1e-12


def test_a_one_sided_guard_band_keeps_the_risk_below_two_and_a_half_percent():
    quantity = Quantity(1.0 - 1.96 * 0.1, "m", 0.1)
    assert decide(quantity, None, 1.0, GUARDED) is Verdict.PASS
    assert risk_outside(quantity, None, 1.0) == pytest.approx(0.025, abs=2e-4)
    at_the_limit = Quantity(1.0, "m", 0.1)
    assert decide(at_the_limit, None, 1.0, SIMPLE) is Verdict.PASS
    assert risk_outside(at_the_limit, None, 1.0) == pytest.approx(0.5)


def test_risk_is_the_share_of_true_values_outside():
    rng = np.random.default_rng(1)
    truth = 0.93 + 0.08 * rng.standard_t(7, size=400_000)
    share = np.mean((truth > 1.0) | (truth < 0.9))
    assert risk_outside(Quantity(0.93, "m", 0.08, 7), 0.9, 1.0) == pytest.approx(share, abs=0.003)


def test_an_exact_value_is_decided_without_doubt():
    assert decide(Quantity(8.0, "1"), None, 8.0, GUARDED) is Verdict.PASS
    assert decide(Quantity(9.0, "1"), None, 8.0, GUARDED) is Verdict.FAIL
    assert risk_outside(Quantity(9.0, "1"), None, 8.0) == 1.0


def test_a_limit_in_another_scale_is_converted_never_relabelled():
    (judgement,) = judge([measured(0.5)], limit_set(a_limit(unit="mm", upper=400)), CONDITIONS)
    assert judgement.verdict is Verdict.FAIL
    (judgement,) = judge([measured(0.5)], limit_set(a_limit(unit="mm", upper=600)), CONDITIONS)
    assert judgement.verdict is Verdict.PASS
    assert judgement.measurement.quantity.unit == "m"


def test_a_limit_of_a_foreign_dimension_is_an_error_even_when_the_step_is_invalid():
    unsettled = Conditions(set_temperature_c=25.0, settled=False, unsettled_reason="T2 3.1 K off")
    with pytest.raises(UnitError):
        judge([measured()], limit_set(a_limit(unit="s")), unsettled)


def test_an_unsettled_step_is_invalid_and_says_why():
    unsettled = Conditions(set_temperature_c=25.0, settled=False, unsettled_reason="T2 3.1 K off")
    (judgement,) = judge([measured(5.0)], limit_set(a_limit()), unsettled)
    assert judgement.verdict is Verdict.INVALID
    assert judgement.reason == "T2 3.1 K off"


def test_what_was_not_measured_is_invalid_and_what_was_not_tried_not_run():
    limits = limit_set(a_limit())
    broken = measured(quantity=None, reason="bag cut")
    early = measured(quantity=None, reason="no reference yet", attempted=False)
    assert [j.verdict for j in judge([broken], limits, CONDITIONS)] == [Verdict.INVALID]
    assert [j.verdict for j in judge([early], limits, CONDITIONS)] == [Verdict.NOT_RUN]


def test_a_limit_that_nothing_was_measured_for_is_not_run_for_each_scope_and_dut():
    limits = limit_set(a_limit(where={"scope": ("x", "y")}), a_limit(metric="other"))
    judgements = judge([measured(scope="x"), measured(metric="third", dut="B")], limits, CONDITIONS)
    missing = {
        (j.measurement.dut, j.measurement.metric, j.measurement.scope)
        for j in judgements
        if j.reason.startswith("a limit applies")
    }
    assert missing == {
        ("A", "length", "y"),
        ("A", "other", ""),
        ("B", "length", "x"),
        ("B", "length", "y"),
        ("B", "other", ""),
    }
    assert overall(judgements)[0] is Verdict.NOT_RUN


def test_a_metric_that_failed_as_a_whole_is_invalid_for_the_limits_of_its_scopes():
    limits = limit_set(a_limit(where={"scope": ("x", "y")}))
    judgements = judge([measured(quantity=None, reason="bag cut")], limits, CONDITIONS)
    assert [(j.verdict, j.reason) for j in judgements] == [(Verdict.INVALID, "bag cut")]
    assert overall(judgements)[0] is Verdict.INVALID


def test_limits_apply_where_they_say():
    where = Where(set_temperature_c=(60.0, 85.0), ramp=(1,), dut_type=("hfl110",), scope=("s",))
    limits = limit_set(a_limit(where=where, upper=0.1), a_limit(metric="never", where={"dut": ("B",)}))
    hot = Conditions(set_temperature_c=85.0, ramp=1)
    types = {"A": "hfl110"}

    def verdicts(conditions: Conditions, kinds: dict[str, str], scope: str = "s") -> list[Verdict]:
        return [j.verdict for j in judge([measured(scope=scope)], limits, conditions, kinds) if j.decides]

    assert verdicts(hot, types) == [Verdict.FAIL]
    assert verdicts(Conditions(set_temperature_c=85.0, ramp=-1), types) == []
    assert verdicts(CONDITIONS, types) == []
    assert verdicts(hot, {"A": "other"}) == []
    assert verdicts(hot, types, scope="t") == [Verdict.NOT_RUN]


def test_a_minor_limit_exceeded_is_conditional():
    (judgement,) = judge([measured(2.0)], limit_set(a_limit(severity=Severity.MINOR)), CONDITIONS)
    assert judgement.verdict is Verdict.CONDITIONAL
    assert "minor" in judgement.reason


def test_a_value_without_a_limit_is_reported_and_decides_nothing():
    judgements = judge(
        [measured(), measured(metric="free", quantity=None, reason="gone")], limit_set(a_limit()), CONDITIONS
    )
    verdict, deciding = overall(judgements)
    assert verdict is Verdict.PASS
    assert deciding.measurement.metric == "length"
    assert [j.verdict for j in judgements if not j.decides] == [Verdict.INVALID]


def test_the_overall_verdict_names_the_first_that_decided():
    judgements = judge([measured(0.5), measured(2.0, dut="B")], limit_set(a_limit()), CONDITIONS)
    verdict, deciding = overall(judgements)
    assert (verdict, deciding.measurement.dut) == (Verdict.FAIL, "B")


@pytest.mark.parametrize(("value", "u"), [(math.nan, 0.1), (math.inf, 0.1), (0.5, math.inf)])
def test_a_value_that_is_no_number_is_invalid(value, u):
    (judgement,) = judge([measured(value, u)], limit_set(a_limit()), CONDITIONS)
    assert judgement.verdict is Verdict.INVALID
