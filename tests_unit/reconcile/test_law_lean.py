"""What leans on a second column needs several images: any two that are off lie on a line, and by chance three."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.law import Axis
from arl_fixtures.reconcile.law_basis import Basis
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_fit import Chosen, holds_between, joint
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import columns_of

STEPS, ANGLES = 12, 21


def off_on_a_line(steps):
    """Images of 16 pixels, those of some steps brighter by 5 % where the angle is a tenth of the temperature."""
    rng = np.random.default_rng(1)
    step, stop, pixel = (a.ravel() for a in np.meshgrid(np.arange(STEPS), np.arange(ANGLES), np.arange(16.0)))
    angle, temperature = stop - 10.0, 10.0 * (step - 6.0)
    off = np.isin(step, steps) & (np.abs(angle - 0.1 * temperature) < 0.5)
    simulated = np.full(step.size, 500.0)
    columns = {
        "step": step, "stage_angle_deg": angle, "set_temperature_c": temperature, "pixel_u": pixel,
        "n_frames": np.full(step.size, 10), "sim_intensity_counts": simulated,
        "sim_intensity_counts_std": np.full(step.size, 20.0),
        "intensity_counts": simulated * (1.0 + 0.05 * off) + rng.normal(0.0, 20.0 / np.sqrt(10.0), step.size),
    }  # fmt: skip
    return Problem(columns_of(pa.table(columns)))


@pytest.mark.parametrize(("steps", "holds"), [((2, 9), False), ((2, 5, 9), False), (range(STEPS), True)])
def test_few_images_on_a_line_are_no_law(steps, holds):
    problem = off_on_a_line(steps)
    (data,) = problem.data
    work = Work(data, problem.view.fresh_state(), Looker(problem).features, data.tau)
    axis = Axis(column="stage_angle_deg", beside="set_temperature_c", lean=-0.1, kind="band", edges=(-0.5, 0.5))
    trial = joint(work, Candidates(work).add([Basis(axes=(axis,))]))
    assert holds_between(work, Chosen(left=work.residual), trial) is holds
