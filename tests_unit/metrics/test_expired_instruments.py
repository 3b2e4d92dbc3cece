"""An instrument whose calibration ran out makes INVALID what rests on it, unless the bench file says why not."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.instruments import expired_instruments
from arl_fixtures.metrics.judge import judge
from arl_fixtures.metrics.limits import Limit, LimitSet
from arl_fixtures.metrics.measurement import Measurement
from arl_fixtures.metrics.reference import NotMeasurableError, Reference
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.quantity import Quantity

NOON_NS = int(datetime(2026, 3, 2, 12, tzinfo=UTC).timestamp() * 1e9)


@pytest.mark.parametrize(
    ("due", "accepted", "expired"),
    [
        ("2026-03-01", "", True),
        ("2026-03-02", "", False),
        ("", "", False),
        ("2026-03-01", "spare is at the calibration laboratory, checked against ice", False),
        ("someday", "", False),
    ],
)
def test_the_last_day_counts_and_only_a_stated_reason_goes_beyond_it(due, accepted, expired):
    said = {"stage.calibration_due": due, "stage.accept_expired": accepted, "stage.url": "emulated"}
    assert ("stage" in expired_instruments(said, NOON_NS)) is expired


def verdicts(*expired: str) -> dict[str, tuple[Verdict, str]]:
    values = {"distance_error": "%", "dead_pixels": "1", "of_a_plug_in": "1"}
    measured = [Measurement(metric=name, dut="A", quantity=Quantity(0.0, unit)) for name, unit in values.items()]
    limits = LimitSet(
        name="test",
        version=1,
        limits=tuple(Limit(metric=name, unit=unit, upper=1.0, reason="r") for name, unit in values.items()),
    )
    reasons = expired_instruments({f"{role}.calibration_due": "2026-02-20" for role in expired}, NOON_NS)
    judged = judge(measured, limits, Conditions(set_temperature_c=25.0, expired=reasons))
    return {each.measurement.metric: (each.verdict, each.reason) for each in judged}


def test_without_a_thermometer_nothing_is_known_of_the_temperature():
    found = verdicts("thermometer")
    assert {verdict for verdict, _ in found.values()} == {Verdict.INVALID}
    assert found["dead_pixels"][1] == "calibration of the thermometer expired on 2026-02-20, 10 days before"


def test_without_a_stage_a_dead_pixel_is_dead_all_the_same():
    found = verdicts("stage")
    assert found["distance_error"][0] is Verdict.INVALID
    assert found["of_a_plug_in"][0] is Verdict.INVALID
    assert found["dead_pixels"][0] is Verdict.PASS


def test_chiller_and_relays_vouch_for_no_value():
    assert {verdict for verdict, _ in verdicts("chiller", "relays").values()} == {Verdict.PASS}


def test_a_reference_recorded_with_an_expired_instrument_serves_nobody_even_after_a_restart(tmp_path):
    why = "calibration of the stage expired"
    doubtful = Reference(serial="A", identity="cycle 0", set_temperature_c=25.0, doubt=why)
    doubtful.save(tmp_path / "A.npz")
    with pytest.raises(NotMeasurableError, match=r"cycle 0.*calibration of the stage expired"):
        Reference.load(tmp_path / "A.npz").check("A", 0)
