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


def test_such_a_table_is_consistent(make_table):
    assert not diagnose(with_holes(make_table, 11))[0].findings


def image_without_angles(seed):
    """Twelve steps, each off by 0.4 % as declared, of 200 pixels at four angles, one of which several steps lack."""
    rng = np.random.default_rng(seed)
    step, angle, pixel = (a.ravel() for a in np.meshgrid(np.arange(12), np.arange(4), np.arange(200), indexing="ij"))
    light = np.geomspace(90.0, 3500.0, 200)[(pixel * 77 + 31 * angle) % 200]
    sigma, off = 2.0 + 0.003 * light, 0.004 * rng.normal(size=12)
    measured = light * (1.0 + off[step]) + sigma / np.sqrt(20.0) * rng.normal(size=step.size)
    lacking = np.array([3, 3, 9, 9, 2, 0, 1, 9, 9, 0, 9, 2])[step] == angle
    table = {
        "step": step, "stage_angle_deg": 2.7 * angle, "pixel_u": pixel % 20, "pixel_v": pixel // 20,
        "set_temperature_c": np.array([-10, 0, 30, 45, 60, 75, 85, 75, 60, 30, 15, 0])[step],
        "ramp": np.where((step > 0) & (step < 7), 1, -1), "n_frames": np.full(step.size, 20),
        "sim_intensity_counts": light, "sim_intensity_counts_std": sigma,
        "sim_intensity_counts_repeat_std": 0.004 * light, "intensity_counts": measured,
    }  # fmt: skip
    return columns_of(pa.table({name: values[~lacking] for name, values in table.items()}))


@pytest.mark.parametrize("seed", [3, 4])
def test_an_angle_that_steps_lack_tells_nothing_of_what_the_steps_are_off(seed):
    """Three and a half angles a step: whitened first, they made data less likely that followed the set-points."""
    columns = image_without_angles(seed)
    problem = Problem(columns)
    (d,) = problem.data
    residual = d.residual(problem.view.fresh_state())
    alone, _ = d.fit_scatter(residual, without=("pixel", "angle", "frame"))
    assert d.fit_scatter(residual)[0] > alone - 1.0
    assert not diagnose(columns)[0].findings
