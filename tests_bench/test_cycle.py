"""One test per temperature step of the aging cycle: `make cycle`."""

import pytest

from arl_fixtures.plugin.cycle import StepOutcome
from arl_fixtures.plugin.outcome import raise_for


@pytest.mark.cycle
@pytest.mark.usefixtures("cycle_step")
def test_temperature_step(step_outcome: StepOutcome) -> None:
    """Every metric of every DUT is within its limits at this temperature."""
    raise_for(step_outcome.verdict, step_outcome.rows, step_outcome.reason)
