"""Displacements where nine sharp rays sample a pixel, against a bench traced here ray by ray."""

import numpy as np
import pytest
from traced_bench import seen_as_measured, table, trace

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.direct import loss, refine
from arl_fixtures.reconcile.effects_bench import bench_of, is_sharp
from arl_fixtures.reconcile.effects_camera import cameras_of
from arl_fixtures.reconcile.effects_pointing import by_whole_pixels
from arl_fixtures.reconcile.effects_rays import Pose
from arl_fixtures.reconcile.fit import fit, hold_back_edges, steady_jacobian
from arl_fixtures.reconcile.problem import Problem
from arl_fixtures.reconcile.screen import screen
from arl_fixtures.reconcile.terms import Term
from arl_fixtures.reconcile.view import View


@pytest.mark.parametrize(
    ("real", "pose"),
    [
        ({"turn_deg": 0.2}, Pose(turn_deg=0.2)),
        ({"tilt_deg": (0.3, -0.4, 0.8)}, Pose(tilt_deg=(0.3, -0.4, 0.8))),
        ({"forward_m": 0.006}, Pose(forward_m=0.006)),
    ],
)
def test_rays_that_cross_edges_are_those_of_the_displaced_bench(real, pose):
    columns = table(noise=False, **real)
    assert seen_as_measured(columns, Pose()) < 0.97
    assert seen_as_measured(columns, pose) > 0.998


@pytest.mark.parametrize("height_m", [0.10, 0.0, 0.06])
def test_the_height_of_a_dut_is_read_from_its_simulation(height_m):
    columns = table(height_m=height_m, turn_deg=0.2, noise=False)
    assert is_sharp(View(columns))
    # its number may be a pitch of the circles off where no pixel looks over a board
    assert seen_as_measured(columns, Pose(turn_deg=0.2)) > 0.998


def test_another_lens_is_read_from_the_rays():
    view = View(table(fx=63.0))
    assert cameras_of(view)[0].fx == pytest.approx(63.0, rel=1e-4)
    assert is_sharp(view)


def test_a_bench_without_targets_is_not_taken_for_the_nominal_one():
    assert bench_of(View(table(panels=False))) is None


def candidates(columns, effect, *, ways=(False,)):
    problem = Problem(columns)
    variants = [v for v in library()[effect].variants(problem.view) if by_whole_pixels(v) in ways]
    return problem, screen(problem, [(library()[effect], v) for v in variants], with_chance=True)


def test_a_zero_offset_is_found_though_a_derivative_sees_no_ray_cross():
    problem, found = candidates(table(turn_deg=0.065), "stage.zero_offset")
    best = found.candidates[0]
    assert best.gain > 3.0 * found.threshold(0.99)
    fitted = fit(problem, [best.term])
    zero = fitted.terms[0].values["zero"]
    assert zero == pytest.approx(0.065, abs=0.02)
    width = 2.0 / np.linalg.norm(steady_jacobian(problem, fitted)[:, 0])
    assert abs(zero - 0.065) < width < 0.05


@pytest.mark.parametrize(
    ("effect", "real", "name", "size"),
    [
        ("stage.zero_offset", {"turn_deg": 0.01}, "zero", 0.01),
        ("stage.eccentricity", {"forward_m": 0.0006}, "forward", 0.0006),
        ("mount.tilt", {"tilt_deg": (0.0, 0.03, 0.0)}, "pitch", 0.03),
    ],
)
def test_what_no_sharp_ray_shows_is_found_by_what_whole_pixels_see(effect, real, name, size):
    problem, found = candidates(table(whole=True, **real), effect, ways=(False, True))
    best = found.candidates[0]
    assert by_whole_pixels(best.term.variant)
    assert best.gain > 3.0 * found.threshold(0.99)
    assert all(c.gain < 0.5 * best.gain for c in found.candidates if not by_whole_pixels(c.term.variant))
    assert fit(problem, [best.term]).terms[0].values[name] == pytest.approx(size, rel=0.2)


def test_only_one_displacement_is_tried_at_the_edges_of_sharp_rays():
    problem, found = candidates(table(turn_deg=0.065), "stage.zero_offset")
    kinds = [(library()["mount.tilt"], v) for v in library()["mount.tilt"].variants(problem.view)]
    assert len(kinds) == 2
    assert screen(problem, kinds, [found.candidates[0].term]).candidates == ()


def test_trials_find_nothing_where_nothing_is_displaced():
    _, found = candidates(table(), "stage.zero_offset")
    assert all(c.gain < found.threshold(0.99) for c in found.candidates)


def test_rows_of_edges_that_a_fit_leaves_are_held_back():
    problem, found = candidates(table(turn_deg=0.2), "stage.zero_offset")
    term = found.candidates[0].term
    near = fit(problem, [Term(effect=term.effect, variant=term.variant, values={"zero": 0.17})], rounds=0)
    worst = max(float(np.max(np.abs(d.residual(near.state)) / d.stated)) for d in problem.data)
    hold_back_edges(problem, near)
    held = max(float(np.max(np.abs(d.residual(near.state)) * d.root_weight)) for d in problem.data)
    assert worst > 10.0
    assert held < 0.6 * worst


def test_refinement_climbs_a_staircase():
    def steps(place):
        return -float(np.floor(50.0 * abs(place[0] - 0.37)))

    found = refine(steps, np.array([0.2]), np.array([0.1]), np.array([-1.0]), np.array([1.0]))
    assert abs(found[0] - 0.37) < 0.02


def test_one_wrong_crossing_does_not_outweigh_twenty_right_ones():
    assert loss(np.array([100.0]))[0] < np.sum(loss(np.full(20, 3.0)))
    assert loss(np.array([0.1]))[0] == pytest.approx(0.005, rel=0.01)


def first_crossing(seed):
    """Least turn of a stage, degrees, that any ray shows; by the rays traced here."""
    columns = table(seed=seed, angles=41, pixels=16, noise=False)
    where = [columns.numbers[n] for n in ("pixel_u", "pixel_v", "stage_angle_deg")]
    still, _ = trace(*where, 0.10)
    unseen, seen = 0.0, 0.5
    for _ in range(14):
        middle = 0.5 * (unseen + seen)
        light, _ = trace(where[0], where[1], where[2] + middle, 0.10)
        crossed = bool(np.any(np.abs(light / still - 1.0) > 0.02))
        unseen, seen = (unseen, middle) if crossed else (middle, seen)
    return seen


@pytest.mark.parametrize("seed", [33, 37])  # pixels whose edges are no closer to a ray than some millidegrees
def test_a_zero_is_found_by_the_first_ray_that_crosses_though_more_cross_soon_after(seed):
    turn = first_crossing(seed)
    _, found = candidates(table(seed=seed, angles=41, pixels=16, turn_deg=turn), "stage.zero_offset")
    best = found.candidates[0].term
    assert best.variant.options["kind"] == "constant"
    assert best.values["zero"] == pytest.approx(turn, rel=0.02)
