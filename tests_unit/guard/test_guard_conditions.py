"""Each kind of condition trips where it should, says which sensor and how far, and not before."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from arl_fixtures.bench.guard_settings import DEFAULT_CONDITIONS, Condition, GuardSettings
from arl_fixtures.devices.interfaces import ChillerStatus
from arl_fixtures.errors import ConfigError
from arl_fixtures.guard.conditions import ConditionWatch, Sample
from arl_fixtures.yaml_model import load_model

HOUSINGS = ("T2", "T3", "T4")


def look(time_s, housings=(25.0, 25.0, 25.0), **others):
    temperatures = dict(zip(HOUSINGS, housings, strict=True)) | {
        name: others.pop(name) for name in ("plate", "coolant", "ambient") if name in others
    }
    return Sample(time_s=time_s, temperatures_c=temperatures, housings=HOUSINGS, **others)


def chiller(**changes):
    healthy = {
        "controlling": True, "circulating": True, "error_code": 0, "warning_code": 0,
        "level_percent": 80.0, "pump_mbar": 1300.0, "pumping": True,
    }  # fmt: skip
    return ChillerStatus(**(healthy | changes))


def detail(condition, *samples):
    """What the watch says after the last sample, all before must be quiet."""
    watch = ConditionWatch(condition)
    for earlier in samples[:-1]:
        assert watch.see(earlier) is None
    found = watch.see(samples[-1])
    return None if found is None else found.detail


def test_ceiling_and_floor_name_the_sensor():
    ceiling, floor = Condition(watch="housings", ceiling=95), Condition(watch="coolant", floor=-30)
    assert detail(ceiling, look(0, (95.0, 94.0, 25.0))) is None
    assert detail(ceiling, look(0, (25.0, 95.1, 25.0))) == "T3 reads 95.1 °C, above 95 °C"
    assert detail(floor, look(0, coolant=-30.5)) == "coolant reads -30.5 °C, below -30 °C"


def test_one_wrong_reading_is_forgiven_where_the_bench_file_says_so():
    condition = Condition(watch="housings", ceiling=95, for_s=1.5)
    hot, well, unknown = (200.0, 25.0, 25.0), (25.0, 25.0, 25.0), (None, None, None)
    assert detail(condition, look(0, hot), look(1, well), look(2, hot), look(3, hot)) is None
    # a reading that cannot tell neither heals nor resets
    assert "T2 reads 200.0" in (detail(condition, look(0, hot), look(1, unknown), look(2, unknown)) or "")


def test_rate_is_the_slope_of_the_window_not_of_two_neighbours():
    condition = Condition(watch="housings", rate_per_min=10, window_s=30)
    ramp = [look(t, (25 + 9.0 * t / 60, 25.0, 25.0)) for t in range(0, 60, 5)]
    assert detail(condition, *ramp) is None
    steep = [look(t, (25 + 12.0 * t / 60, 25.0, 25.0)) for t in range(0, 16, 5)]
    assert detail(condition, *steep) == "T2 changes by +12.0 K/min (limit 10 K/min)"
    falling = [look(t, (25 - 12.0 * t / 60, 25.0, 25.0)) for t in range(0, 16, 5)]
    assert "-12.0 K/min" in (detail(condition, *falling) or "")
    noisy = [look(t, (25 + 0.4 * (-1) ** t, 25.0, 25.0)) for t in range(60)]  # ±48 K/min between neighbours
    assert detail(condition, *noisy) is None


def test_staleness_counts_from_the_last_value_of_each_sensor():
    condition = Condition(watch="housings", stale_s=10)
    gone = (25.0, None, 25.0)
    assert detail(condition, look(0), look(5, gone), look(10, gone)) is None
    assert detail(condition, look(0), look(5, gone), look(10.5, gone)) == "no value of T3 for 10.5 s"
    assert detail(condition, look(0, gone), look(6), look(12, gone), look(16, gone)) is None
    # a logger that never answered at all is stale, too
    assert detail(condition, look(0, (None,) * 3), look(11, (None,) * 3)) == "no value of T2 for 11.0 s"


def test_disagreement_between_housings_and_of_a_pair():
    among = Condition(watch="housings", disagreement=8)
    assert detail(among, look(0, (25.0, 32.0, 26.0))) is None
    said = detail(among, look(0, (25.0, 36.0, 26.0)))
    assert said == "T3 reads 36.0 °C, +10.0 K from the median housing (limit 8 K)"
    pair = Condition(watch="plate", disagreement=15, against="coolant")
    assert detail(pair, look(0, plate=40.0, coolant=60.0)) == "plate reads 40.0 °C, -20.0 K from coolant (limit 15 K)"
    assert detail(pair, look(0, plate=40.0, coolant=None)) is None


@pytest.mark.parametrize(
    ("watch", "status", "said"),
    [
        ("chiller_alarm", {"error_code": -4}, "error -4"),
        ("chiller_warning", {"warning_code": -2}, "warning -2"),
        ("pump", {"pumping": False}, "the pump stands"),
    ],
)
def test_the_chillers_own_complaints(watch, status, said):
    condition = Condition(watch=watch)
    assert detail(condition, look(0, chiller=chiller())) is None
    assert said in (detail(condition, look(0, chiller=chiller(**status))) or "")
    assert detail(condition, look(0)) is None


def test_a_pump_that_was_told_to_rest_may_rest():
    assert detail(Condition(watch="pump"), look(0, chiller=chiller(pumping=False, circulating=False))) is None


def test_level_that_the_device_cannot_tell_is_no_low_level():
    condition = Condition(watch="level", floor=5)
    assert "4.0 %" in (detail(condition, look(0, chiller=chiller(level_percent=4.0))) or "")
    assert detail(condition, look(0, chiller=chiller(level_percent=None))) is None


def test_a_relay_that_differs_from_what_was_commanded():
    condition = Condition(watch="relays")
    held = {"dut_1": True, "laser_1": True}
    assert detail(condition, look(0, commanded={"dut_1": True}, read_back=held)) is None
    said = detail(condition, look(0, commanded={"dut_1": True, "laser_1": False}, read_back=held))
    assert said == "laser_1 is on, against what was commanded"


def test_silent_duts_are_named():
    condition = Condition(watch="duts", stale_s=5)
    assert detail(condition, look(0, duts_awaited_s={"A": 4.0})) is None
    assert detail(condition, look(0, duts_awaited_s={"A": 6.0, "B": 1.0})) == "no frame of A for 6.0 s"


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ({"watch": "housings"}, "exactly one of"),
        ({"watch": "housings", "floor": 1, "ceiling": 2}, "exactly one of"),
        ({"watch": "stage_fault", "ceiling": 2}, "means nothing for 'stage_fault'"),
        ({"watch": "plate", "disagreement": 3}, "needs 'against'"),
        ({"watch": "plate", "ceiling": 3, "against": "coolant"}, "names the other temperature"),
        ({"watch": "housings", "ceiling": float("nan")}, "finite"),
        ({"watch": "level", "ceiling": 5}, "expected one of floor, stale_s"),
    ],
)
def test_a_condition_that_makes_no_sense_is_refused(block, said):
    with pytest.raises(ValidationError, match=said):
        Condition(**block)


def test_faults_of_the_block_carry_their_place(tmp_path: Path):
    path = tmp_path / "guard.yaml"
    path.write_text("poll_s: 0.5\nconditions:\n  - {watch: housings, cieling: 95}\n")
    with pytest.raises(ConfigError, match=r"guard.yaml:3:\d+: unknown key 'conditions.0.cieling'"):
        load_model(path, GuardSettings)


def test_a_healthy_bench_meets_none_of_the_default_conditions():
    watches = [ConditionWatch(condition) for condition in DEFAULT_CONDITIONS]
    for step in range(400):
        target = 87.0 - 0.3 * step if step < 330 else -12.0
        seen = look(
            5.0 * step, (target, target + 1.0, target - 1.0), plate=target + 4, coolant=target + 8, ambient=23.0,
            chiller=chiller(), stage_fault="", commanded={"dut_1": True}, read_back={"dut_1": True},
        )  # fmt: skip
        assert [found.detail for watch in watches if (found := watch.see(seen))] == []
