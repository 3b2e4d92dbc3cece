"""One test per temperature step of the aging cycle: `make cycle`."""

import pytest

from arl_fixtures.bench.profile import CycleStep
from arl_fixtures.plugin.outcome import raise_for
from arl_fixtures.plugin.step_runner import StepResult


@pytest.mark.cycle
def test_temperature_step(cycle_step: CycleStep, step_result: StepResult) -> None:
    """Every metric of every DUT is within its limits at this temperature."""
    assert step_result.step == cycle_step
    raise_for(step_result.verdict, step_result.judgements, step_result.reason)
