"""The length of a law's wave is tuned, and may become a part of a full turn, which is not tuned any more."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.law_basis import Basis, waves_of
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_fit import joint
from arl_fixtures.reconcile.law_shape import sharpened
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import columns_of

SPAN = 24.0


def test_a_wave_is_tuned_to_a_part_of_a_full_turn():
    rng = np.random.default_rng(1)
    step, angle = (a.ravel() for a in np.meshgrid(np.arange(12.0), np.linspace(-SPAN / 2, SPAN / 2, 241)))
    simulated = np.full(step.size, 500.0)
    columns = {
        "step": step, "stage_angle_deg": angle, "n_frames": np.full(step.size, 10),
        "sim_intensity_counts": simulated, "sim_intensity_counts_std": np.full(step.size, 20.0),
        "intensity_counts": simulated * (1.0 + 0.05 * np.sin(2.0 * np.pi * angle / 8.0))
        + rng.normal(0.0, 20.0 / np.sqrt(10.0), step.size),
    }  # fmt: skip
    problem = Problem(columns_of(pa.table(columns)))
    looker = Looker(problem)
    (data,) = problem.data
    work = Work(data, problem.view.fresh_state(), looker.features, data.tau)
    longer = Basis(waves=waves_of("stage_angle_deg", 3.125 / SPAN))
    found = sharpened(work, joint(work, Candidates(work).add([longer])))
    (axis,) = found.terms[0].basis.waves[0]
    assert axis.at == pytest.approx(8.0, rel=1e-6)
