"""Of ten frames nearly all return: a row that lacks one is no wild reading, and the others' mean no mismatch."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def returns(seed, sure, *, broken=0):
    """Ten frames of each of 40 pixels at 15 angles and 10 steps; in the first `broken` rows none returns."""
    rng = np.random.default_rng(seed)
    step, angle, pixel = (a.ravel() for a in np.meshgrid(range(10), range(15), range(40), indexing="ij"))
    probability = np.where(pixel % 2 == 0, sure, 0.966)
    share = rng.binomial(10, probability) / 10.0
    share[rng.permutation(pixel.size)[:broken]] = 0.0
    return columns_of(pa.table({
        "step": 1.0 * step, "stage_angle_deg": 3.0 * angle, "pixel_u": 1.0 * pixel,
        "n_frames": np.full(step.size, 10.0),
        "valid_fraction": share, "sim_valid_fraction": probability,
        "sim_valid_fraction_std": np.sqrt(probability * (1.0 - probability)),
    }))  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_frames_that_are_lost_by_chance_are_counted_in_full(seed):
    assert not diagnose(returns(seed, 0.996))[0].findings


def test_rows_that_lost_more_than_chance_takes_are_held_back():
    columns = returns(4, 0.996, broken=12)
    problem = Problem(columns)
    (data,) = problem.data
    Looker(problem).calibrate(data, problem.view.fresh_state())
    gone = data.measured == 0.0
    assert np.all(data.trust[gone] < 0.5)
    assert np.all(data.trust[data.measured >= 0.9] == 1.0)
