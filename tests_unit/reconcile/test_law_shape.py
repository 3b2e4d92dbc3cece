"""The length of a law's wave is tuned, and may become a part of a full turn, which is not tuned any more."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.law_basis import Basis, folded, waves_of
from arl_fixtures.reconcile.law_candidates import Candidates
from arl_fixtures.reconcile.law_fit import joint
from arl_fixtures.reconcile.law_shape import sharpened
from arl_fixtures.reconcile.law_work import Work
from arl_fixtures.reconcile.pilot import Looker
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.table import columns_of

SPAN = 24.0


def swept(off):
    """A sweep of the stage, twelve times; what the signal is off by is a function of the angle."""
    rng = np.random.default_rng(1)
    step, angle = (a.ravel() for a in np.meshgrid(np.arange(12.0), np.linspace(-SPAN / 2, SPAN / 2, 241)))
    simulated = np.full(step.size, 500.0)
    columns = {
        "step": step, "stage_angle_deg": angle, "n_frames": np.full(step.size, 10),
        "sim_intensity_counts": simulated, "sim_intensity_counts_std": np.full(step.size, 20.0),
        "intensity_counts": simulated * (1.0 + off(angle)) + rng.normal(0.0, 20.0 / np.sqrt(10.0), step.size),
    }  # fmt: skip
    problem = Problem(columns_of(pa.table(columns)))
    (data,) = problem.data
    return Work(data, problem.view.fresh_state(), Looker(problem).features, data.tau)


def test_a_wave_is_tuned_to_a_part_of_a_full_turn():
    work = swept(lambda angle: 0.05 * np.sin(2.0 * np.pi * angle / 8.0))
    longer = Basis(waves=waves_of("stage_angle_deg", 3.125 / SPAN))
    found = sharpened(work, joint(work, Candidates(work).add([longer])))
    (axis,) = found.terms[0].basis.waves[0]
    assert axis.at == pytest.approx(8.0, rel=1e-6)


def table_of(turns):
    phase = folded("stage_angle_deg", turns / SPAN)
    return Basis(axes=(phase,), prior=np.eye(phase.count))


def test_a_table_of_a_ramp_that_falls_back_becomes_the_ramp():
    work = swept(lambda angle: 0.05 * np.mod((angle - 1.3) / 7.0, 1.0))
    found = sharpened(work, joint(work, Candidates(work).add([table_of(3.4)])))
    (axis,) = found.terms[0].basis.axes
    assert axis.kind == "saw"
    assert axis.at == pytest.approx(7.0, rel=0.01)
    assert np.mod(axis.middle - 1.3 + 3.5, 7.0) - 3.5 == pytest.approx(0.0, abs=0.1)


def test_a_table_of_a_wave_stays_one():
    work = swept(lambda angle: 0.05 * np.sin(2.0 * np.pi * angle / 7.0))
    found = sharpened(work, joint(work, Candidates(work).add([table_of(3.4)])))
    assert [axis.kind for axis in found.terms[0].basis.axes] == ["table"]


def test_no_ramp_is_sought_in_less_than_two_turns():
    work = swept(lambda angle: 0.004 * angle)
    found = sharpened(work, joint(work, Candidates(work).add([table_of(0.34)])))
    assert [axis.kind for axis in found.terms[0].basis.axes] == ["table"]
