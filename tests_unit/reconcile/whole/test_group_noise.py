"""Whitening and group scatter against dense linear algebra and simulated groups."""

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from arl_fixtures.reconcile.noise import GAUGE_FREEDOM, Level, fit_tau, surprise
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of
from arl_fixtures.reconcile.whitener import Whitener


def levels(rng: np.random.Generator, steps: int, frames: int, rows: int) -> tuple[np.ndarray, tuple[Level, ...]]:
    step = np.repeat(np.arange(steps), frames * rows)
    frame = np.repeat(np.arange(steps * frames), rows)
    scale = rng.uniform(0.5, 2.0, len(step))
    return rng.uniform(0.5, 3.0, len(step)), (
        Level(name="frame", code=frame, count=steps * frames, scale=scale),
        Level(name="step", code=step, count=steps, scale=scale),
    )


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), inner=st.floats(0.0, 3.0), outer=st.floats(0.0, 3.0))
def test_nested_whitening_is_the_exact_inverse_of_the_covariance(seed, inner, outer):
    rng = np.random.default_rng(seed)
    root, (frame, step) = levels(rng, 3, 2, 3)
    whiten = Whitener(root, (frame, step), {"frame": inner, "step": outer})
    same_frame = frame.code[:, None] == frame.code
    same_step = step.code[:, None] == step.code
    shared = np.outer(frame.scale, frame.scale)
    covariance = np.diag(1.0 / root**2) + inner**2 * shared * same_frame + outer**2 * shared * same_step
    x = rng.normal(size=len(root))
    assert whiten(x) @ whiten(x) == pytest.approx(x @ np.linalg.solve(covariance, x), rel=1e-8)
    noise = np.linalg.slogdet(covariance)[1] + 2.0 * np.log(root).sum()
    assert whiten.log_det == pytest.approx(noise, rel=1e-8, abs=1e-8)


def test_columns_are_whitened_together_as_one_by_one():
    rng = np.random.default_rng(5)
    root, groups = levels(rng, 4, 3, 5)
    whiten = Whitener(root, groups, {"frame": 0.7, "step": 1.3})
    x = rng.normal(size=(6, len(root)))
    z = (root * x).T.copy()
    whiten.columns(z)
    together = z.T
    assert together == pytest.approx(np.stack([whiten(row) for row in x]), rel=1e-12, abs=1e-12)


def test_group_scatter_is_estimated_without_bias_and_is_zero_without_groups():
    rng = np.random.default_rng(3)
    weight = np.full(400, 25.0)
    quiet = rng.normal(size=400) * np.sqrt(weight)
    loud = quiet + 0.3 * rng.normal(size=400) * weight
    assert fit_tau(loud, weight)[0] == pytest.approx(0.3, rel=0.1)
    assert fit_tau(loud, weight)[1] > 50.0
    assert fit_tau(quiet, weight)[0] < 0.06


def test_a_declared_scatter_is_the_least_that_is_assumed():
    rng = np.random.default_rng(4)
    assert fit_tau(rng.normal(size=50), np.ones(50), floor=1.0) == (1.0, 0.0)


@settings(max_examples=30, deadline=None)
@given(ratio=st.floats(1.0, 5.0), freedom=st.integers(2, 40))
def test_what_a_gauge_study_says_against_a_larger_scatter_is_its_chi_square(ratio, freedom):
    def found_one(scatter):  # density of a sample variance of 1 where the true one is scatter²
        return stats.chi2.logpdf(freedom / scatter**2, freedom) + np.log(freedom / scatter**2)

    assert surprise(ratio, 1.0, float(freedom)) == pytest.approx(found_one(1.0) - found_one(ratio), abs=1e-9)


def test_a_stated_repeatability_gives_way_to_many_steps_and_hardly_to_few():
    rng = np.random.default_rng(9)
    weight = np.full(200, 4.0)
    twice = 2.0 * weight * rng.normal(size=200) + np.sqrt(weight) * rng.normal(size=200)
    plain, _ = fit_tau(twice, weight, floor=1.0)
    many, _ = fit_tau(twice, weight, floor=1.0, freedom=GAUGE_FREEDOM)
    few, _ = fit_tau(twice[:6], weight[:6], floor=1.0, freedom=GAUGE_FREEDOM)
    assert plain == pytest.approx(2.0, rel=0.15)
    assert many == pytest.approx(plain, rel=0.1)
    assert few < min(fit_tau(twice[:6], weight[:6], floor=1.0)[0], 0.8 * plain)


def test_pixels_that_see_more_of_one_step_than_of_another_do_not_seem_to_differ():
    rng = np.random.default_rng(12)
    step, pixel = (part.ravel() for part in np.mgrid[0:13, 0:400])
    kept = np.sort(rng.permutation(step.size)[: step.size // 2])  # returns are lost at random
    step, pixel = step[kept], pixel[kept]
    sim = np.full(step.size, 800.0)
    shared = rng.normal(0.0, 0.006, 13)[step]
    seen = sim * (1.0 + shared) + rng.normal(0.0, 2.0, step.size)
    table = pa.table({
        "step": step, "pixel_u": pixel, "sim_intensity_counts": sim, "intensity_counts": seen,
        "sim_intensity_counts_std": np.full(step.size, 2.0),
        "sim_intensity_counts_repeat_std": 0.006 * sim,
    })  # fmt: skip
    problem = Problem(columns_of(table))
    (data,) = problem.data
    _, tau = data.fit_scatter(data.residual(problem.view.fresh_state()))
    error = 2.0 / 800.0 / np.sqrt(6.5)  # of a pixel's mean
    assert tau["pixel"] < 0.5 * error
    assert 0.6 < tau["step"] < 1.6


def test_a_repeatability_in_counts_makes_neither_pixels_nor_images_differ_nor_a_unit():
    """What a step shares is an offset here, what calibration frees of a unit is a gain: signals differ thirtyfold."""
    rng = np.random.default_rng(31)
    dut, step, angle, pixel = (part.ravel() for part in np.mgrid[0:3, 0:15, 0:3, 0:48])
    sim = np.where(pixel < 30, 110.0, np.where(pixel < 36, 700.0, 3100.0)) * (1.0 + 0.1 * rng.random(48)[pixel])
    noise = np.sqrt(25.0 + 0.3 * sim)
    off = rng.normal(0.0, 6.0, (3, 15))
    off[2] += 4.0 - off[2].mean()  # two and a half standard errors: a unit that chance put above the others
    seen = sim + off[dut, step] + noise * rng.normal(size=sim.size) / np.sqrt(10.0)
    table = pa.table({
        "dut": np.array(["a", "b", "c"])[dut], "step": step, "stage_angle_deg": 7.5 * angle, "pixel_u": pixel,
        "n_frames": np.full(sim.size, 10), "sim_intensity_counts": sim, "intensity_counts": seen,
        "sim_intensity_counts_std": noise, "sim_intensity_counts_repeat_std": np.full(sim.size, 6.0),
    })  # fmt: skip
    problem = Problem(columns_of(table))
    (data,) = problem.data
    _, tau = data.fit_scatter(data.residual(problem.view.fresh_state()))
    assert max(tau["pixel"], tau["frame"], tau["angle"]) < 1e-3  # the error of one image's gain
    assert diagnose(columns_of(table))[0].verdict == "consistent"
