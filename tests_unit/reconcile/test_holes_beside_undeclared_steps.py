"""Steps scatter, nobody says so, and a quarter of the sweep is missing: pixels and angles see more of some steps."""

import numpy as np
import pyarrow as pa
import pytest

from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of


def with_holes(make_table, seed):
    """Every fourth image is missing, and what steps share is not declared."""
    table = make_table(seed, steps=20, shared=1.5)
    rng = np.random.default_rng(seed + 1000)
    image = np.unique(np.stack([table["step"], table["stage_angle_deg"]]), axis=1, return_inverse=True)[1].ravel()
    kept = (rng.random(image.max() + 1) > 0.25)[image]
    return columns_of(pa.table({
        name: values[kept] for name, values in table.items() if not name.endswith("_repeat_std")
    }))  # fmt: skip


@pytest.mark.parametrize("seed", [11, 12, 13, 14])
def test_what_steps_share_is_not_taken_for_a_scatter_of_pixels_and_angles(make_table, seed):
    problem = Problem(with_holes(make_table, seed))
    d = next(d for d in problem.data if d.channel.name == "intensity_counts")
    residual = d.residual(problem.view.fresh_state())
    likelihood, tau = d.fit_scatter(residual)
    assert tau["step"] == pytest.approx(0.006, rel=0.4)
    assert max(tau["pixel"], tau["angle"]) < 0.06 * tau["step"]
    # a further scatter at its best never makes the data less likely
    assert likelihood > d.fit_scatter(residual, without=("pixel", "angle"))[0] - 1.0


@pytest.mark.parametrize("seed", [11, 13])
def test_such_a_table_is_consistent(make_table, seed):
    assert not diagnose(with_holes(make_table, seed))[0].findings
