"""A nominal DUT through all metrics, judged by the limits that ship."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_sweep import SimulatedBench, value_of

from arl_fixtures.metrics.conditions import Conditions
from arl_fixtures.metrics.judge import judge, overall
from arl_fixtures.metrics.limits import check_metrics, load_limits
from arl_fixtures.metrics.nominal import nominal_reference
from arl_fixtures.metrics.registry import measure, metric_names, metric_units, remember
from arl_fixtures.metrics.verdict import Verdict
from arl_fixtures.twin.operating import operating_data
from arl_fixtures.twin.settings import DutSettings

LIMITS = Path(__file__).parents[2] / "limits"


@pytest.fixture(scope="module")
def bench() -> SimulatedBench:
    return SimulatedBench(DutSettings(serial="SN-1", height_m=0.1, gain=0.97, dead_pixels=((5, 5), (100, 20))))


@pytest.fixture(scope="module")
def first_sweep(bench):
    return bench.sweep(1)


@pytest.mark.parametrize("against", ["twin", "own"])
def test_a_nominal_dut_passes_every_shipped_limit(bench, first_sweep, against):
    geometry = bench.geometry.at(first_sweep.stage_angle_deg)
    own = bench.step(sweep=first_sweep)
    reference = nominal_reference(geometry) if against == "twin" else remember(own)
    step = bench.step(seed=2, reference=reference)
    limits = load_limits(LIMITS / "default.yaml")
    check_metrics(limits, metric_names(), metric_units())
    judgements = judge(measure(step), limits, step.conditions)
    assert [(j.measurement.name, j.reason) for j in judgements if j.decides and j.verdict is not Verdict.PASS] == []
    assert overall(judgements)[0] is Verdict.PASS
    assert len([j for j in judgements if j.decides]) >= len(limits.limits)


@pytest.mark.parametrize("file", ["default.yaml", "strict.yaml"])
@pytest.mark.parametrize("temperature_c", [-10.0, 60.0, 85.0])
def test_operating_data_of_every_temperature_are_within_limits(bench, first_sweep, temperature_c, file):
    nominal = operating_data(bench.dut.operating, temperature_c)
    operating = {name: np.full(len(first_sweep.frames), value) for name, value in nominal.items()}
    conditions = Conditions(set_temperature_c=temperature_c)
    step = bench.step(
        sweep=replace(first_sweep, operating=operating),
        conditions=conditions,
        reference=remember(bench.step(sweep=first_sweep)),
    )
    judgements = judge(measure(step), load_limits(LIMITS / file), conditions)
    assert {j.verdict for j in judgements if j.decides} == {Verdict.PASS}


def test_values_of_a_nominal_dut_are_the_nominal_models(bench, first_sweep):
    measured = measure(bench.step(sweep=first_sweep))
    assert value_of(measured, "dead_pixels").quantity.value == 2
    level = value_of(measured, "power_level").quantity
    assert level.value == pytest.approx(0.0, abs=0.05)
    for target in ("stripe_18", "stripe_50", "stripe_80"):
        error = value_of(measured, "distance_error", target).quantity
        assert error.value == pytest.approx(0.0, abs=0.01)
        index = bench.geometry.at(first_sweep.stage_angle_deg).seen(target)
        counts = bench.geometry.at(first_sweep.stage_angle_deg).intensity_counts.ravel()[index]
        model = np.sqrt(np.mean(36 + 0.25 * counts + (0.004 * counts) ** 2))
        sigma = value_of(measured, "intensity_scatter", target).quantity
        # rounding's share is taken out, so the model's own value is what is left
        assert abs(sigma.value - model) < 4 * sigma.u


def test_without_a_reference_changes_are_not_run_rather_than_invalid(bench, first_sweep):
    step = bench.step(sweep=first_sweep)
    judgements = judge(measure(step), load_limits(LIMITS / "default.yaml"), step.conditions)
    changes = [j for j in judgements if j.measurement.metric.endswith("_change") and j.decides]
    assert {j.verdict for j in changes} == {Verdict.NOT_RUN}
    assert {j.verdict for j in judgements if j not in changes and j.decides} <= {Verdict.PASS, Verdict.NOT_RUN}
