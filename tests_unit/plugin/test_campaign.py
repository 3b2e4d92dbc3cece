"""When a campaign stops by itself, judged from journals."""

import numpy as np
import pytest

from arl_fixtures.bench.clock import VirtualClock
from arl_fixtures.errors import ConfigError
from arl_fixtures.journal import entries
from arl_fixtures.journal.journal import Journal
from arl_fixtures.plugin.campaign import CampaignFile, Drift, StopRules, WearOut, next_cycle, why_stop
from arl_fixtures.yaml_model import load_model


def write(out, cycle, values, *, verdict="PASS", unit="%", planned=1):
    """One session that ended after one of the planned cycles: a value per DUT at two temperature steps."""
    identity = entries.Identity(
        duts=tuple(entries.Dut(serial=dut) for dut in values), bench_sha256="0", profile_sha256="0",
        limits_sha256="0", software_version="0",
    )  # fmt: skip
    plan = (f"c{cycle}-0", f"c{cycle}-1")
    cycles = tuple(range(cycle, cycle + planned))
    begin = entries.SessionBegin(campaign="c", cycles=cycles, plan=plan, identity=identity)
    with Journal.create(out / f"session-{cycle + 1:04d}.jsonl", begin, VirtualClock()) as journal:
        for index, step in enumerate(plan):
            at = {"step_id": step, "attempt": 1}
            lines = [
                entries.StepBegin(**at, cycle=cycle, step_index=index, set_temperature_c=25.0 + index, ramp=1),
                *(
                    entries.Measurement(
                        **at, dut=dut, metric="power_level", value=value + (index - 0.5), unit=unit, u=0.1
                    )
                    for dut, value in values.items()
                ),
                entries.StepEnd(**at, finished=True, verdict=verdict),
            ]
            journal.append_many(lines)


def test_cycles_are_counted_over_all_journals(tmp_path):
    assert next_cycle(tmp_path) == 0
    write(tmp_path, 0, {"A": 0.0})
    write(tmp_path, 4, {"A": 0.0}, planned=10)
    assert next_cycle(tmp_path) == 5, "cycles that were planned and never begun are not done"


def test_wear_out_names_dut_and_value_and_converts_units(tmp_path):
    rules = StopRules(wear_out=(WearOut(metric="power_level", unit="1", lower=-0.20, reason="20 % power loss"),))
    write(tmp_path, 0, {"A": -5.0, "B": -19.9})
    assert why_stop(rules, tmp_path, 0) == ""
    write(tmp_path, 1, {"A": -5.0, "B": -20.5})
    said = why_stop(rules, tmp_path, 1)
    assert said.startswith("B power_level is -0.205")
    assert "20 % power loss" in said


@pytest.mark.parametrize(("slope", "stops"), [(-0.4, False), (-0.6, True), (0.6, True)])
def test_drift_is_a_slope_over_the_last_cycles_not_a_single_jump(tmp_path, slope, stops):
    rule = Drift(metric="power_level", unit="%", per_cycle=0.5, over_cycles=5, reason="ages too fast")
    scatter = 0.05 * np.array([1, -1, 1, -1, 1, -1, 1])
    for cycle in range(7):
        write(tmp_path, cycle, {"A": slope * cycle + scatter[cycle]})
        if cycle < 4:
            assert why_stop(StopRules(drift=(rule,)), tmp_path, cycle) == ""
    assert bool(why_stop(StopRules(drift=(rule,)), tmp_path, 6)) is stops


def test_a_failed_step_stops_only_where_asked_and_only_in_its_own_cycle(tmp_path):
    write(tmp_path, 0, {"A": 0.0}, verdict="FAIL")
    write(tmp_path, 1, {"A": 0.0})
    assert why_stop(StopRules(verdict="FAIL"), tmp_path, 0) == "step c0-0 is FAIL"
    assert why_stop(StopRules(), tmp_path, 0) == ""
    assert why_stop(StopRules(verdict="FAIL"), tmp_path, 1) == ""


def test_a_campaign_file_is_checked_with_places(tmp_path):
    path = tmp_path / "campaign.yaml"
    rule = "{metric: power_level, unit: parsec, lower: 1, reason: x}"
    path.write_text(f"cycles: 10\nstop:\n  wear_out:\n    - {rule}\n")
    with pytest.raises(ConfigError, match=r"campaign.yaml:4:\d+: .*unknown unit 'parsec'"):
        load_model(path, CampaignFile)
